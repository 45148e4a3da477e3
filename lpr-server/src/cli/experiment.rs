//! `lpr experiment`: many runs whose figures belong together, in rows that are never run twice.

mod page;
mod row;
mod runs;

use super::failure::{Failure, Result};
use crate::files::{self, FileError};
use crate::run_options::DEFAULT_PRESET;
use clap::{Args, Subcommand};
use core::fmt;
use lpr_core::agent::Method;
use lpr_core::sim::tasks::{TASKS, Task, TaskSet};
use row::{Key, Row};
use runs::{Plan, complete};
use serde::Serialize;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

/// Actions of `lpr experiment`.
#[derive(Debug, Subcommand)]
pub(super) enum Action {
    /// Train and diagnose an agent on every task of the paper, and write a row for each
    Baseline(Box<Baseline>),
    /// Make a page of the rows of a directory
    Report(ReportArguments),
}

/// Options of `lpr experiment baseline`.
#[derive(Debug, Args)]
pub(super) struct Baseline {
    /// Directory of the rows, empty or absent unless --resume is given
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Directory in which agents are trained; a row needs it until it is written
    #[arg(long, value_name = "DIR", default_value = "runs/baseline")]
    runs: PathBuf,
    /// Go on: rows that are there stay, runs that were interrupted continue
    #[arg(long)]
    resume: bool,
    /// Tasks, separated by commas [default: the sixteen of the paper]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = Task::by_name)]
    tasks: Vec<Arc<Task>>,
    /// Seeds, separated by commas
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Environment steps of each run
    #[arg(long, value_name = "N", default_value_t = 800, value_parser = clap::value_parser!(u64).range(1..))]
    env_steps: u64,
    /// A built-in preset or a file that lists every setting
    #[arg(long, default_value = DEFAULT_PRESET)]
    preset: String,
    /// Scenes of the diagnosis
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    scenes: u64,
    /// Runs at once, each with one thread
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=256))]
    at_once: u16,
}

/// Options of `lpr experiment report`.
#[derive(Debug, Args)]
pub(super) struct ReportArguments {
    /// Directory of rows, as an experiment leaves it
    #[arg(value_name = "DIR")]
    rows: PathBuf,
    /// Put the text into this Markdown file, between the lines `<!-- begin NAME -->` and `<!-- end
    /// NAME -->`, where NAME is that of the directory
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

/// The report of an experiment.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    rows: Vec<Row>,
    #[serde(skip)]
    text: String,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

pub(super) fn run(action: &Action) -> Result<Report> {
    let rows = match action {
        Action::Baseline(arguments) => baseline(arguments)?,
        Action::Report(arguments) => {
            let rows = row::read_all(&arguments.rows)?;
            if rows.is_empty() {
                let reason = "holds no row of an experiment";
                return Err(FileError::content(&arguments.rows, reason).into());
            }
            rows
        }
    };
    let text = page::markdown(&rows);
    if let Action::Report(ReportArguments { rows, page: Some(page) }) = action {
        page::insert(page, rows, &text)?;
    }
    Ok(Report { rows, text })
}

/// The rows of all tasks and seeds, those that were there among them.
fn baseline(arguments: &Baseline) -> Result<Vec<Row>> {
    let Baseline { out, runs, resume, seeds, env_steps, preset, scenes, at_once, .. } = arguments;
    if !resume {
        files::refuse_non_empty(out)?;
        files::refuse_non_empty(runs)?;
    }
    let config = super::settings::load_config(preset)?;
    let tasks = if arguments.tasks.is_empty() { paper_tasks() } else { arguments.tasks.clone() };
    let mut plans = Vec::new();
    for seed in seeds {
        for task in &tasks {
            let key = Key::new(&config, &task.name, Method::Lpr, *seed, [*env_steps, *scenes]);
            let name = key.name();
            let train = [
                "train",
                &task.name,
                "--preset",
                preset,
                "--seed",
                &seed.to_string(),
                "--env-steps",
                &env_steps.to_string(),
                "--minutes",
                "1000000",
                "--no-early-stop",
            ];
            let train = train.map(str::to_owned).to_vec();
            let diagnose = vec!["--scenes".to_owned(), scenes.to_string()];
            plans.push(Plan {
                row: out.join(format!("{name}.json")),
                run: runs.join(name),
                key,
                train,
                diagnose,
            });
        }
    }
    let repeats =
        |(idx, plan): (usize, &Plan)| plans[..idx].iter().any(|other| other.key == plan.key);
    if plans.iter().enumerate().any(repeats) {
        return Err(Failure::Usage("--tasks, --seeds: name each once".to_owned()));
    }
    fs::create_dir_all(out).map_err(FileError::io("create", out))?;
    files::remove_partial(out)?;
    complete(&plans, usize::from(*at_once))
}

/// The tasks of the paper's two sets.
fn paper_tasks() -> Vec<Arc<Task>> {
    TASKS.iter().filter(|task| task.set != TaskSet::Extra).cloned().collect()
}
