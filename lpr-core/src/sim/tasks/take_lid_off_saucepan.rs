//! Take the lid off a saucepan by its knob.

use super::builder::{SceneBuilder, cuboid, cylinder_z, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::PI;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn take_lid_off_saucepan() -> Task {
    Task {
        name: "take_lid_off_saucepan".to_owned(),
        set: TaskSet::One,
        goal: "take the lid off the saucepan".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::new(0.14, 0.28), max_yaw: PI },
        scenes: SceneSource::Drawn(build),
    }
}

const PAN_RADIUS: f32 = 0.1145;
/// Height of the pan's rim, where the lid's disc lies.
const RIM: f32 = 0.073;
const LID_THICKNESS: f32 = 0.018;
const KNOB_RADIUS: f32 = 0.03;
const KNOB_HEIGHT: f32 = 0.02;
/// Gap between bodies that rest on each other at the start.
const GAP: f32 = 0.0005;

const STEEL: [u8; 3] = [150, 155, 165];
const BLACK: [u8; 3] = [45, 45, 50];
const LID_RGB: [u8; 3] = [190, 60, 50];
const KNOB_RGB: [u8; 3] = [235, 200, 70];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    scene.body(
        "saucepan",
        BodyKind::Fixed,
        Vec3::ZERO,
        0.0,
        vec![
            cylinder_z([0.0, 0.0, 0.5 * RIM], PAN_RADIUS, RIM, STEEL),
            cuboid([0.215, 0.0, 0.055], [0.21, 0.028, 0.016], BLACK),
        ],
    );
    let disc = RIM + GAP + 0.5 * LID_THICKNESS;
    let knob = 0.5 * (LID_THICKNESS + KNOB_HEIGHT);
    let lid = scene.body(
        "lid",
        BodyKind::Graspable,
        Vec3::new(0.0, 0.0, disc),
        0.057,
        vec![
            cylinder_z([0.0; 3], 0.115, LID_THICKNESS, LID_RGB),
            cylinder_z([0.0, 0.0, knob], KNOB_RADIUS, KNOB_HEIGHT, KNOB_RGB),
        ],
    );
    let inside = Vec3::new(0.0, 0.0, RIM + 0.5 * GAP);
    scene.body(
        "inside",
        BodyKind::Visual,
        inside,
        0.0,
        vec![cylinder_z([0.0; 3], PAN_RADIUS - 0.004, 0.5 * GAP, BLACK)],
    );
    // The pads' lower edge stays above the lid.
    let down = [180.0, 0.0, 0.0];
    scene.waypoint(grip_pose([0.0, 0.0, 0.152], down), Gripper::Open, Approach::Free);
    scene.waypoint(grip_pose([0.0, 0.0, 0.104], down), Gripper::Close, Approach::Linear);
    scene.waypoint(grip_pose([0.0, 0.0, 0.222], down), Gripper::Close, Approach::Linear);
    let zone = Zone::Cuboid {
        pose: Pose3::from_translation(Vec3::new(0.0, 0.0, 0.216)),
        half_extents: Vec3::new(0.05, 0.05, 0.025),
    };
    let point = Vec3::new(0.0, 0.0, knob);
    scene.finish(vec![
        Condition::Grasped { body: lid },
        Condition::BodyInZone { body: lid, point, zone },
    ])
}
