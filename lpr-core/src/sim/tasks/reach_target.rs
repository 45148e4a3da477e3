//! Reach the ball of one colour among two others.

use super::builder::{SceneBuilder, grip_pose, target_and_distractors, words};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::{Part, Shape};
use crate::sim::scene::{BodyKind, Condition, Zone};
use glamx::{Pose3, Vec2, Vec3};
use rand::RngExt as _;

/// The task.
pub(super) fn reach_target() -> Task {
    Task {
        name: "reach_target".to_owned(),
        set: TaskSet::One,
        goal: "reach the {} target".to_owned(),
        variations: words(["red", "green", "blue", "yellow", "purple", "cyan", "white"]),
        keyframes: 1,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::ZERO, max_yaw: 0.0 },
        scenes: SceneSource::Drawn(build),
    }
}

const RADIUS: f32 = 0.025;
/// Targets are uniform in this box on the table: x, y, z side lengths.
const REGION: [f32; 3] = [0.5, 0.7, 0.5];
/// Least distance between two balls.
const MIN_DISTANCE: f32 = 0.2;

/// Colours of the variations; the distractors have two of the others.
const COLORS: [[u8; 3]; 7] = [
    [225, 30, 30],
    [40, 160, 60],
    [40, 80, 210],
    [230, 200, 40],
    [150, 60, 180],
    [40, 180, 190],
    [240, 240, 240],
];

fn build(variation: usize, rng: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let mut centers: Vec<Vec3> = Vec::new();
    while centers.len() < 3 {
        let center = Vec3::new(
            REGION[0] * (rng.random::<f32>() - 0.5),
            REGION[1] * (rng.random::<f32>() - 0.5),
            RADIUS + (REGION[2] - RADIUS) * rng.random::<f32>(),
        );
        if centers.iter().all(|other| other.distance(center) >= MIN_DISTANCE) {
            centers.push(center);
        }
    }
    let colours = target_and_distractors(&COLORS, variation, rng);
    for (name, (center, rgb)) in
        ["target", "distractor0", "distractor1"].into_iter().zip(centers.iter().zip(colours))
    {
        let ball = Part::new(Shape::Sphere { radius: RADIUS }, Pose3::IDENTITY, rgb);
        scene.body(name, BodyKind::Visual, *center, 0.0, vec![ball]);
    }
    let target = centers[0];
    scene.waypoint(
        grip_pose(target.to_array(), [180.0, 0.0, 180.0]),
        Gripper::Open,
        Approach::Free,
    );
    let zone = Zone::Cylinder { center: target, radius: 0.05, half_height: 0.04 };
    scene.finish(vec![Condition::GripInZone { zone }])
}
