//! The tasks: each one small file of data and plain functions.
//!
//! Geometry, limits, randomisation and success conditions are those published for `RLBench`'s tasks of the same name; the scenes
//! are our own, made of primitives. A task is built in its own frame (origin on the table, z up) and then placed.

mod builder;
mod cardboard_box;
mod chest;
mod close_box;
mod close_drawer;
mod close_grill;
mod grill;
mod open_box;
mod open_drawer;
mod open_grill;
mod phone_on_base;
mod pick_and_lift;
mod pick_up_cup;
mod put_rubbish_in_bin;
mod reach_target;
mod stack_wine;
mod take_lid_off_saucepan;
mod take_umbrella_out_of_umbrella_stand;
mod toilet;
mod toilet_seat_down;
mod toilet_seat_up;

use super::scene_spec::SceneSpec;
use crate::error::{Error, Result};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use glamx::{Pose3, Vec2};

/// Which of the paper's task sets a task belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TaskSet {
    /// Task Set 1: many motions will do.
    One,
    /// Task Set 2: particular motions are needed.
    Two,
}

/// A task.
#[derive(Debug)]
pub struct Task {
    /// Name on the command line.
    pub name: &'static str,
    /// Task set of the paper.
    pub set: TaskSet,
    /// The goal in a sentence.
    pub description: &'static str,
    /// Keyframes of a demonstration.
    pub keyframes: usize,
    /// How the task is placed on the table.
    pub placement: Placement,
    /// Builds the scene and the demonstrator's waypoints in the task frame.
    pub build: fn(&mut Rng) -> TaskScene,
}

/// Where a task frame may be on the table: origin and yaw are uniform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Centre of the origins' rectangle, from the robot's workspace centre, metres.
    pub center: Vec2,
    /// Half the sides of that rectangle, metres.
    pub half_range: Vec2,
    /// Yaw is within ± this, radians.
    pub max_yaw: f32,
}

/// A scene with the demonstrator's waypoints.
#[derive(Debug, Clone)]
pub struct TaskScene {
    /// The scene.
    pub spec: SceneSpec,
    /// What a demonstrator does, in order: one keyframe each.
    pub waypoints: Vec<Waypoint>,
}

/// One step of the demonstrator.
#[derive(Debug, Clone)]
pub struct Waypoint {
    /// Where the gripper goes and what it does there.
    pub goal: NextBestPose,
    /// How it gets there.
    pub motion: Motion,
}

/// How the demonstrator reaches a waypoint.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Any collision-free path.
    Free,
    /// A straight line of the grip.
    Linear,
    /// Through these poses of the grip to the goal.
    Through(Vec<Pose3>),
}

impl TaskScene {
    /// The same scene with its task frame at `world_from_task`.
    #[must_use]
    pub fn placed(mut self, world_from_task: &Pose3) -> Self {
        self.spec.place(world_from_task);
        for waypoint in &mut self.waypoints {
            waypoint.goal.pose = *world_from_task * waypoint.goal.pose;
            if let Motion::Through(poses) = &mut waypoint.motion {
                for pose in poses {
                    *pose = *world_from_task * *pose;
                }
            }
        }
        self
    }
}

/// Every task.
pub static TASKS: [&Task; 16] = [
    &reach_target::REACH_TARGET,
    &pick_and_lift::PICK_AND_LIFT,
    &pick_up_cup::PICK_UP_CUP,
    &put_rubbish_in_bin::PUT_RUBBISH_IN_BIN,
    &phone_on_base::PHONE_ON_BASE,
    &stack_wine::STACK_WINE,
    &take_lid_off_saucepan::TAKE_LID_OFF_SAUCEPAN,
    &take_umbrella_out_of_umbrella_stand::TAKE_UMBRELLA_OUT_OF_UMBRELLA_STAND,
    &open_drawer::OPEN_DRAWER,
    &toilet_seat_up::TOILET_SEAT_UP,
    &open_box::OPEN_BOX,
    &open_grill::OPEN_GRILL,
    &close_drawer::CLOSE_DRAWER,
    &close_box::CLOSE_BOX,
    &close_grill::CLOSE_GRILL,
    &toilet_seat_down::TOILET_SEAT_DOWN,
];

impl Task {
    /// The task of that name.
    ///
    /// # Errors
    ///
    /// When there is none, naming those that exist.
    pub fn by_name(name: &str) -> Result<&'static Self> {
        TASKS.into_iter().find(|task| task.name == name).ok_or_else(|| {
            let known: Vec<_> = TASKS.iter().map(|task| task.name).collect();
            Error::Environment(format!("unknown task '{name}', known: {}", known.join(", ")))
        })
    }
}
