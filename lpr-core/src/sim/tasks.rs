//! The tasks: each one small file of data and plain functions.
//!
//! Geometry, limits, randomisation and success conditions are those published for `RLBench`'s tasks
//! of the same name; the scenes are our own, made of primitives. A task is built in its own frame
//! (origin on the table, z up) and then placed.

mod builder;
mod cardboard_box;
mod chest;
mod close_box;
mod close_drawer;
mod close_grill;
mod grill;
mod open_box;
mod open_dishwasher;
mod open_door;
mod open_drawer;
mod open_filing_cabinet;
mod open_grill;
mod open_microwave;
mod phone_on_base;
mod pick_and_lift;
mod pick_up_cup;
mod put_rubbish_in_bin;
mod reach_target;
mod slide_block_to_target;
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
    /// None of the two: further doors and slides, and the two tasks that the paper shows on the
    /// real arm.
    Extra,
}

/// A task.
#[derive(Debug)]
pub struct Task {
    /// Name on the command line.
    pub name: &'static str,
    /// Task set of the paper.
    pub set: TaskSet,
    /// The goal in a sentence, with `{}` where the variations differ; [`Task::describe`] fills it
    /// in.
    pub goal: &'static str,
    /// Names of the variations; none when there is only one.
    pub variations: &'static [&'static str],
    /// Keyframes of a demonstration.
    pub keyframes: usize,
    /// How the task is placed on the table.
    pub placement: Placement,
    /// Builds the scene of a variation (an index of `variations`, or 0) and the demonstrator's
    /// waypoints in the task frame.
    pub build: fn(usize, &mut Rng) -> TaskScene,
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
pub static TASKS: [&Task; 21] = [
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
    &open_microwave::OPEN_MICROWAVE,
    &open_door::OPEN_DOOR,
    &slide_block_to_target::SLIDE_BLOCK_TO_TARGET,
    &open_filing_cabinet::OPEN_FILING_CABINET,
    &open_dishwasher::OPEN_DISHWASHER,
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

    /// How many variations there are, from 1.
    #[must_use]
    pub fn n_variations(&self) -> usize {
        self.variations.len().max(1)
    }

    /// The goal of a variation in a sentence; of one that does not exist, that of all.
    #[must_use]
    pub fn describe(&self, variation: usize) -> String {
        self.goal.replace("{}", self.variations.get(variation).unwrap_or(&"…"))
    }

    /// Checks that there is such a variation.
    ///
    /// # Errors
    ///
    /// When there is none, naming the task and those that exist.
    pub fn check_variation(&self, variation: usize) -> Result<()> {
        let count = self.n_variations();
        if variation < count {
            return Ok(());
        }
        let known = if self.variations.is_empty() {
            "only 0".to_owned()
        } else {
            format!("0 to {}", count - 1)
        };
        Err(Error::Environment(format!(
            "task '{}' has no variation {variation}: {known}",
            self.name
        )))
    }
}
