//! Slide a block to a target on the table: pushed, never held.

use super::builder::{SceneBuilder, cuboid, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::PI;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn slide_block_to_target() -> Task {
    Task {
        name: "slide_block_to_target".to_owned(),
        set: TaskSet::Extra,
        goal: "slide the block to the target".to_owned(),
        variations: Vec::new(),
        keyframes: 2,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::new(0.10, 0.15), max_yaw: PI },
        scenes: SceneSource::Drawn(build),
    }
}

/// Side of the block and of the square that it belongs on.
const SIDE: f32 = 0.0563;
const TARGET: f32 = 0.10;
const MASS: f32 = 0.356;
const BLOCK_AT: [f32; 2] = [0.025, -0.025];
const TARGET_AT: [f32; 2] = [0.025, 0.15];
/// The block has to touch a cube of this side in the middle of the target.
const SENSOR: f32 = 0.01;
/// Half the depth of the pushing hand, fingers closed: how far its pads' edge is from the grip,
/// metres.
const HAND: f32 = 0.011;

const BLOCK_RGB: [u8; 3] = [200, 60, 50];
const TARGET_RGB: [u8; 3] = [70, 150, 90];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let [x, y] = TARGET_AT;
    let square = vec![cuboid([0.0; 3], [TARGET, TARGET, 0.001], TARGET_RGB)];
    scene.body("target", BodyKind::Visual, Vec3::new(x, y, 0.0005), 0.0, square);
    let [block_x, block_y] = BLOCK_AT;
    let cube = vec![cuboid([0.0; 3], [SIDE; 3], BLOCK_RGB)];
    let block =
        scene.body("block", BodyKind::Dynamic, Vec3::new(block_x, block_y, 0.5 * SIDE), MASS, cube);
    // The broad side of the closed fingers pushes.
    let hand = [180.0, 0.0, -90.0];
    scene.waypoint(
        grip_pose([block_x, block_y - 0.102, 0.027], hand),
        Gripper::Close,
        Approach::Free,
    );
    scene.waypoint(
        grip_pose([x, y - 0.5 * SIDE - HAND, 0.027], hand),
        Gripper::Close,
        Approach::Linear,
    );
    let half_extents = Vec3::new(0.5 * (SIDE + SENSOR), 0.5 * (SIDE + SENSOR), SIDE);
    let zone = Zone::Cuboid { pose: Pose3::from_translation(Vec3::new(x, y, 0.0)), half_extents };
    scene.finish(vec![Condition::BodyInZone { body: block, point: Vec3::ZERO, zone }])
}
