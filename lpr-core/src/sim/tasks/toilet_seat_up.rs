//! Lift the seat of a toilet: a free hinge that only an arc about it moves.

use super::builder::{SceneBuilder, arc_about, grip_pose};
use super::objects::toilet::{Hinge, toilet};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;
use core::f32::consts::FRAC_PI_4;
use glamx::{Vec2, Vec3};

/// The task.
pub(super) fn toilet_seat_up() -> Task {
    Task {
        name: "toilet_seat_up".to_owned(),
        set: TaskSet::Two,
        goal: "lift the toilet seat up".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(-0.04, -0.06),
            half_range: Vec2::new(0.08, 0.15),
            max_yaw: FRAC_PI_4,
        },
        scenes: SceneSource::Drawn(build),
    }
}

const HINGE: Hinge = Hinge { anchor: Vec3::new(-0.006, -0.059, 0.2365), start: 0.0, most: 1.658 };
/// Opening at which the task is done, radians.
const OPEN: f32 = 1.40;
/// Opening at which the demonstrator stops: the published arc ends with the hand at a roll of 177
/// degrees.
const DEMONSTRATED: f32 = 87.0 / 180.0 * core::f32::consts::PI;

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let hinge = toilet(&mut scene, &HINGE);
    let height = HINGE.anchor.z;
    let grasp = grip_pose([0.0, 0.182, height], [90.0, 0.0, 0.0]);
    scene.waypoint(
        grip_pose([0.0, 0.237, height], [90.0, 0.0, 0.0]),
        Gripper::Open,
        Approach::Free,
    );
    scene.waypoint(grasp, Gripper::Close, Approach::Linear);
    let (end, arc) = arc_about(grasp, |share| HINGE.turn(share * DEMONSTRATED));
    scene.waypoint(end, Gripper::Close, Approach::Through(arc));
    scene.finish(vec![Condition::JointMoved { joint: hinge, min: OPEN }])
}
