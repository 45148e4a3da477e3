//! Open the lid of a grill: a hinge with friction, lifted by a bar in front of it.

use super::builder::{SceneBuilder, grip_pose};
use super::objects::grill::{self, BAR};
use super::{Approach, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;

/// The task.
pub(super) fn open_grill() -> Task {
    Task {
        name: "open_grill".to_owned(),
        set: TaskSet::Two,
        goal: "open the grill".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: grill::PLACEMENT,
        scenes: SceneSource::Drawn(build),
    }
}

/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = 50_f32.to_radians();
const DEMONSTRATED: f32 = 57_f32.to_radians();

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let joint = grill::grill(&mut scene, 0.0);
    let grasp = grip_pose(BAR, [-100.0, 0.0, -90.0]);
    let approach = grip_pose([BAR[0] - 0.04, BAR[1], BAR[2] + 0.01], [-100.0, 0.0, -90.0]);
    scene.waypoint(approach, Gripper::Open, Approach::Free);
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    let (end, arc) = grill::arc(grasp, DEMONSTRATED);
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}
