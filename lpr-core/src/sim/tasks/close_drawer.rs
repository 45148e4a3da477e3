//! Push one drawer of a chest shut.

use super::builder::{SceneBuilder, grip_pose, words};
use super::objects::chest::{self, HANDLE_Y, HANDLE_Z};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;
use core::f32::consts::FRAC_PI_8;
use glamx::Vec2;

/// The task.
pub(super) fn close_drawer() -> Task {
    Task {
        name: "close_drawer".to_owned(),
        set: TaskSet::Two,
        goal: "push the {} drawer shut".to_owned(),
        variations: words(chest::DRAWERS),
        keyframes: 2,
        // Farther off than the drawer that is opened: the arm comes from the front of one that
        // stands open.
        placement: Placement {
            center: Vec2::new(0.05, -0.40),
            half_range: Vec2::new(0.08, 0.06),
            max_yaw: FRAC_PI_8,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Opening of the drawer at the start, metres.
const PULLED: f32 = 0.10;
/// Push at which the task is done, metres.
const PUSHED: f32 = 0.06;
/// Distance that the demonstrator's grip goes beyond where the handle was, metres: the fingers
/// reach a centimetre farther. At the published end the drawer would be pressed against its frame.
const SHORT_OF_END: f32 = 0.06;

fn build(variation: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let slide = chest::chest(&mut scene, variation, PULLED);
    let z = HANDLE_Z[variation];
    scene.waypoint(
        grip_pose([0.0, HANDLE_Y + PULLED + 0.0425, z], [90.0, 0.0, 0.0]),
        Gripper::Close,
        Approach::Free,
    );
    scene.waypoint(
        grip_pose([0.0, HANDLE_Y + PULLED - SHORT_OF_END, z], [90.0, 0.0, 0.0]),
        Gripper::Close,
        Approach::Linear,
    );
    scene.finish(vec![Condition::JointMoved { joint: slide, min: PUSHED }])
}
