//! The directory of a training run: configuration, metrics, checkpoints and summary.

use crate::files::{self, FileError};
use lpr_core::Error;
use lpr_core::checkpoint::{Checkpoint, SavedAgent, load_agent};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::{fs, io};

const CHECKPOINTS: &str = "checkpoints";
const EPISODES: &str = "episodes";
const WEIGHTS: &str = "weights.safetensors";
const STATE: &str = "state.bin";
const CONFIG: &str = "config.toml";
/// Name of the file that a run leaves when it has ended.
pub const SUMMARY: &str = "summary.json";
/// What training goes on from is deleted of older checkpoints: this many keep it.
const KEPT_STATES: usize = 2;
/// Older checkpoints are deleted: the weights of this many stay.
const KEPT_CHECKPOINTS: usize = 5;

type Result<T, E = FileError> = core::result::Result<T, E>;

/// Starts a run in `directory`, which must be empty or absent.
///
/// # Errors
///
/// When it is not empty or cannot be written.
pub fn create(directory: &Path, config_toml: &str) -> Result<()> {
    files::create_output_directory(directory)?;
    let checkpoints = directory.join(CHECKPOINTS);
    fs::create_dir_all(&checkpoints).map_err(FileError::io("create", &checkpoints))?;
    files::write_atomically(&directory.join(CONFIG), |file| file.write_all(config_toml.as_bytes()))
}

/// Path of a checkpoint's episode; its directory exists then.
///
/// # Errors
///
/// When the directory cannot be created.
pub fn episode_path(directory: &Path, env_step: u64) -> Result<PathBuf> {
    in_episodes(directory, &format!("{env_step:08}.episode.json.gz"))
}

/// Path of the animation of a checkpoint's episode; its directory exists then.
///
/// # Errors
///
/// When the directory cannot be created.
pub fn animation_path(directory: &Path, env_step: u64) -> Result<PathBuf> {
    in_episodes(directory, &format!("{env_step:08}.gif"))
}

fn in_episodes(directory: &Path, name: &str) -> Result<PathBuf> {
    let episodes = directory.join(EPISODES);
    fs::create_dir_all(&episodes).map_err(FileError::io("create", &episodes))?;
    Ok(episodes.join(name))
}

/// Saves a checkpoint, whole or not at all, and deletes old ones. It takes the place of another of
/// the same environment step: a run may be interrupted between updates on demonstrations, which are
/// no environment steps.
///
/// # Errors
///
/// When the directory cannot be written; older checkpoints are then still there.
pub fn save(directory: &Path, env_step: u64, checkpoint: &Checkpoint) -> Result<()> {
    let path = checkpoint_path(directory, env_step);
    if path.exists() {
        let state = path.join(STATE);
        if fs::read(&state).map_err(FileError::io("read", &state))? == checkpoint.state {
            return Ok(());
        }
        set_aside(directory, &path)?;
    }
    files::write_directory_atomically(&path, |inside| {
        files::write_atomically(&inside.join(WEIGHTS), |file| file.write_all(&checkpoint.weights))?;
        files::write_atomically(&inside.join(STATE), |file| file.write_all(&checkpoint.state))
    })?;
    let steps = checkpoint_steps(directory)?;
    for (age, old) in steps.iter().rev().enumerate().skip(KEPT_STATES) {
        let old = checkpoint_path(directory, *old);
        let state = old.join(STATE);
        if age >= KEPT_CHECKPOINTS {
            fs::remove_dir_all(&old).map_err(FileError::io("delete", &old))?;
        } else if state.exists() {
            fs::remove_file(&state).map_err(FileError::io("delete", &state))?;
        }
    }
    Ok(())
}

/// Removes a checkpoint that another one replaces, all at once.
fn set_aside(directory: &Path, checkpoint: &Path) -> Result<()> {
    let outdated = directory.join(CHECKPOINTS).join(format!(".outdated{}", files::PARTIAL));
    fs::rename(checkpoint, &outdated).map_err(FileError::io("replace", checkpoint))?;
    fs::remove_dir_all(&outdated).map_err(FileError::io("delete", &outdated))
}

/// Removes what a killed run left unfinished.
///
/// # Errors
///
/// When it cannot be removed.
pub fn clean(directory: &Path) -> Result<()> {
    files::remove_partial(directory)?;
    files::remove_partial(&directory.join(CHECKPOINTS))
}

/// Environment step of the newest checkpoint, if there is one.
///
/// # Errors
///
/// When the directory cannot be looked into.
pub fn latest_step(directory: &Path) -> Result<Option<u64>> {
    Ok(checkpoint_steps(directory)?.pop())
}

/// The newest checkpoint of a run with its environment step.
///
/// # Errors
///
/// When there is none, or when it cannot be read.
pub fn latest(directory: &Path) -> Result<(u64, Checkpoint)> {
    let Some(step) = latest_step(directory)? else {
        return Err(FileError::content(
            directory,
            "holds no checkpoint: not a run directory, or a run that had not saved yet",
        ));
    };
    let path = checkpoint_path(directory, step);
    let read = |name: &str| {
        let file = path.join(name);
        fs::read(&file).map_err(FileError::io("read", &file))
    };
    Ok((step, Checkpoint { weights: read(WEIGHTS)?, state: read(STATE)? }))
}

/// The agent of a run's newest checkpoint.
///
/// # Errors
///
/// When there is none, or when it cannot be read: the message names the file.
pub fn latest_agent(directory: &Path) -> Result<SavedAgent> {
    let (step, checkpoint) = latest(directory)?;
    load_agent(&checkpoint.weights).map_err(|error| unusable(directory, step, &error))
}

/// The agents of all checkpoints of a run that are still there, by their environment steps; the
/// newest last, and at least one.
///
/// # Errors
///
/// When there is none, or when one cannot be read: the message names the file.
pub fn latest_agents(directory: &Path) -> Result<Vec<(u64, SavedAgent)>> {
    let newest = latest_agent(directory)?;
    let mut steps = checkpoint_steps(directory)?;
    let last = steps.pop().unwrap_or_default();
    let mut agents = Vec::new();
    for step in steps {
        let file = checkpoint_path(directory, step).join(WEIGHTS);
        let weights = fs::read(&file).map_err(FileError::io("read", &file))?;
        let saved = load_agent(&weights).map_err(|error| unusable(directory, step, &error))?;
        agents.push((step, saved));
    }
    agents.push((last, newest));
    Ok(agents)
}

/// Scene seeds of the demonstrations that a run learned from, as its `config.toml` lists them.
///
/// # Errors
///
/// When the file cannot be read, or lists none.
pub fn demonstration_scenes(directory: &Path) -> Result<Vec<u64>> {
    #[derive(Deserialize)]
    struct File {
        run: RunTable,
    }
    #[derive(Deserialize)]
    struct RunTable {
        demonstrations: Vec<u64>,
    }
    let path = directory.join(CONFIG);
    let text = fs::read_to_string(&path).map_err(FileError::io("read", &path))?;
    let file: File =
        toml::from_str(&text).map_err(|error| FileError::content(&path, error.message()))?;
    Ok(file.run.demonstrations)
}

/// The fault of the checkpoint of `env_step`, with the file that has it.
#[must_use]
pub fn unusable(directory: &Path, env_step: u64, error: &Error) -> FileError {
    let checkpoint = checkpoint_path(directory, env_step);
    let Error::Checkpoint(reason) = error else {
        return FileError::content(&checkpoint, error.to_string());
    };
    let of_file = |part: &str, file: &str| {
        Some(FileError::content(&checkpoint.join(file), reason.strip_prefix(part)?))
    };
    let of_one = of_file("weights: ", WEIGHTS).or_else(|| of_file("state: ", STATE));
    of_one.unwrap_or_else(|| FileError::content(&checkpoint, reason.as_str()))
}

/// Writes `summary.json`.
///
/// # Errors
///
/// When it cannot be written.
pub fn write_summary(directory: &Path, summary: &impl Serialize) -> Result<()> {
    files::write_json(&directory.join(SUMMARY), summary)
}

fn checkpoint_path(directory: &Path, env_step: u64) -> PathBuf {
    directory.join(CHECKPOINTS).join(format!("{env_step:08}"))
}

/// Environment steps of the checkpoints, ascending.
fn checkpoint_steps(directory: &Path) -> Result<Vec<u64>> {
    let checkpoints = directory.join(CHECKPOINTS);
    let entries = match fs::read_dir(&checkpoints) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(FileError::io("read", &checkpoints))?,
    };
    let mut steps: Vec<u64> =
        entries.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok()).collect();
    steps.sort_unstable();
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_takes_the_place_of_another_of_its_step() {
        let run = tempfile::tempdir().unwrap();
        create(run.path(), "").unwrap();
        let early = Checkpoint { weights: vec![1], state: vec![1] };
        let late = Checkpoint { weights: vec![2], state: vec![2, 3] };
        for checkpoint in [&early, &late, &late] {
            save(run.path(), 0, checkpoint).unwrap();
            assert_eq!(latest(run.path()).unwrap(), (0, checkpoint.clone()));
        }
        assert_eq!(fs::read_dir(run.path().join(CHECKPOINTS)).unwrap().count(), 1);
    }
}
