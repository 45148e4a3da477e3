//! A worker: takes jobs from the queue and runs one after another.

use super::child::Process;
use super::folder::{self, JobFolder, Log, Start};
use super::job::Claim;
use super::spec::{JobSpec, SpecError};
use super::state::{Change, Reason, State};
use super::store::{Ended, SqliteStore};
use super::store_error::StoreError;
use super::tail::Tail;
use super::{Phase, report, stopping};
use crate::files::{self, FileError};
use core::time::Duration;
use serde_json::{Map, Value};
use std::io;
use std::path::PathBuf;
use std::process::ExitStatus;
use thiserror::Error;
use tokio::sync::watch;
use tokio::task::{JoinError, spawn_blocking};
use tokio::time::{MissedTickBehavior, interval, sleep};

/// Time between two looks of a worker at the metrics and at a request to cancel the job.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);
/// Time that a worker leaves a database alone that has failed.
const PAUSE: Duration = Duration::from_secs(1);

/// Takes jobs from the queue until the server stops.
#[derive(Debug, Clone)]
pub struct Worker {
    /// The store of the jobs.
    pub store: SqliteStore,
    /// The `lpr` binary.
    pub program: PathBuf,
    /// Directory of the jobs' folders.
    pub jobs: PathBuf,
    /// Phase of the server: it serves or it stops.
    pub phase: watch::Receiver<Phase>,
}

/// End of the process of an attempt.
enum Exit {
    ByItself(ExitStatus),
    Cancelled,
    Stopped,
}

/// Outcome of an attempt.
enum Attempt {
    Ended(Ended),
    Lost(String),
}

/// Reason why a worker could not do its part.
#[derive(Debug, Error)]
enum WorkerError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("settings: {0}")]
    Settings(#[from] SpecError),
    #[error("the training process: {0}")]
    Process(#[from] io::Error),
    #[error("a task of the worker: {0}")]
    Task(#[from] JoinError),
}

type Result<T, E = WorkerError> = core::result::Result<T, E>;

impl Worker {
    /// Runs jobs until the server stops.
    pub async fn work(mut self) {
        let mut changes = self.store.changes();
        while *self.phase.borrow() == Phase::Serving {
            // Before the look at the queue: a job that comes after the look then ends the wait
            // below.
            changes.mark_unchanged();
            match self.store.claim().await {
                Ok(Some((claim, spec))) => self.run(claim, spec).await,
                Ok(None) => tokio::select! {
                    _ = changes.changed() => {}
                    () = stopping(&mut self.phase) => {}
                },
                Err(error) => {
                    report(&format!("a worker cannot take a job: {error}"));
                    sleep(PAUSE).await;
                }
            }
        }
    }

    async fn run(&mut self, claim: Claim, spec: JobSpec) {
        let recorded = match self.attempt(claim, spec).await {
            Ok(Attempt::Ended(ended)) => self.store.finish(claim, &ended).await,
            Ok(Attempt::Lost(message)) => self.store.lose(claim, Some(message)).await,
            Err(error) => {
                report(&format!("job {}: {error}", claim.id));
                self.store
                    .finish(claim, &Ended::failed(Reason::WorkerError, Some(error.to_string())))
                    .await
            }
        };
        if let Err(error) = recorded {
            report(&format!("job {}: its end is not recorded: {error}", claim.id));
        }
    }

    async fn attempt(&mut self, claim: Claim, spec: JobSpec) -> Result<Attempt> {
        let folder = folder::of_job(&self.jobs, claim.id)?;
        let (log, start) = prepare(folder.clone()).await?;
        self.go_back(claim, &start).await?;
        // After the rewind: it decides how many lines the history has already.
        let mut tail = Tail::after(folder.metrics(), self.store.n_points(claim.id).await?).await?;
        if let Start::Done(summary) = start {
            self.forward(claim, &mut tail).await?;
            return Ok(succeeded(summary));
        }
        if let Some(config) = spec.config()? {
            files::write_atomically(&folder.settings(), |file| {
                file.write_all(config.to_toml().as_bytes())
            })?;
        }
        let mut arguments = spec.arguments(&folder.run(), &folder.settings());
        arguments.push("--until-stdin-closes".into());
        arguments.extend(matches!(start, Start::Resume(_)).then(|| "--resume".into()));
        let process = Process::start(&self.program, &arguments, log.for_process()?)?;
        let exit = self.watch(claim, process, &mut tail).await?;
        // Lines that the process wrote between the last look and its end.
        self.forward(claim, &mut tail).await?;
        match exit {
            Exit::Stopped => Ok(Attempt::Ended(Ended::new(Change::ServerStopped))),
            Exit::Cancelled => Ok(Attempt::Ended(Ended::new(Change::Ended))),
            Exit::ByItself(status) => Ok(judge(status, folder.summary()?, log.last_line()?)),
        }
    }

    /// Takes out of the history what the run will do again.
    async fn go_back(&self, claim: Claim, start: &Start) -> Result<()> {
        match start {
            Start::Anew => Ok(self.store.rewind(claim, None).await?),
            Start::Resume(step) => Ok(self.store.rewind(claim, Some(*step)).await?),
            Start::Done(_) => Ok(()),
        }
    }

    /// Runs the process to its end, and hands on the metrics meanwhile.
    async fn watch(&mut self, claim: Claim, mut process: Process, tail: &mut Tail) -> Result<Exit> {
        let mut looks = interval(LOOK_INTERVAL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                // A process that ends while the server stops may have been told to by the system as
                // well.
                biased;
                () = stopping(&mut self.phase) => {
                    process.kill().await?;
                    return Ok(Exit::Stopped);
                }
                status = process.wait() => return Ok(Exit::ByItself(status?)),
                _ = looks.tick() => {}
            }
            self.forward(claim, tail).await?;
            if self.store.state(claim).await? == State::Cancelling {
                process.kill().await?;
                return Ok(Exit::Cancelled);
            }
        }
    }

    async fn forward(&self, claim: Claim, tail: &mut Tail) -> Result<()> {
        let points = tail.read().await?;
        Ok(self.store.append_points(claim, &points).await?)
    }
}

/// Waits for the process of an earlier attempt to be gone, and makes the run directory what this
/// one starts from.
async fn prepare(folder: JobFolder) -> Result<(Log, Start)> {
    Ok(spawn_blocking(move || Ok::<_, FileError>((folder.lock_log()?, folder.prepare()?)))
        .await??)
}

/// Judges a process that ended by itself, by the files that it left.
fn judge(
    status: ExitStatus,
    summary: Option<Map<String, Value>>,
    last_line: Option<String>,
) -> Attempt {
    match (status.code(), summary) {
        (Some(0), Some(summary)) => succeeded(summary),
        (Some(0), None) => failed(Some("the process left no summary".to_owned())),
        (Some(_), _) => failed(last_line),
        // The system ended it: short of memory, or going down.
        (None, _) => Attempt::Lost(format!("the process was lost: {status}")),
    }
}

fn failed(message: Option<String>) -> Attempt {
    Attempt::Ended(Ended::failed(Reason::ExitStatus, message))
}

fn succeeded(summary: Map<String, Value>) -> Attempt {
    Attempt::Ended(Ended { summary: Some(summary), ..Ended::new(Change::Succeeded) })
}

#[cfg(test)]
mod tests;
