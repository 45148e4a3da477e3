//! The runs of an experiment: child processes of this program, several at once, each with one
//! thread.

use super::row::{self, Key, Row};
use crate::cli::failure::Result;
use crate::files::{self, FileError};
use crate::run_directory;
use serde_json::Value;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::{io, thread};

/// A row that is to be there.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) key: Key,
    /// File of the row.
    pub(super) row: PathBuf,
    /// Directory of the training run.
    pub(super) run: PathBuf,
    pub(super) work: Work,
}

/// The commands that make a row.
#[derive(Debug)]
pub(super) enum Work {
    /// The one that trains, without its directory, and the options of a diagnosis after it.
    Train { train: Vec<String>, diagnose: Option<Vec<String>> },
    /// The one that evaluates what needs no training.
    Evaluate(Vec<String>),
}

/// All rows in the order of their plans. Runs what has no row yet, `at_once` at a time; the first
/// failure is told when those that were under way have ended.
pub(super) fn complete(plans: &[Plan], at_once: usize) -> Result<Vec<Row>> {
    let next = AtomicUsize::new(0);
    let rows: Vec<Mutex<Option<Result<Row>>>> = plans.iter().map(|_| Mutex::new(None)).collect();
    let work = || {
        loop {
            let idx = next.fetch_add(1, Ordering::Relaxed);
            let Some(plan) = plans.get(idx) else { break };
            let row = one(plan);
            if row.is_err() {
                next.store(plans.len(), Ordering::Relaxed);
            }
            *rows[idx].lock().unwrap_or_else(PoisonError::into_inner) = Some(row);
        }
    };
    thread::scope(|scope| {
        for _ in 0..at_once.min(plans.len()) {
            scope.spawn(work);
        }
    });
    rows.into_iter()
        .filter_map(|row| row.into_inner().unwrap_or_else(PoisonError::into_inner))
        .collect()
}

/// The row of a plan, which is run unless it is there.
fn one(plan: &Plan) -> Result<Row> {
    let Plan { key, row, run, work } = plan;
    if let Some(row) = row::read(row, key)? {
        return Ok(row);
    }
    say(&format!("{}: starts", key.name()));
    let mut done = Row {
        key: key.clone(),
        commit: commit(),
        training: Value::Null,
        evaluation: Value::Null,
        diagnosis: Value::Null,
    };
    match work {
        Work::Train { train, diagnose } => {
            done.training = trained(run, train)?;
            if let Some(options) = diagnose {
                let mut words = vec!["diagnose".to_owned(), run.display().to_string()];
                words.extend_from_slice(options);
                done.diagnosis = report(words, &log(run))?;
            }
        }
        Work::Evaluate(words) => done.evaluation = report(words.clone(), &log(run))?,
    }
    files::write_json(row, &done)?;
    say(&format!("{}: done", key.name()));
    Ok(done)
}

/// The summary of a run, which goes on where it was interrupted.
fn trained(run: &Path, train: &[String]) -> Result<Value> {
    let summary = run.join(run_directory::SUMMARY);
    if !summary.exists() {
        let mut words = train.to_vec();
        words.extend(["--out".to_owned(), run.display().to_string()]);
        if run_directory::latest_step(run)?.is_some() {
            words.push("--resume".to_owned());
        } else if run.exists() {
            // It was killed before its first checkpoint.
            std::fs::remove_dir_all(run).map_err(FileError::io("delete", run))?;
        }
        child(&words, &log(run))?;
    }
    Ok(files::read_json(&summary)?)
}

/// What a command reports.
fn report(mut words: Vec<String>, log: &Path) -> Result<Value> {
    words.push("--json".to_owned());
    Ok(serde_json::from_str(&child(&words, log)?).map_err(io::Error::from)?)
}

/// The file that takes what the children of a run say.
fn log(run: &Path) -> PathBuf {
    run.with_extension("log")
}

/// Runs this program with one thread; what it printed. Its standard input is a pipe, at whose end
/// a training run ends too: it does not outlive this one.
fn child(words: &[String], log: &Path) -> Result<String> {
    if let Some(parent) = log.parent() {
        std::fs::create_dir_all(parent).map_err(FileError::io("create", parent))?;
    }
    let errors = File::options().create(true).append(true).open(log);
    let errors = errors.map_err(FileError::io("write", log))?;
    let mut command = Command::new(std::env::current_exe()?);
    command.args(words).env("RAYON_NUM_THREADS", "1");
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(errors);
    if words[0] == "train" {
        command.arg("--until-stdin-closes");
    }
    let mut running = command.spawn()?;
    let stdin = running.stdin.take();
    let output = running.wait_with_output()?;
    drop(stdin);
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let what = words.join(" ");
    let reason = format!("`lpr {what}` ended with {}: {}", output.status, last_line(log));
    Err(FileError::content(log, reason).into())
}

fn last_line(log: &Path) -> String {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    text.lines().last().unwrap_or("without a word").to_owned()
}

/// The commit of the checkout in which the program runs.
fn commit() -> String {
    let described =
        Command::new("git").args(["describe", "--always", "--dirty", "--abbrev=12"]).output();
    let text = described.ok().filter(|output| output.status.success());
    text.map_or("unknown".to_owned(), |output| {
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    })
}

fn say(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}
