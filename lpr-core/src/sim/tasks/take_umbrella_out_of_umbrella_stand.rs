//! Take the umbrella out of its stand by the crook.

use super::builder::{SceneBuilder, cuboid, cylinder_x, cylinder_z, grip_pose, tube};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::PI;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn take_umbrella_out_of_umbrella_stand() -> Task {
    Task {
        name: "take_umbrella_out_of_umbrella_stand".to_owned(),
        set: TaskSet::One,
        goal: "take the umbrella out of the umbrella stand".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::new(0.12, 0.22), max_yaw: PI },
        scenes: SceneSource::Drawn(build),
    }
}

/// Stand: outer radius and height; its walls.
const STAND_RADIUS: f32 = 0.0525;
const STAND_HEIGHT: f32 = 0.203;
const WALL: f32 = 0.006;
/// Height of the crook's top above the table.
const CROOK_TOP: f32 = 0.272;
/// Height of the umbrella's tip above the table.
const TIP: f32 = 0.012;
/// Radius of the rolled cloth: it stands upright in the stand.
const CLOTH_RADIUS: f32 = 0.04;
const MASS: f32 = 0.12;

const BRASS: [u8; 3] = [150, 120, 60];
const CLOTH: [u8; 3] = [40, 60, 130];
const CROOK: [u8; 3] = [110, 70, 40];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let mut stand = tube(STAND_RADIUS, WALL, STAND_HEIGHT, BRASS);
    stand.push(cylinder_z([0.0, 0.0, 0.5 * WALL], STAND_RADIUS, WALL, BRASS));
    scene.body("stand", BodyKind::Fixed, Vec3::ZERO, 0.0, stand);
    let pose = Pose3::from_translation(Vec3::Z * TIP);
    let umbrella = scene.graspable_body("umbrella", pose, MASS, umbrella_parts());
    // The crook's bar lies along x and is grasped from above.
    let grasp = [0.0, 0.0, CROOK_TOP - 0.012];
    let down = [180.0, 0.0, 0.0];
    scene.waypoint(grip_pose([0.0, 0.0, CROOK_TOP + 0.045], down), Gripper::Open, Approach::Free);
    scene.waypoint(grip_pose(grasp, down), Gripper::Close, Approach::Linear);
    scene.waypoint(grip_pose([0.0, 0.0, 0.482], down), Gripper::Close, Approach::Linear);
    let zone = Zone::Cuboid {
        pose: Pose3::from_translation(Vec3::Z * 0.08),
        half_extents: Vec3::new(0.04, 0.04, 0.12),
    };
    scene.finish(vec![Condition::BodyOutsideZone { body: umbrella, point: Vec3::Z * 0.05, zone }])
}

/// Cloth around the stick, the stick, and the crook: a bar across its top with an end that hangs
/// down.
fn umbrella_parts() -> Vec<Part> {
    let top = CROOK_TOP - TIP;
    vec![
        cylinder_z([0.0, 0.0, 0.09], CLOTH_RADIUS, 0.16, CLOTH),
        cylinder_z([0.0, 0.0, 0.5 * top], 0.006, top - 0.014, CROOK),
        cylinder_x([0.0, 0.0, top - 0.008], 0.008, 0.06, CROOK),
        cuboid([0.03, 0.0, top - 0.02], [0.014, 0.014, 0.026], CROOK),
    ]
}
