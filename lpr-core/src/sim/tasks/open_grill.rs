//! Open the lid of a grill: a hinge with friction, lifted by a bar in front of it.

use super::builder::{SceneBuilder, grip_pose};
use super::grill::{self, BAR};
use super::{Motion, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene_spec::Condition;

/// The task.
pub(super) static OPEN_GRILL: Task = Task {
    name: "open_grill",
    set: TaskSet::Two,
    goal: "open the grill",
    variations: &[],
    keyframes: 3,
    placement: grill::PLACEMENT,
    build,
};

/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = 50_f32.to_radians();
const DEMONSTRATED: f32 = 57_f32.to_radians();

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new(OPEN_GRILL.name);
    let joint = grill::grill(&mut scene, 0.0);
    let grasp = grip_pose(BAR, [-100.0, 0.0, -90.0]);
    let approach = grip_pose([BAR[0] - 0.04, BAR[1], BAR[2] + 0.01], [-100.0, 0.0, -90.0]);
    scene.waypoint(approach, Gripper::Open, Motion::Free);
    scene.waypoint(grasp, Gripper::Close, Motion::Linear);
    let (end, arc) = grill::arc(grasp, DEMONSTRATED);
    scene.waypoint(end, Gripper::Close, Motion::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}
