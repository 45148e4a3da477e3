//! Lift the seat of a toilet: a free hinge that only an arc about it moves.

use super::builder::{SceneBuilder, cuboid, cylinder_z, grip_pose};
use super::{Motion, Placement, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene_spec::{BodyKind, Condition, JointKind, JointSpec};
use core::f32::consts::FRAC_PI_4;
use glamx::{Pose3, Quat, Vec2, Vec3};

/// The task.
pub(super) static TOILET_SEAT_UP: Task = Task {
    name: "toilet_seat_up",
    set: TaskSet::Two,
    description: "lift the toilet seat up",
    keyframes: 3,
    placement: Placement { center: Vec2::new(-0.04, -0.06), half_range: Vec2::new(0.08, 0.15), max_yaw: FRAC_PI_4 },
    build,
};

/// A point of the hinge; its axis is x.
const HINGE: Vec3 = Vec3::new(-0.006, -0.059, 0.2365);
/// Seat slab: width, depth, thickness.
const SEAT: [f32; 3] = [0.225, 0.255, 0.011];
/// Height of the bowl's rim.
const BOWL_TOP: f32 = 0.22;
/// Opening at which the task is done, radians.
const OPEN: f32 = 1.40;
/// Opening at which the demonstrator stops: the published arc ends with the hand at a roll of 177 degrees.
const DEMONSTRATED: f32 = 87.0 / 180.0 * core::f32::consts::PI;
/// Poses of the demonstrated arc.
const ARC_POSES: usize = 12;

const PORCELAIN: [u8; 3] = [232, 234, 238];
const WATER: [u8; 3] = [140, 165, 185];
const SEAT_RGB: [u8; 3] = [60, 110, 170];

fn build(_: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new(TOILET_SEAT_UP.name);
    let bowl = scene.body(
        "toilet",
        BodyKind::Fixed,
        Vec3::ZERO,
        0.0,
        vec![
            cuboid([0.0, -0.02, 0.05], [0.14, 0.26, 0.10], PORCELAIN),
            cylinder_z([0.0, 0.05, 0.16], 0.11, 0.12, PORCELAIN),
            cuboid([0.0, -0.05, 0.16], [0.20, 0.18, 0.12], PORCELAIN),
            cuboid([0.0, -0.22, 0.20], [0.24, 0.12, 0.40], PORCELAIN),
        ],
    );
    scene.body("water", BodyKind::Visual, Vec3::new(0.0, 0.05, BOWL_TOP), 0.0, vec![cylinder_z([0.0; 3], 0.085, 0.001, WATER)]);
    let center = Vec3::new(0.0, 0.5 * SEAT[1], 0.0);
    let seat = scene.body("seat", BodyKind::Dynamic, HINGE, 0.178, vec![cuboid(center.to_array(), SEAT, SEAT_RGB)]);
    let hinge = scene.joint(JointSpec {
        name: "seat_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: bowl,
        child: seat,
        anchor: HINGE,
        axis: Vec3::X,
        limits: [0.0, 1.658],
        start: 0.0,
        brake: 0.0,
    });
    let grasp = grip_pose([0.0, 0.182, HINGE.z], [90.0, 0.0, 0.0]);
    scene.waypoint(grip_pose([0.0, 0.237, HINGE.z], [90.0, 0.0, 0.0]), Gripper::Open, Motion::Free);
    scene.waypoint(grasp, Gripper::Close, Motion::Linear);
    let mut arc: Vec<_> = (1..=ARC_POSES).map(|i| about_hinge(DEMONSTRATED * i as f32 / ARC_POSES as f32) * grasp).collect();
    let end = arc.pop().expect("the arc has poses");
    scene.waypoint(end, Gripper::Close, Motion::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint: hinge, min: OPEN }])
}

/// The motion of the seat by `angle` radians.
fn about_hinge(angle: f32) -> Pose3 {
    let turn = Pose3::from_rotation(Quat::from_rotation_x(angle));
    Pose3::from_translation(HINGE) * turn * Pose3::from_translation(-HINGE)
}
