//! `metrics.jsonl` of a run: one JSON object per log point.

use crate::files::{self, FileError, Result};
use serde_json::{Map, Value};
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Name of the file in a run directory.
pub const FILE_NAME: &str = "metrics.jsonl";

/// The key that every line has: environment steps taken so far.
const STEP_KEY: &str = "env_steps";

/// Appends log points to `metrics.jsonl`.
#[derive(Debug)]
pub struct MetricsWriter {
    file: File,
    path: PathBuf,
}

impl MetricsWriter {
    /// Creates the file of a new run in `run_directory`.
    ///
    /// # Errors
    ///
    /// When it exists or cannot be written.
    pub fn create(run_directory: &Path) -> Result<Self> {
        let path = run_directory.join(FILE_NAME);
        let file = File::create_new(&path).map_err(FileError::io("create", &path))?;
        Ok(Self { file, path })
    }

    /// Goes on with the file in `run_directory` after dropping lines later than `last_env_step` and
    /// a torn last line.
    ///
    /// # Errors
    ///
    /// When it is missing or cannot be rewritten.
    pub fn resume(run_directory: &Path, last_env_step: u64) -> Result<Self> {
        let path = run_directory.join(FILE_NAME);
        let old = std::fs::read_to_string(&path).map_err(FileError::io("read", &path))?;
        let kept = |line: &&str| {
            line.ends_with('\n') && env_step(line).is_some_and(|step| step <= last_env_step)
        };
        files::write_atomically(&path, |writer| {
            old.split_inclusive('\n')
                .filter(kept)
                .try_for_each(|line| writer.write_all(line.as_bytes()))
        })?;
        let file =
            OpenOptions::new().append(true).open(&path).map_err(FileError::io("write", &path))?;
        Ok(Self { file, path })
    }

    /// Appends one log point; a value that is not finite is written as null, which JSON has
    /// instead.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn write(&mut self, env_steps: u64, metrics: &[(&str, f64)]) -> Result<()> {
        let step = (STEP_KEY.to_owned(), Value::from(env_steps));
        let values = metrics.iter().map(|&(name, value)| (name.to_owned(), Value::from(value)));
        let point: Map<_, _> = core::iter::once(step).chain(values).collect();
        let line = format!("{}\n", Value::Object(point));
        self.file.write_all(line.as_bytes()).map_err(FileError::io("write", &self.path))
    }
}

/// The environment step and the value of every log point that has metric `name`.
///
/// # Errors
///
/// When the file in `run_directory` cannot be read.
pub fn history(run_directory: &Path, name: &str) -> Result<Vec<(u64, f64)>> {
    let path = run_directory.join(FILE_NAME);
    let text = std::fs::read_to_string(&path).map_err(FileError::io("read", &path))?;
    let point = |line: &str| {
        let point: Map<String, Value> = serde_json::from_str(line).ok()?;
        Some((point.get(STEP_KEY)?.as_u64()?, point.get(name)?.as_f64()?))
    };
    Ok(text.lines().filter_map(point).collect())
}

/// The environment step of a line.
pub(crate) fn env_step(line: &str) -> Option<u64> {
    serde_json::from_str::<Map<String, Value>>(line).ok()?.get(STEP_KEY)?.as_u64()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(run_directory: &Path) -> Vec<Value> {
        let text = std::fs::read_to_string(run_directory.join(FILE_NAME)).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    #[test]
    fn a_line_is_one_object_with_one_key_per_metric() {
        let run = tempfile::tempdir().unwrap();
        let mut writer = MetricsWriter::create(run.path()).unwrap();
        writer.write(12, &[("losses/ranker", 0.02), ("losses/policy", f64::NAN)]).unwrap();
        let expected =
            serde_json::json!({"env_steps": 12, "losses/ranker": 0.02, "losses/policy": null});
        assert_eq!(lines(run.path()), [expected]);
    }

    #[test]
    fn resuming_drops_later_steps_and_a_torn_line() {
        let run = tempfile::tempdir().unwrap();
        let mut writer = MetricsWriter::create(run.path()).unwrap();
        for step in [10, 20, 30] {
            writer.write(step, &[("q", 1.0)]).unwrap();
        }
        writer.file.write_all(br#"{"env_steps": 5, "#).unwrap();
        let mut writer = MetricsWriter::resume(run.path(), 20).unwrap();
        writer.write(21, &[]).unwrap();
        let steps: Vec<_> =
            lines(run.path()).iter().map(|line| line[STEP_KEY].as_u64().unwrap()).collect();
        assert_eq!(steps, [10, 20, 21]);
    }

    #[test]
    fn the_history_of_a_metric_leaves_out_points_without_it() {
        let run = tempfile::tempdir().unwrap();
        let mut writer = MetricsWriter::create(run.path()).unwrap();
        writer.write(0, &[("q", 0.5)]).unwrap();
        writer.write(1, &[("r", 2.0)]).unwrap();
        writer.write(1, &[("q", 0.25)]).unwrap();
        assert_eq!(history(run.path(), "q").unwrap(), [(0, 0.5), (1, 0.25)]);
    }

    #[test]
    fn a_new_run_does_not_write_into_an_old_one() {
        let run = tempfile::tempdir().unwrap();
        MetricsWriter::create(run.path()).unwrap();
        assert!(MetricsWriter::create(run.path()).is_err());
    }
}
