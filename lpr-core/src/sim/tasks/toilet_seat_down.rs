//! Lower the seat of a toilet: pushed from behind until it falls.

use super::builder::{SceneBuilder, grip_pose};
use super::objects::toilet::{Hinge, toilet};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::Condition;
use core::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use glamx::{Pose3, Quat, Vec2, Vec3};

/// The task.
pub(super) fn toilet_seat_down() -> Task {
    Task {
        name: "toilet_seat_down".to_owned(),
        set: TaskSet::Two,
        goal: "put the toilet seat down".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(-0.06, -0.19),
            half_range: Vec2::new(0.04, 0.05),
            max_yaw: FRAC_PI_4,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// The seat leans back by ten degrees.
const HINGE: Hinge = Hinge { anchor: Vec3::new(-0.006, -0.034, 0.2365), start: 1.745, most: 1.745 };
/// Fall at which the task is done, radians: the seat lies within 0.045 of flat.
const FALLEN: f32 = 1.70;

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let hinge = toilet(&mut scene, &HINGE);
    // The gripper's narrow side faces the seat, which the published pose would stand in.
    let hand = |position, roll| {
        grip_pose(position, [roll, 0.0, 0.0])
            * Pose3::from_rotation(Quat::from_rotation_z(FRAC_PI_2))
    };
    scene.waypoint(hand([0.0, -0.130, 0.480], 180.0), Gripper::Close, Approach::Free);
    scene.waypoint(hand([0.0, -0.011, 0.466], 180.0), Gripper::Close, Approach::Linear);
    scene.waypoint(hand([0.0, 0.114, 0.413], 145.0), Gripper::Open, Approach::Linear);
    // Published is a fourth, which withdraws the hand: the seat has fallen before.
    scene.finish(vec![Condition::JointMoved { joint: hinge, min: FALLEN }])
}
