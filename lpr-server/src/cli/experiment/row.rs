//! A row of an experiment: one run and what was found of it, in a file of its own.

use crate::files::{self, FileError};
use lpr_core::agent::PoseSource;
use lpr_core::config::Config;
use lpr_core::{SOURCE_DIGEST, digest};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// What decides a row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Key {
    pub(super) task: String,
    pub(super) method: String,
    pub(super) poses: PoseSource,
    #[serde(default = "first_robot")]
    pub(super) robot: String,
    /// Its name, or that of its file.
    #[serde(default = "default_preset")]
    pub(super) preset: String,
    #[serde(default = "ten")]
    pub(super) demonstrations: usize,
    pub(super) seed: u64,
    /// None of them: a method without weights.
    pub(super) env_steps: u64,
    /// Of every setting, the scenes that are looked at and the program: its sources and the
    /// versions of its dependencies.
    pub(super) digest: String,
}

/// What rows are of that were written when there was no choice, and what pages leave unsaid.
pub(super) const ROBOT: &str = "xarm7";
pub(super) const PRESET: &str = "fast";
pub(super) const DEMONSTRATIONS: usize = 10;

fn first_robot() -> String {
    ROBOT.to_owned()
}

fn default_preset() -> String {
    PRESET.to_owned()
}

const fn ten() -> usize {
    DEMONSTRATIONS
}

impl Key {
    /// The digest of a row with these settings, in the diagnosis of which there are `scenes`.
    pub(super) fn digest(config: &Config, scenes: u64) -> String {
        let decides = format!("{SOURCE_DIGEST} {scenes} {}", config.to_toml());
        format!("{:016x}", digest::of(decides.as_bytes()))
    }

    /// Name of its file and of its run's directory.
    pub(super) fn name(&self) -> String {
        let Self { task, method, seed, env_steps, digest, poses, robot, .. } = self;
        let poses = match poses {
            PoseSource::Learned => "",
            PoseSource::Oracle => "-oracle",
        };
        let robot = if robot == ROBOT { String::new() } else { format!("-{robot}") };
        format!("{task}-{method}{poses}{robot}-{seed}-{env_steps}-{}", &digest[..8])
    }
}

/// See the module.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Row {
    #[serde(flatten)]
    pub(super) key: Key,
    /// The checkout's, for people.
    pub(super) commit: String,
    /// The run's `summary.json`; nothing of a method without weights.
    #[serde(default)]
    pub(super) training: Value,
    /// The report of `lpr eval`, where there is no training.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub(super) evaluation: Value,
    /// The report of `lpr diagnose`, of a method that ranks.
    #[serde(default)]
    pub(super) diagnosis: Value,
}

impl Row {
    /// The report of its test scenes.
    pub(super) fn eval(&self) -> &Value {
        if self.training.is_null() { &self.evaluation } else { &self.training["eval"] }
    }

    /// Success in each of the test scenes; none in rows of before scenes were told.
    pub(super) fn outcomes(&self) -> Option<Vec<f64>> {
        let eval = self.eval();
        let first = eval["first_scene"].as_u64()?;
        let failed = eval["failed_scenes"].as_array()?;
        let mut outcomes = vec![1.0; usize::try_from(eval["episodes"].as_u64()?).ok()?];
        for scene in failed {
            let idx = usize::try_from(scene.as_u64()?.checked_sub(first)?).ok()?;
            *outcomes.get_mut(idx)? = 0.0;
        }
        Some(outcomes)
    }
}

/// The row of that file, if it is there; one of another key is refused.
pub(super) fn read(path: &Path, key: &Key) -> Result<Option<Row>, FileError> {
    if !path.exists() {
        return Ok(None);
    }
    let row: Row = files::read_json(path)?;
    if row.key != *key {
        return Err(FileError::content(path, "is the row of another run than its name says"));
    }
    Ok(Some(row))
}

/// All rows of a directory, in the order of their names.
pub(super) fn read_all(directory: &Path) -> Result<Vec<Row>, FileError> {
    let entries = fs::read_dir(directory).map_err(FileError::io("read", directory))?;
    let mut paths = entries
        .map(|entry| Ok(entry.map_err(FileError::io("read", directory))?.path()))
        .collect::<Result<Vec<_>, FileError>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    paths.iter().map(|path| files::read_json(path)).collect()
}
