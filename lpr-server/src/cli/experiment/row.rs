//! A row of an experiment: one run and what was found of it, in a file of its own.

use crate::files::{self, FileError};
use lpr_core::agent::{Method, PoseSource};
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
    pub(super) method: Method,
    pub(super) poses: PoseSource,
    pub(super) seed: u64,
    pub(super) env_steps: u64,
    /// Of every setting, the scenes that are looked at and the program: its sources and the
    /// versions of its dependencies.
    pub(super) digest: String,
}

impl Key {
    pub(super) fn new(
        config: &Config,
        task: &str,
        method: Method,
        seed: u64,
        [env_steps, scenes]: [u64; 2],
    ) -> Self {
        let decides = format!("{SOURCE_DIGEST} {scenes} {}", config.to_toml());
        Self {
            task: task.to_owned(),
            method,
            poses: PoseSource::Learned,
            seed,
            env_steps,
            digest: format!("{:016x}", digest::of(decides.as_bytes())),
        }
    }

    /// Name of its file and of its run's directory.
    pub(super) fn name(&self) -> String {
        let Self { task, method, seed, env_steps, digest, .. } = self;
        format!("{task}-{}-{seed}-{env_steps}-{}", method.name(), &digest[..8])
    }
}

/// See the module.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Row {
    #[serde(flatten)]
    pub(super) key: Key,
    /// The checkout's, for people.
    pub(super) commit: String,
    /// The run's `summary.json`.
    pub(super) training: Value,
    /// The report of `lpr diagnose`.
    pub(super) diagnosis: Value,
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
