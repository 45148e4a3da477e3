//! Close the lid of a box: carried over the top by its edge, it falls shut.

use super::builder::SceneBuilder;
use super::objects::cardboard_box::{Hinge, MOST, cardboard_box};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;
use core::f32::consts::FRAC_PI_8;
use glamx::{Pose3, Vec2, Vec3};

/// The task.
pub(super) fn close_box() -> Task {
    Task {
        name: "close_box".to_owned(),
        set: TaskSet::Two,
        goal: "close the box".to_owned(),
        variations: Vec::new(),
        keyframes: 5,
        placement: Placement {
            center: Vec2::new(-0.05, 0.06),
            half_range: Vec2::new(0.04, 0.05),
            max_yaw: FRAC_PI_8,
        },
        scenes: SceneSource::Drawn(build),
    }
}

const HINGE: Hinge = Hinge(Vec3::new(-0.025, -0.023, 0.149));
/// Motion at which the task is done, radians: the lid lies within a degree of shut.
const CLOSED: f32 = 2.6;
/// Opening at which the demonstrator lets go, radians.
const LET_GO: f32 = 62_f32.to_radians();

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let joint = cardboard_box(&mut scene, HINGE, MOST);
    scene.waypoint(HINGE.hold(MOST, 0.08), Gripper::Open, Approach::Free);
    scene.waypoint(HINGE.hold(MOST, 0.0), Gripper::Close, Approach::Linear);
    let (over, arc) = HINGE.arc(MOST, LET_GO);
    scene.waypoint(over, Gripper::Close, Approach::Through(arc));
    scene.waypoint(over, Gripper::Open, Approach::Linear);
    let back = Pose3::from_translation(Vec3::new(0.0, 0.056, 0.052)) * over;
    scene.waypoint(back, Gripper::Open, Approach::Linear);
    scene.finish(vec![Condition::JointMoved { joint, min: CLOSED }])
}
