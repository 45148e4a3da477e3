//! Arguments that several commands share.

use super::failure::{Failure, Result};
use clap::Args;
use core::ops::Range;
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::tasks::Task;
use std::sync::Arc;

/// The option that chooses the arm.
#[derive(Debug, Clone, Args)]
pub(super) struct RobotArgument {
    /// The arm: xarm7 or panda
    #[arg(long, value_name = "NAME", value_parser = Robot::by_name, default_value = &*ROBOTS[0].name)]
    pub(super) robot: Arc<Robot>,
}

/// The argument that chooses the task.
#[derive(Debug, Clone, Args)]
pub(super) struct TaskArgument {
    /// The task, one of `lpr tasks`
    #[arg(value_name = "TASK", value_parser = Task::by_name)]
    pub(super) task: Arc<Task>,
}

/// The scenes of `episodes` episodes from `seed` on.
pub(super) fn scene_seeds(seed: u64, episodes: u32) -> impl Iterator<Item = u64> {
    (0..u64::from(episodes)).map(move |episode| seed.wrapping_add(episode))
}

/// Scene seeds that stopping and tuning look at.
pub(super) const VALIDATION_SEEDS: u64 = 1000;

/// The seeds of `n` scenes from `seed` on.
pub(super) fn seed_range(seed: u64, n: u64) -> Result<Range<u64>> {
    let end = seed.checked_add(n);
    let too_large =
        || Failure::Usage(format!("--seed {seed}: leaves no {n} scene seeds below 2^64"));
    Ok(seed..end.ok_or_else(too_large)?)
}
