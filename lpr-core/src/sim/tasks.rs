//! Tasks: each one small file of data and plain functions.
//!
//! Geometry, limits, randomisation and success conditions are those published for `RLBench`'s tasks
//! of the same name; the scenes are our own, made of primitives. A task is built in its own frame
//! (origin on the table, z up) and then placed.

mod builder;
mod close_box;
mod close_drawer;
mod close_grill;
mod objects;
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
mod toilet_seat_down;
mod toilet_seat_up;

use super::scene::SceneSpec;
use crate::check::one_of;
use crate::error::{Error, Result};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use glamx::{Pose3, Vec2};
use std::sync::{Arc, LazyLock};

/// Task sets of the paper.
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

/// A task: a value, so that it may come from elsewhere than this program.
#[derive(Debug, Clone)]
pub struct Task {
    /// Name on the command line.
    pub name: String,
    /// Task set of the paper.
    pub set: TaskSet,
    /// The goal in a sentence, with `{}` where the variations differ; [`Task::describe`] fills it
    /// in.
    pub goal: String,
    /// Names of the variations; none when there is only one.
    pub variations: Vec<String>,
    /// Keyframes of a demonstration.
    pub keyframes: usize,
    /// Places of the task on the table.
    pub placement: Placement,
    /// Makes the scenes, and the demonstrator's waypoints in them.
    pub scenes: SceneSource,
}

/// Source of a task's scenes; a scene's task is named by [`Task::scene`].
#[derive(Debug, Clone)]
pub enum SceneSource {
    /// A function draws the scene of a variation (an index of [`Task::variations`], or 0).
    Drawn(fn(usize, &mut Rng) -> TaskScene),
    /// Every episode has this scene, wherever it is placed.
    Fixed(TaskScene),
}

/// Range of the task frame on the table: origin and yaw are uniform.
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
    /// Steps of a demonstrator, in order: one keyframe each.
    pub waypoints: Vec<Waypoint>,
}

/// One step of the demonstrator.
#[derive(Debug, Clone)]
pub struct Waypoint {
    /// The pose that the gripper goes to and its command there.
    pub goal: NextBestPose,
    /// The way to the pose.
    pub approach: Approach,
}

/// The demonstrator's way to a waypoint.
#[derive(Debug, Clone, PartialEq)]
pub enum Approach {
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
            if let Approach::Through(poses) = &mut waypoint.approach {
                for pose in poses {
                    *pose = *world_from_task * *pose;
                }
            }
        }
        self
    }
}

/// Every task of this program.
pub static TASKS: LazyLock<[Arc<Task>; 21]> = LazyLock::new(|| built_in().map(Arc::new));

fn built_in() -> [Task; 21] {
    [
        reach_target::reach_target(),
        pick_and_lift::pick_and_lift(),
        pick_up_cup::pick_up_cup(),
        put_rubbish_in_bin::put_rubbish_in_bin(),
        phone_on_base::phone_on_base(),
        stack_wine::stack_wine(),
        take_lid_off_saucepan::take_lid_off_saucepan(),
        take_umbrella_out_of_umbrella_stand::take_umbrella_out_of_umbrella_stand(),
        open_drawer::open_drawer(),
        toilet_seat_up::toilet_seat_up(),
        open_box::open_box(),
        open_grill::open_grill(),
        close_drawer::close_drawer(),
        close_box::close_box(),
        close_grill::close_grill(),
        toilet_seat_down::toilet_seat_down(),
        open_microwave::open_microwave(),
        open_door::open_door(),
        slide_block_to_target::slide_block_to_target(),
        open_filing_cabinet::open_filing_cabinet(),
        open_dishwasher::open_dishwasher(),
    ]
}

impl Task {
    /// The task of that name among [`TASKS`].
    ///
    /// # Errors
    ///
    /// When there is none, naming those that exist.
    pub fn by_name(name: &str) -> Result<Arc<Self>> {
        TASKS.iter().find(|task| task.name == name).cloned().ok_or_else(|| {
            let known = TASKS.iter().map(|task| task.name.as_str());
            Error::Environment(format!("task: {}", one_of(known, name)))
        })
    }

    /// The scene of a variation in the task frame; `rng` gives what differs between episodes.
    #[must_use]
    pub fn scene(&self, variation: usize, rng: &mut Rng) -> TaskScene {
        let mut scene = match &self.scenes {
            SceneSource::Drawn(draw) => draw(variation, rng),
            SceneSource::Fixed(scene) => scene.clone(),
        };
        scene.spec.task.clone_from(&self.name);
        scene
    }

    /// Number of variations, from 1.
    #[must_use]
    pub fn n_variations(&self) -> usize {
        self.variations.len().max(1)
    }

    /// The goal of a variation in a sentence; of one that does not exist, that of all.
    #[must_use]
    pub fn describe(&self, variation: usize) -> String {
        self.goal.replace("{}", self.variations.get(variation).map_or("…", String::as_str))
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
