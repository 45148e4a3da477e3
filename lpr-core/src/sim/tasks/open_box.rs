//! Open the lid of a box: a free hinge, lifted by the lid's edge.

use super::builder::SceneBuilder;
use super::objects::cardboard_box::{Hinge, cardboard_box};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;
use core::f32::consts::{FRAC_PI_2, FRAC_PI_8};
use glamx::{Vec2, Vec3};

/// The task.
pub(super) fn open_box() -> Task {
    Task {
        name: "open_box".to_owned(),
        set: TaskSet::Two,
        goal: "open the box".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(0.0, 0.11),
            half_range: Vec2::new(0.06, 0.08),
            max_yaw: FRAC_PI_8,
        },
        scenes: SceneSource::Drawn(build),
    }
}

const HINGE: Hinge = Hinge(Vec3::new(-0.025, -0.273, 0.149));
/// Opening at which the task is done, and at which the demonstrator stops, radians.
const OPEN: f32 = FRAC_PI_2;
const DEMONSTRATED: f32 = 100_f32.to_radians();

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let joint = cardboard_box(&mut scene, HINGE, 0.0);
    scene.waypoint(HINGE.hold(0.0, 0.067), Gripper::Open, Approach::Free);
    scene.waypoint(HINGE.hold(0.0, 0.0), Gripper::Close, Approach::Linear);
    let (end, arc) = HINGE.arc(0.0, DEMONSTRATED);
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}
