//! Open a door: its lever unlatches it, then it is pushed away.

use super::builder::{
    SceneBuilder, arc_about, cuboid, cylinder_x, cylinder_y, grip_pose, turn_about,
};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, JointKind, JointSpec, Latch};
use core::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use glamx::{Pose3, Quat, Vec2, Vec3};

/// The task.
pub(super) fn open_door() -> Task {
    Task {
        name: "open_door".to_owned(),
        set: TaskSet::Extra,
        goal: "turn the lever and push the door open".to_owned(),
        variations: Vec::new(),
        keyframes: 4,
        placement: Placement {
            center: Vec2::new(0.05, 0.0),
            half_range: Vec2::new(0.05, 0.10),
            max_yaw: FRAC_PI_4,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Thickness x, width y, height z.
const DOOR: [f32; 3] = [0.015, 0.39, 0.913];
/// A point of the hinge; its axis is -z, so that the door opens away from the arm.
const HINGE: Vec3 = Vec3::new(0.190, -0.204, 0.0);
/// Height of the post on the lever's side: the arm swings over it.
const STRIKE: f32 = 0.25;
const DOOR_MASS: f32 = 2.0;
/// Friction of the hinge, N·m.
const BRAKE: f32 = 0.2;
const DOOR_RANGE: f32 = 30_f32.to_radians();
/// The lever's axle; it turns about +x, its free end down.
const AXLE: Vec3 = Vec3::new(0.150, 0.155, 0.478);
const LEVER_RADIUS: f32 = 0.007;
const LEVER_LENGTH: f32 = 0.11;
const LEVER_MASS: f32 = 0.25;
const LEVER_RANGE: f32 = 35_f32.to_radians();
/// Spring that turns the lever back, N·m/rad: its own weight turns it by a few degrees.
const LEVER_SPRING: f32 = 3.0;
/// Lever at which the latch lets go, and at which the demonstrator stops, radians.
const UNLATCHED: f32 = 25_f32.to_radians();
const LEVER_DEMONSTRATED: f32 = 30_f32.to_radians();
/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = 25_f32.to_radians();
const DEMONSTRATED: f32 = 28_f32.to_radians();
/// Distance from the lever's axle along -y at which the lever is held, metres.
const HOLD: f32 = 0.08;
/// Distance from the lever at which the hand begins, metres.
const APPROACH: f32 = 0.10;

const PAINT: [u8; 3] = [206, 196, 178];
const FRAME: [u8; 3] = [120, 96, 74];
const BRASS: [u8; 3] = [190, 160, 84];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let [thickness, width, height] = DOOR;
    let post = |y, height| cuboid([HINGE.x, y, 0.5 * height], [0.02, 0.02, height], FRAME);
    let posts = vec![post(HINGE.y - 0.012, height), post(HINGE.y + width + 0.012, STRIKE)];
    let frame = scene.body("frame", BodyKind::Fixed, Vec3::ZERO, 0.0, posts);
    // A millimetre above the table.
    let slab = cuboid([0.0, 0.5 * width, 0.5 * height + 0.001], [thickness, width, height], PAINT);
    let door = scene.body("door", BodyKind::Dynamic, HINGE, DOOR_MASS, vec![slab]);
    let lever = scene.body("lever", BodyKind::Dynamic, AXLE, LEVER_MASS, lever_parts());
    let hinge = scene.joint(JointSpec {
        name: "door_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: frame,
        child: door,
        anchor: HINGE,
        axis: Vec3::NEG_Z,
        limits: [0.0, DOOR_RANGE],
        start: 0.0,
        brake: BRAKE,
        spring: 0.0,
        latch: Some(Latch { joint: 1, min: UNLATCHED }),
    });
    scene.joint(JointSpec {
        name: "lever_axle".to_owned(),
        kind: JointKind::Revolute,
        parent: door,
        child: lever,
        anchor: AXLE,
        axis: Vec3::X,
        limits: [0.0, LEVER_RANGE],
        start: 0.0,
        brake: 0.0,
        spring: LEVER_SPRING,
        latch: None,
    });
    // The hand looks along +x, its fingers above and below the lever.
    let hand = [0.0, 90.0, 0.0];
    let held = AXLE - Vec3::Y * HOLD;
    let grasp = grip_pose(held.to_array(), hand) * upright();
    let approach = grip_pose((held - Vec3::X * APPROACH).to_array(), hand) * upright();
    scene.waypoint(approach, Gripper::Open, Approach::Free);
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    let (turned, arc) =
        arc_about(grasp, |share| turn_about(AXLE, Vec3::X, share * LEVER_DEMONSTRATED));
    scene.waypoint(turned, Gripper::Close, Approach::Through(arc));
    let (end, arc) =
        arc_about(turned, |share| turn_about(HINGE, Vec3::NEG_Z, share * DEMONSTRATED));
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint: hinge, min: OPEN }])
}

/// Turns a hand about its approach, so that it opens upwards.
fn upright() -> Pose3 {
    Pose3::from_rotation(Quat::from_rotation_z(FRAC_PI_2))
}

/// The lever around its axle: bar and axle.
fn lever_parts() -> Vec<Part> {
    let gap = HINGE.x - 0.5 * DOOR[0] - AXLE.x;
    vec![
        cylinder_y([0.0, -0.5 * LEVER_LENGTH, 0.0], LEVER_RADIUS, LEVER_LENGTH, BRASS),
        cylinder_x([0.5 * gap, 0.0, 0.0], LEVER_RADIUS, gap, BRASS),
    ]
}
