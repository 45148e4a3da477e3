//! A run that is diagnosed: its last agents, and the demonstrations that it learned from.

use crate::cli::failure::Result;
use crate::cli::train::demonstrations;
use crate::files::FileError;
use crate::run_directory;
use lpr_core::agent::Agent;
use lpr_core::config::Config;
use lpr_core::demo::DemoEpisode;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::Task;
use std::path::Path;
use std::sync::Arc;

/// See the module.
pub(super) struct Run {
    pub(super) task: Arc<Task>,
    pub(super) cameras: Vec<String>,
    pub(super) config: Config,
    pub(super) seed: u64,
    /// Agents by their environment steps, the newest last; at least one.
    pub(super) snapshots: Vec<(u64, Agent)>,
    demonstration_scenes: Vec<u64>,
}

impl Run {
    pub(super) fn open(directory: &Path) -> Result<Self> {
        let mut saved = run_directory::latest_agents(directory)?;
        let header = saved[saved.len() - 1].1.header.clone();
        let task = Task::by_name(&header.run.task)
            .map_err(|error| FileError::content(directory, error.to_string()))?;
        let snapshots = saved.drain(..).map(|(step, saved)| (step, saved.agent)).collect();
        Ok(Self {
            task,
            cameras: header.run.cameras,
            config: header.config,
            seed: header.run.seed,
            snapshots,
            demonstration_scenes: run_directory::demonstration_scenes(directory)?,
        })
    }

    pub(super) fn agent(&self) -> &Agent {
        &self.snapshots[self.snapshots.len() - 1].1
    }

    pub(super) fn env_steps(&self) -> u64 {
        self.snapshots[self.snapshots.len() - 1].0
    }

    /// The demonstrations of the scripted demonstrator in the scenes that the run learned from, each
    /// from its first frame.
    pub(super) fn demonstrations(&self, environment: &SimEnvironment) -> Result<Vec<DemoEpisode>> {
        demonstrations::again(environment, &self.demonstration_scenes, &self.config.demos)
    }
}
