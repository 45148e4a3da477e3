//! The folder of a job: its settings, its log and its run directory.

use crate::files::{self, FileError, Result};
use crate::metrics::{self, MetricsWriter};
use crate::run_directory;
use core::time::Duration;
use serde_json::{Map, Value};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Instant;

/// Time that an attempt waits for the process of an earlier one, which ends when it notices that
/// its server is gone.
const PATIENCE: Duration = Duration::from_secs(30);
/// Bytes at the end of a log in which its last line is looked for.
const LAST_BYTES: u64 = 4096;

/// Folder of a job's files.
#[derive(Debug, Clone)]
pub(super) struct JobFolder(PathBuf);

/// From where an attempt goes on.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Start {
    /// From nothing.
    Anew,
    /// From the checkpoint at that environment step.
    Resume(u64),
    /// An earlier attempt got to the end, and its server ended before it could say so.
    Done(Map<String, Value>),
}

impl JobFolder {
    /// The folder at `path`, which is created where it is absent.
    pub(super) fn create(path: PathBuf) -> Result<Self> {
        fs::create_dir_all(&path).map_err(FileError::io("create", &path))?;
        Ok(Self(path))
    }

    /// The run directory.
    pub(super) fn run(&self) -> PathBuf {
        self.0.join("run")
    }

    /// The settings of a job that has its own.
    pub(super) fn settings(&self) -> PathBuf {
        self.0.join("settings.toml")
    }

    pub(super) fn metrics(&self) -> PathBuf {
        self.run().join(metrics::FILE_NAME)
    }

    /// The log, which belongs to one attempt at a time. The lock is on the open file, which the
    /// process of the attempt inherits as its standard error: it holds as long as that process
    /// lives, also when its server is gone.
    pub(super) fn lock_log(&self) -> Result<Log> {
        let path = self.0.join("log");
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .read(true)
            .open(&path)
            .map_err(FileError::io("create", &path))?;
        let deadline = Instant::now() + PATIENCE;
        while let Err(error) = file.try_lock() {
            match error {
                TryLockError::Error(error) => return Err(FileError::io("lock", &path)(error)),
                TryLockError::WouldBlock if Instant::now() > deadline => {
                    return Err(FileError::content(
                        &path,
                        "the process of an earlier attempt is still alive",
                    ));
                }
                TryLockError::WouldBlock => sleep(Duration::from_millis(20)),
            }
        }
        let start = file.metadata().map_err(FileError::io("read", &path))?.len();
        Ok(Log { file, path, start })
    }

    /// Makes the run directory what the attempt starts from.
    pub(super) fn prepare(&self) -> Result<Start> {
        let run = self.run();
        if let Some(summary) = self.summary()? {
            return Ok(Start::Done(summary));
        }
        if let Some(step) = run_directory::latest_step(&run)? {
            // As the trainer does when it resumes: what is read until then is what will stay.
            MetricsWriter::resume(&run, step)?;
            return Ok(Start::Resume(step));
        }
        match fs::remove_dir_all(&run) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(FileError::io("delete", &run)(error))
            }
            _ => Ok(Start::Anew),
        }
    }

    /// The run's summary, once it has ended.
    pub(super) fn summary(&self) -> Result<Option<Map<String, Value>>> {
        let path = self.run().join(run_directory::SUMMARY);
        if path.exists() { files::read_json(&path).map(Some) } else { Ok(None) }
    }
}

/// Standard error of an attempt's process.
#[derive(Debug)]
pub(super) struct Log {
    file: File,
    path: PathBuf,
    /// Bytes of earlier attempts.
    start: u64,
}

impl Log {
    /// The file for a process to write to.
    pub(super) fn for_process(&self) -> Result<File> {
        self.file.try_clone().map_err(FileError::io("open", &self.path))
    }

    /// The last line of this attempt that says something, without `error: `.
    pub(super) fn last_line(&self) -> Result<Option<String>> {
        let text = read_end(&self.file, self.start).map_err(FileError::io("read", &self.path))?;
        let line = text.lines().map(str::trim).rfind(|line| !line.is_empty());
        Ok(line.map(|line| line.strip_prefix("error: ").unwrap_or(line).to_owned()))
    }
}

/// The end of a file, from byte `start` on at the earliest.
fn read_end(mut file: &File, start: u64) -> io::Result<String> {
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(start.max(length.saturating_sub(LAST_BYTES))))?;
    let mut bytes = Vec::new();
    file.take(LAST_BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Folder of a job among the folders of all jobs.
pub(super) fn of_job(jobs: &Path, id: super::job::JobId) -> Result<JobFolder> {
    JobFolder::create(jobs.join(id.to_string()))
}
