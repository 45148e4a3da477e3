//! Put the handset of a telephone on its base.

use super::builder::{SceneBuilder, cuboid, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::PI;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn phone_on_base() -> Task {
    Task {
        name: "phone_on_base".to_owned(),
        set: TaskSet::One,
        goal: "put the phone on the base".to_owned(),
        variations: Vec::new(),
        keyframes: 5,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::new(0.08, 0.10), max_yaw: PI },
        scenes: SceneSource::Drawn(build),
    }
}

/// Base: length x, depth y, height z; its recess lies along x at `RECESS_Y`.
const BASE: [f32; 3] = [0.282, 0.203, 0.05];
const RECESS_Y: f32 = 0.058;
/// Width of the recess. Published is 0.0675, two millimetres wider than the handset: no pose on a
/// grid of voxels finds that.
const RECESS: f32 = 0.082;
const RECESS_FLOOR: f32 = 0.02;
/// Handset: length, width, height of its two ends; width and height of the handle between them.
const HANDSET: [f32; 3] = [0.269, 0.065, 0.055];
const END_LENGTH: f32 = 0.06;
const HANDLE: [f32; 2] = [0.045, 0.04];
const HANDSET_AT: Vec2 = Vec2::new(0.0, 0.237);
const MASS: f32 = 0.271;
/// The handset's middle must come this close to its place along x, y and z, metres.
const NEAR: Vec3 = Vec3::new(0.075, 0.025, 0.03);

const BAKELITE: [u8; 3] = [52, 54, 60];
const HANDSET_RGB: [u8; 3] = [196, 52, 44];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let [length, depth, height] = BASE;
    let mut parts =
        vec![cuboid([0.0, 0.0, 0.5 * RECESS_FLOOR], [length, depth, RECESS_FLOOR], BAKELITE)];
    for [from, to] in
        [[-0.5 * depth, RECESS_Y - 0.5 * RECESS], [RECESS_Y + 0.5 * RECESS, 0.5 * depth]]
    {
        parts.push(cuboid(
            [0.0, 0.5 * (from + to), 0.5 * height],
            [length, to - from, height],
            BAKELITE,
        ));
    }
    scene.body("base", BodyKind::Fixed, Vec3::ZERO, 0.0, parts);
    let pose = Pose3::from_translation(HANDSET_AT.extend(0.5 * HANDSET[2]));
    let handset = scene.graspable_body("handset", pose, MASS, handset_parts());
    let down = |y: f32, height: f32| grip_pose([0.0, y, height], [180.0, 0.0, 0.0]);
    // Held by the handle; let go a centimetre above the recess' floor.
    let grasp = HANDSET[2] - 0.012;
    let released = grasp + RECESS_FLOOR + 0.008;
    scene.waypoint(down(HANDSET_AT.y, 0.12), Gripper::Open, Approach::Free);
    scene.waypoint(down(HANDSET_AT.y, grasp), Gripper::Close, Approach::Linear);
    scene.waypoint(down(HANDSET_AT.y, 0.16), Gripper::Close, Approach::Linear);
    scene.waypoint(down(RECESS_Y, 0.16), Gripper::Close, Approach::Linear);
    scene.waypoint(down(RECESS_Y, released), Gripper::Open, Approach::Linear);
    let place = Vec3::new(0.0, RECESS_Y, RECESS_FLOOR + 0.5 * HANDSET[2]);
    let zone = Zone::Cuboid { pose: Pose3::from_translation(place), half_extents: NEAR };
    scene.finish(vec![
        Condition::BodyInZone { body: handset, point: Vec3::ZERO, zone },
        Condition::NothingGrasped,
    ])
}

/// Two ends, and the handle flush with their upper sides.
fn handset_parts() -> Vec<Part> {
    let [length, width, height] = HANDSET;
    let [handle_width, handle_height] = HANDLE;
    let end = 0.5 * (length - END_LENGTH);
    vec![
        cuboid([end, 0.0, 0.0], [END_LENGTH, width, height], HANDSET_RGB),
        cuboid([-end, 0.0, 0.0], [END_LENGTH, width, height], HANDSET_RGB),
        cuboid(
            [0.0, 0.0, 0.5 * (height - handle_height)],
            [length - 2.0 * END_LENGTH, handle_width, handle_height],
            HANDSET_RGB,
        ),
    ]
}
