//! Put the bottle of wine on the rack.

use super::builder::{SceneBuilder, cuboid, cylinder_y, cylinder_z, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use glamx::{Pose3, Quat, Vec2, Vec3};

/// The task.
pub(super) fn stack_wine() -> Task {
    Task {
        name: "stack_wine".to_owned(),
        set: TaskSet::One,
        goal: "put the wine bottle on the rack".to_owned(),
        variations: Vec::new(),
        keyframes: 5,
        placement: Placement {
            center: Vec2::new(-0.08, -0.02),
            half_range: Vec2::new(0.05, 0.05),
            max_yaw: FRAC_PI_4,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Bottle: radius and length of its body and of its neck.
const BODY: [f32; 2] = [0.030, 0.18];
const NECK: [f32; 2] = [0.012, 0.073];
const MASS: f32 = 0.54;
const BOTTLE_AT: Vec3 = Vec3::new(0.099, -0.20, 0.0);
/// Height of the neck at which it is held.
const HOLD: f32 = 0.24;
/// Rack: rods along y on which a bottle lies, between two boards.
const ROD_RADIUS: f32 = 0.0064;
const ROD_LENGTH: f32 = 0.14;
const ROD_SPACING: f32 = 0.05;
const ROD_HEIGHT: f32 = 0.10;
const RACK_AT: Vec2 = Vec2::new(0.099, 0.20);
/// Middle of a bottle that lies on two rods, above their axes.
const LIES_ABOVE: f32 = 0.0265;

const GLASS: [u8; 3] = [38, 78, 52];
const FOIL: [u8; 3] = [150, 40, 50];
const WOOD: [u8; 3] = [172, 126, 82];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    scene.body("rack", BodyKind::Fixed, RACK_AT.extend(0.0), 0.0, rack_parts());
    let bottle =
        scene.graspable_body("bottle", Pose3::from_translation(BOTTLE_AT), MASS, bottle_parts());
    // The neck is held from the robot's side, the fingers left and right of it.
    let grasp = Pose3::from_parts(
        BOTTLE_AT + Vec3::Z * HOLD,
        grip_pose([0.0; 3], [0.0, 90.0, 0.0]).rotation,
    );
    let shifted = |by: Vec3| Pose3::from_translation(by) * grasp;
    scene.waypoint(shifted(Vec3::X * -0.06), Gripper::Open, Approach::Free);
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    scene.waypoint(shifted(Vec3::Z * 0.06), Gripper::Close, Approach::Linear);
    // The bottle lies with its bottom towards +y.
    let lying = Quat::from_rotation_x(FRAC_PI_2);
    let middle = RACK_AT.extend(ROD_HEIGHT + LIES_ABOVE);
    let neck = middle - Vec3::Y * (HOLD - 0.5 * BODY[1]);
    let placed = Pose3::from_parts(neck, lying * grasp.rotation);
    scene.waypoint(
        Pose3::from_translation(Vec3::Z * 0.06) * placed,
        Gripper::Close,
        Approach::Free,
    );
    scene.waypoint(
        Pose3::from_translation(Vec3::Z * 0.006) * placed,
        Gripper::Open,
        Approach::Linear,
    );
    let zone = Zone::Cuboid {
        pose: Pose3::from_translation(middle),
        half_extents: Vec3::new(0.03, 0.08, 0.03),
    };
    let point = Vec3::Z * 0.5 * BODY[1];
    scene.finish(vec![Condition::BodyInZone { body: bottle, point, zone }])
}

fn bottle_parts() -> Vec<Part> {
    vec![
        cylinder_z([0.0, 0.0, 0.5 * BODY[1]], BODY[0], BODY[1], GLASS),
        cylinder_z([0.0, 0.0, BODY[1] + 0.5 * NECK[1]], NECK[0], NECK[1], FOIL),
    ]
}

/// Four rods through two boards.
fn rack_parts() -> Vec<Part> {
    let half = 0.5 * ROD_LENGTH;
    let width = 3.0 * ROD_SPACING + 0.04;
    let mut parts: Vec<_> = (0..4)
        .map(|rod| {
            cylinder_y(
                [(rod as f32 - 1.5) * ROD_SPACING, 0.0, ROD_HEIGHT],
                ROD_RADIUS,
                ROD_LENGTH,
                WOOD,
            )
        })
        .collect();
    for y in [-half, half] {
        parts.push(cuboid([0.0, y, 0.5 * ROD_HEIGHT], [width, 0.01, ROD_HEIGHT], WOOD));
    }
    parts
}
