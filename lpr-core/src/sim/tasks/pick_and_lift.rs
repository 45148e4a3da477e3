//! Lift the cube of one colour among two others to a marker in the air.

use super::builder::{SceneBuilder, Spots, cuboid, grip_pose, target_and_distractors, words};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::{Part, Shape};
use crate::sim::scene::{BodyKind, Condition, Zone};
use core::f32::consts::FRAC_PI_4;
use glamx::{Pose3, Quat, Vec2, Vec3};
use rand::RngExt as _;

/// The task.
pub(super) fn pick_and_lift() -> Task {
    Task {
        name: "pick_and_lift".to_owned(),
        set: TaskSet::One,
        goal: "lift the {} cube up to the target".to_owned(),
        variations: words(["red", "green", "blue", "yellow", "purple", "cyan"]),
        keyframes: 4,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::ZERO, max_yaw: 0.0 },
        scenes: SceneSource::Drawn(build),
    }
}

const SIDE: f32 = 0.05;
const MASS: f32 = 0.125;
/// Cubes and marker stand in a rectangle of these sides, at least this far apart, metres.
const REGION: Vec2 = Vec2::new(0.43, 0.565);
const MIN_DISTANCE: f32 = 0.1;
const MARKER_RADIUS: f32 = 0.04;
const MARKER_HEIGHT: f32 = 0.231;
/// The cube's middle must come this close to the marker's, metres.
const REACH: f32 = 0.05;

const MARKER_RGB: [u8; 3] = [240, 170, 160];
/// Colours of the variations; the distractors have two of the others.
const COLORS: [[u8; 3]; 6] =
    [[215, 40, 36], [40, 160, 60], [40, 80, 210], [230, 200, 40], [150, 60, 180], [40, 180, 190]];

fn build(variation: usize, rng: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let mut spots = Spots::new(REGION, MIN_DISTANCE);
    let colours = target_and_distractors(&COLORS, variation, rng);
    let mut cubes = Vec::new();
    for (name, rgb) in ["cube", "distractor0", "distractor1"].into_iter().zip(colours) {
        // A quarter turn changes nothing but the hand's way there.
        let turn = Quat::from_rotation_z(FRAC_PI_4 * (2.0 * rng.random::<f32>() - 1.0));
        let pose = Pose3::from_parts(spots.draw(rng).extend(0.5 * SIDE), turn);
        cubes.push((
            scene.graspable_body(name, pose, MASS, vec![cuboid([0.0; 3], [SIDE; 3], rgb)]),
            pose,
        ));
    }
    let marker = spots.draw(rng).extend(MARKER_HEIGHT);
    let ball = Part::new(Shape::Sphere { radius: MARKER_RADIUS }, Pose3::IDENTITY, MARKER_RGB);
    scene.body("marker", BodyKind::Visual, marker, 0.0, vec![ball]);
    let (cube, pose) = cubes[0];
    let at = |height: f32| {
        pose * Pose3::from_translation(Vec3::Z * (height - 0.5 * SIDE))
            * grip_pose([0.0; 3], [180.0, 0.0, 0.0])
    };
    scene.waypoint(at(0.097), Gripper::Open, Approach::Free);
    scene.waypoint(at(0.026), Gripper::Close, Approach::Linear);
    scene.waypoint(at(0.097), Gripper::Close, Approach::Linear);
    let mut goal = at(0.0);
    goal.translation = marker;
    scene.waypoint(goal, Gripper::Close, Approach::Linear);
    let zone =
        Zone::Cuboid { pose: Pose3::from_translation(marker), half_extents: Vec3::splat(REACH) };
    scene.finish(vec![
        Condition::Grasped { body: cube },
        Condition::BodyInZone { body: cube, point: Vec3::ZERO, zone },
    ])
}
