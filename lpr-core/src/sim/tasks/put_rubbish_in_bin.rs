//! Put the rubbish, not a tomato, into the bin.

use super::builder::{SceneBuilder, ball, cuboid, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::PI;
use glamx::{Pose3, Vec2, Vec3};
use rand::RngExt as _;

/// The task.
pub(super) fn put_rubbish_in_bin() -> Task {
    Task {
        name: "put_rubbish_in_bin".to_owned(),
        set: TaskSet::One,
        goal: "put the rubbish in the bin".to_owned(),
        variations: Vec::new(),
        keyframes: 4,
        placement: Placement {
            center: Vec2::new(-0.05, 0.10),
            half_range: Vec2::new(0.06, 0.06),
            max_yaw: PI,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Bin: side and height; its walls; where it stands.
const BIN: [f32; 2] = [0.203, 0.19];
const WALL: f32 = 0.008;
const BIN_AT: Vec3 = Vec3::new(0.087, -0.280, 0.0);
/// Rubbish: length x, width y, height z; it is grasped across its width.
const RUBBISH: [f32; 3] = [0.087, 0.050, 0.034];
const RUBBISH_MASS: f32 = 0.42;
const TOMATO_RADIUS: f32 = 0.033;
/// Places of rubbish and tomatoes, in any order.
const SPOTS: [[f32; 2]; 3] = [[0.05, 0.10], [0.05, -0.04], [0.05, 0.25]];

const BIN_RGB: [u8; 3] = [70, 90, 120];
const PAPER: [u8; 3] = [222, 220, 205];
const TOMATO: [u8; 3] = [200, 45, 35];

fn build(_: usize, rng: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    scene.body("bin", BodyKind::Fixed, BIN_AT, 0.0, bin_parts());
    let mut spots = SPOTS;
    spots.swap(0, rng.random_range(0..3));
    spots.swap(1, rng.random_range(1..3));
    let [x, y] = spots[0];
    let pose = Pose3::from_translation(Vec3::new(x, y, 0.5 * RUBBISH[2]));
    let rubbish =
        scene.graspable_body("rubbish", pose, RUBBISH_MASS, vec![cuboid([0.0; 3], RUBBISH, PAPER)]);
    for (name, [x, y]) in [("tomato0", spots[1]), ("tomato1", spots[2])] {
        scene.body(
            name,
            BodyKind::Fixed,
            Vec3::new(x, y, TOMATO_RADIUS),
            0.0,
            vec![ball([0.0; 3], TOMATO_RADIUS, TOMATO)],
        );
    }
    let down = [180.0, 0.0, 0.0];
    scene.waypoint(grip_pose([x, y, 0.097], down), Gripper::Open, Approach::Free);
    scene.waypoint(grip_pose([x, y, 0.020], down), Gripper::Close, Approach::Linear);
    scene.waypoint(grip_pose([x, y, 0.251], down), Gripper::Close, Approach::Linear);
    scene.waypoint(grip_pose([BIN_AT.x, BIN_AT.y, 0.253], down), Gripper::Open, Approach::Free);
    let zone = Zone::Cylinder { center: BIN_AT + Vec3::Z * 0.04, radius: 0.09, half_height: 0.04 };
    scene.finish(vec![Condition::BodyInZone { body: rubbish, point: Vec3::ZERO, zone }])
}

/// Floor and four walls.
fn bin_parts() -> Vec<Part> {
    let [side, height] = BIN;
    let middle = 0.5 * (side - WALL);
    let mut parts = vec![cuboid([0.0, 0.0, 0.5 * WALL], [side, side, WALL], BIN_RGB)];
    for sign in [-1.0, 1.0] {
        parts.push(cuboid([sign * middle, 0.0, 0.5 * height], [WALL, side, height], BIN_RGB));
        parts.push(cuboid([0.0, sign * middle, 0.5 * height], [side, WALL, height], BIN_RGB));
    }
    parts
}
