//! `lpr replay`: runs the chosen paths of an episode file again in the scene that it holds.

use super::failure::Result;
use crate::episode::{EpisodeFile, Replayed};
use core::fmt;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// An episode: NAME.episode.json.gz
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    file: PathBuf,
    task: String,
    scene_seed: u64,
    steps: usize,
    /// Rewards and the world at the end are those of the file, bit by bit.
    identical: bool,
    world_hash: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let episode = EpisodeFile::read(&arguments.file)?;
    let Replayed { identical, world_hash } = episode.replay(|_, _| {})?;
    let (scene_seed, steps) = (episode.scene_seed, episode.steps.len());
    Ok(Report {
        file: arguments.file.clone(),
        task: episode.scene.task,
        scene_seed,
        steps,
        identical,
        world_hash,
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, task, scene_seed, steps, identical, world_hash } = self;
        writeln!(f, "{}: {task}, scene {scene_seed}, {steps} steps", file.display())?;
        writeln!(
            f,
            "{}: world {world_hash}",
            if *identical { "identical" } else { "not identical" }
        )
    }
}
