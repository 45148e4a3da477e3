//! Open one drawer of a chest: a free slide, pulled by a horizontal bar.

use super::builder::{SceneBuilder, grip_pose};
use super::chest::{self, HANDLE_Y, HANDLE_Z};
use super::{Motion, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene_spec::Condition;

/// The task.
pub(super) static OPEN_DRAWER: Task = Task {
    name: "open_drawer",
    set: TaskSet::Two,
    goal: "open the {} drawer",
    variations: &chest::DRAWERS,
    keyframes: 3,
    placement: chest::PLACEMENT,
    build,
};

/// Pull at which the task is done, metres.
const OPEN: f32 = 0.15;

fn build(variation: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new(OPEN_DRAWER.name);
    let slide = chest::chest(&mut scene, variation, 0.0);
    let z = HANDLE_Z[variation];
    scene.waypoint(grip_pose([0.0, 0.2825, z], [90.0, 0.0, 0.0]), Gripper::Open, Motion::Free);
    scene.waypoint(grip_pose([0.0, HANDLE_Y, z], [90.0, 0.0, 0.0]), Gripper::Close, Motion::Linear);
    scene.waypoint(grip_pose([0.0, 0.4325, z], [90.0, 0.0, 0.0]), Gripper::Close, Motion::Linear);
    scene.finish(vec![Condition::JointMoved { joint: slide, min: OPEN }])
}
