//! Open one drawer of a chest: a free slide, pulled by a horizontal bar.

use super::builder::{SceneBuilder, grip_pose, words};
use super::objects::chest::{self, HANDLE_Y, HANDLE_Z};
use super::{Approach, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;

/// The task.
pub(super) fn open_drawer() -> Task {
    Task {
        name: "open_drawer".to_owned(),
        set: TaskSet::Two,
        goal: "open the {} drawer".to_owned(),
        variations: words(chest::DRAWERS),
        keyframes: 3,
        placement: chest::PLACEMENT,
        scenes: SceneSource::Drawn(build),
    }
}

/// Pull at which the task is done, metres.
const OPEN: f32 = 0.15;

fn build(variation: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let slide = chest::chest(&mut scene, variation, 0.0);
    let z = HANDLE_Z[variation];
    scene.waypoint(grip_pose([0.0, 0.2825, z], [90.0, 0.0, 0.0]), Gripper::Open, Approach::Free);
    scene.waypoint(
        grip_pose([0.0, HANDLE_Y, z], [90.0, 0.0, 0.0]),
        Gripper::Close,
        Approach::Linear,
    );
    scene.waypoint(grip_pose([0.0, 0.4325, z], [90.0, 0.0, 0.0]), Gripper::Close, Approach::Linear);
    scene.finish(vec![Condition::JointMoved { joint: slide, min: OPEN }])
}
