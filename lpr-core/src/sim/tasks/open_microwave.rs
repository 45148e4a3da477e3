//! Open a microwave: a wide door with friction in its hinge, pulled around by an upright bar.

use super::builder::{SceneBuilder, arc_about, cuboid, cylinder_z, grip_pose, turn_about};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, JointKind, JointSpec};
use core::f32::consts::{FRAC_PI_2, FRAC_PI_8};
use glamx::{Vec2, Vec3};

/// The task.
pub(super) fn open_microwave() -> Task {
    Task {
        name: "open_microwave".to_owned(),
        set: TaskSet::Extra,
        goal: "open the microwave".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(-0.03, 0.04),
            half_range: Vec2::new(0.05, 0.05),
            max_yaw: FRAC_PI_8,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Width x, depth y, height z of the body; its front is towards -y.
const BODY: [f32; 3] = [0.57, 0.276, 0.314];
/// Width, thickness, height of the door.
const DOOR: [f32; 3] = [0.456, 0.0144, 0.264];
/// A point of the hinge; its axis is -z.
const HINGE: Vec3 = Vec3::new(-0.240, 0.182, 0.138);
const DOOR_MASS: f32 = 0.15;
/// Friction of the hinge, N·m.
const BRAKE: f32 = 2.07;
/// The bar: where its axis is, its radius and length.
const BAR: [f32; 3] = [0.194, 0.145, 0.138];
const BAR_RADIUS: f32 = 0.008;
const BAR_LENGTH: f32 = 0.216;
/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = 80_f32.to_radians();
const DEMONSTRATED: f32 = 85_f32.to_radians();
/// Distance from the bar at which the hand begins, metres.
const APPROACH: f32 = 0.08;

const CASE: [u8; 3] = [214, 216, 220];
const GLASS: [u8; 3] = [46, 50, 58];
const PANEL: [u8; 3] = [96, 102, 112];
const STEEL: [u8; 3] = [150, 156, 164];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let [width, depth, height] = BODY;
    let front = HINGE.y + 0.5 * DOOR[1] + 0.001;
    let controls_x = 0.5 * (HINGE.x + DOOR[0] + 0.5 * width);
    let controls_width = 0.5 * width - (HINGE.x + DOOR[0]) - 0.01;
    let body = vec![
        cuboid([0.0, front + 0.5 * depth, 0.5 * height], [width, depth, height], CASE),
        cuboid([controls_x, front - 0.002, HINGE.z], [controls_width, 0.004, DOOR[2]], PANEL),
    ];
    let body = scene.body("microwave", BodyKind::Fixed, Vec3::ZERO, 0.0, body);
    let door = scene.body("door", BodyKind::Dynamic, HINGE, DOOR_MASS, door_parts());
    let joint = scene.joint(JointSpec {
        name: "door_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: body,
        child: door,
        anchor: HINGE,
        axis: Vec3::NEG_Z,
        limits: [0.0, FRAC_PI_2],
        start: 0.0,
        brake: BRAKE,
        spring: 0.0,
        latch: None,
    });
    // The hand looks along +y, its fingers left and right of the bar.
    let hand = [22.0, 90.0, 112.0];
    let grasp = grip_pose(BAR, hand);
    scene.waypoint(
        grip_pose([BAR[0], BAR[1] - APPROACH, BAR[2]], hand),
        Gripper::Open,
        Approach::Free,
    );
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    let (end, arc) = arc_about(grasp, |share| turn_about(HINGE, Vec3::NEG_Z, share * DEMONSTRATED));
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}

/// The door around its hinge: frame, window, bar and its two posts.
fn door_parts() -> Vec<Part> {
    let from_hinge = |point: [f32; 3]| (Vec3::from(point) - HINGE).to_array();
    let [width, thickness, height] = DOOR;
    let middle = 0.5 * width;
    let mut parts = vec![
        cuboid([middle, 0.0, 0.0], [width, thickness, height], CASE),
        cuboid([middle - 0.03, -0.5 * thickness, 0.0], [width - 0.12, 0.002, height - 0.07], GLASS),
        cylinder_z(from_hinge(BAR), BAR_RADIUS, BAR_LENGTH, STEEL),
    ];
    let gap = HINGE.y - 0.5 * thickness - BAR[1];
    for side in [-1.0, 1.0] {
        let z = BAR[2] + side * 0.5 * (BAR_LENGTH - 0.012);
        parts.push(cuboid(from_hinge([BAR[0], BAR[1] + 0.5 * gap, z]), [0.012, gap, 0.012], STEEL));
    }
    parts
}
