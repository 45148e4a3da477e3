//! Open a toy dishwasher: a door hinged at its lower edge. The second of the paper's two tasks on
//! the real arm, with dimensions of our own; it stands where it stands, as the toy kitchen of the
//! paper did.

use super::builder::{SceneBuilder, arc_about, cuboid, cylinder_y, grip_pose, turn_about};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, JointKind, JointSpec};
use core::f32::consts::FRAC_PI_2;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn open_dishwasher() -> Task {
    Task {
        name: "open_dishwasher".to_owned(),
        set: TaskSet::Extra,
        goal: "open the dishwasher".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(0.15, 0.15),
            half_range: Vec2::ZERO,
            max_yaw: 0.0,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Depth x, width y, height z; its front is towards -x, at the task frame.
const BODY: [f32; 3] = [0.24, 0.30, 0.32];
/// Thickness, width, height of the door.
const DOOR: [f32; 3] = [0.012, 0.28, 0.24];
const DOOR_MASS: f32 = 0.25;
/// A point of the hinge; its axis is -y, so that the door falls towards the arm.
const HINGE: Vec3 = Vec3::new(-0.007, 0.0, 0.06);
/// Friction of the hinge, N·m: a little more than the door's weight.
const BRAKE: f32 = 0.32;
/// The handle's bar: where its axis is, its radius and length.
const BAR: [f32; 3] = [-0.062, 0.0, 0.285];
const BAR_RADIUS: f32 = 0.006;
const BAR_LENGTH: f32 = 0.12;
/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = 60_f32.to_radians();
const DEMONSTRATED: f32 = 66_f32.to_radians();
/// The hand looks this far down when it takes the bar, degrees; while the door opens it turns less
/// than the door, and the bar in it.
const HAND_PITCH: f32 = 30.0;
const HAND_TURN: f32 = 10_f32.to_radians();
/// Distance from the bar at which the hand begins, metres.
const APPROACH: f32 = 0.08;

const ENAMEL: [u8; 3] = [226, 228, 232];
const DOOR_RGB: [u8; 3] = [120, 168, 190];
const METAL: [u8; 3] = [70, 74, 82];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let body = scene.body("dishwasher", BodyKind::Fixed, Vec3::ZERO, 0.0, body_parts());
    let door = scene.body("door", BodyKind::Dynamic, HINGE, DOOR_MASS, door_parts());
    let joint = scene.joint(JointSpec {
        name: "door_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: body,
        child: door,
        anchor: HINGE,
        axis: Vec3::NEG_Y,
        limits: [0.0, FRAC_PI_2],
        start: 0.0,
        brake: BRAKE,
        spring: 0.0,
        latch: None,
    });
    let grasp = grip_pose(BAR, [-90.0 - HAND_PITCH, 0.0, -90.0]);
    let approach = grasp * Pose3::from_translation(Vec3::Z * -APPROACH);
    scene.waypoint(approach, Gripper::Open, Approach::Free);
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    let bar = Vec3::from(BAR);
    let (end, arc) = arc_about(grasp, |share| {
        let turned = turn_about(HINGE, Vec3::NEG_Y, share * DEMONSTRATED);
        turned * turn_about(bar, Vec3::Y, share * (DEMONSTRATED - HAND_TURN))
    });
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}

/// Sides, back, floor and top: the front is open.
fn body_parts() -> Vec<Part> {
    /// Thickness of the walls.
    const WALL: f32 = 0.012;
    let [depth, width, height] = BODY;
    let (middle, side) = (0.5 * depth, 0.5 * (width - WALL));
    vec![
        cuboid([middle, side, 0.5 * height], [depth, WALL, height], ENAMEL),
        cuboid([middle, -side, 0.5 * height], [depth, WALL, height], ENAMEL),
        cuboid([depth - 0.5 * WALL, 0.0, 0.5 * height], [WALL, width, height], ENAMEL),
        cuboid([middle, 0.0, 0.025], [depth, width, 0.05], ENAMEL),
        cuboid([middle, 0.0, height - 0.5 * WALL], [depth, width, WALL], ENAMEL),
    ]
}

/// The door around its hinge: slab, bar and its two posts.
fn door_parts() -> Vec<Part> {
    let [thickness, width, height] = DOOR;
    let bar = Vec3::from(BAR) - HINGE;
    let mut parts = vec![
        cuboid([0.0, 0.0, 0.5 * height], [thickness, width, height], DOOR_RGB),
        cylinder_y(bar.to_array(), BAR_RADIUS, BAR_LENGTH, METAL),
    ];
    for side in [-1.0, 1.0] {
        let y = side * 0.5 * (BAR_LENGTH - 0.008);
        parts.push(cuboid([0.5 * bar.x, y, bar.z], [-bar.x, 0.008, 0.008], METAL));
    }
    parts
}
