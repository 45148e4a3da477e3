//! `lpr train`: Algorithm 1 on a task, with validation, checkpoints and a final evaluation.

pub(super) mod demonstrations;
mod interruption;
mod progress;
mod session;
mod setup;

use super::arguments::RobotArgument;
use super::eval::EvalReport;
use super::failure::Result;
use crate::run_options::{DEFAULT_MINUTES, DEFAULT_PRESET, check_minutes, check_trainable};
use clap::Args;
use core::fmt;
use interruption::Interruption;
use lpr_core::agent::Method;
use lpr_core::diagnose::Diagnosis;
use lpr_core::evaluate::Evaluation;
use lpr_core::nn::Backend;
use lpr_core::perception::{CAMERA_NAMES, Camera};
use lpr_core::sim::tasks::Task;
use serde::Serialize;
use session::Session;
use std::path::PathBuf;
use std::sync::Arc;
use std::{io, process, thread};

/// Options of `lpr train`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The task; `lpr tasks` lists them
    #[arg(value_parser = Task::by_name)]
    task: Arc<Task>,
    /// Directory of the run, empty or absent unless --resume is given
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    robot: RobotArgument,
    /// The choice of paths: lpr, lpr-no-policy or c2farm
    #[arg(long, value_parser = Method::by_name, default_value = Method::Lpr.name())]
    method: Method,
    /// A built-in preset (fast, paper, paper-narrow) or a file that lists every setting
    #[arg(long, default_value = DEFAULT_PRESET)]
    preset: String,
    /// Demonstrations, in place of the preset's number
    #[arg(long)]
    demos: Option<usize>,
    /// Learn from the demonstrations of this directory, as `lpr demo --out` writes them
    #[arg(long, value_name = "DIR", conflicts_with = "demos")]
    demo_dir: Option<PathBuf>,
    /// Take next-best poses from the demonstrator: only paths are learned
    #[arg(long)]
    oracle_poses: bool,
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "front", value_parser = Camera::known_name,
          help = cameras_help())]
    cameras: Vec<&'static str>,
    /// Seed of everything drawn
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Stop after this many environment steps
    #[arg(long)]
    env_steps: Option<u64>,
    /// Stop after this many minutes of training
    #[arg(long, default_value_t = DEFAULT_MINUTES)]
    minutes: f64,
    /// Stop after this many training episodes in a row that succeeded
    #[arg(long)]
    stop_after_successes: Option<u64>,
    /// Go on when validations are good enough to stop
    #[arg(long)]
    no_early_stop: bool,
    /// Go on from the newest checkpoint in --out
    #[arg(long)]
    resume: bool,
    /// End at once when standard input closes: whoever started the run is gone
    #[arg(long, hide = true)]
    until_stdin_closes: bool,
    /// Backend of the networks: flex, or ndarray where the program was built with it
    #[arg(long, value_parser = Backend::by_name, default_value = "flex")]
    backend: Backend,
}

fn cameras_help() -> String {
    format!("What the agent sees with, separated by commas: {}", CAMERA_NAMES.join(", "))
}

/// The report of `lpr train`, which also goes to `summary.json`.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    task: String,
    method: &'static str,
    oracle_poses: bool,
    seed: u64,
    env_steps: u64,
    episodes: u64,
    updates: u64,
    wall_seconds: f64,
    stopped_by: &'static str,
    /// Validation success of the agent that had seen demonstrations only.
    demonstrations_only: Option<ValidationPoint>,
    eval: EvalReport,
    /// What the agent gets wrong in ten other scenes.
    diagnosis: Diagnosis,
}

/// Findings of the diagnosis that are printed.
const FINDINGS: usize = 3;

/// A validation on seeds that neither training nor the final evaluation uses.
#[derive(Debug, Clone, Copy, Serialize)]
struct ValidationPoint {
    episodes: u64,
    successes: u64,
    success_rate: f64,
}

impl ValidationPoint {
    fn new(episodes: u64, successes: u64) -> Self {
        let found = Evaluation { episodes, successes, ..Evaluation::default() };
        Self { episodes, successes, success_rate: found.success_rate() }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let unusable = |option: &'static str| {
        move |reason: String| lpr_core::Error::Config(format!("{option}: {reason}"))
    };
    check_minutes(arguments.minutes).map_err(unusable("--minutes"))?;
    check_trainable(arguments.method).map_err(unusable("--method"))?;
    let interruption = if arguments.until_stdin_closes {
        thread::spawn(end_with_stdin);
        Interruption::never()
    } else {
        Interruption::of_signals()?
    };
    let mut session = if arguments.resume {
        Session::resume(arguments, interruption)?
    } else {
        Session::create(arguments, interruption)?
    };
    let stopped_by = session.train()?;
    session.finish(stopped_by)
}

/// Ends the process when standard input has come to its end. What is being written then is left
/// out, as after a kill.
#[expect(clippy::exit, reason = "no one is left who would wait for the run to end in good order")]
fn end_with_stdin() {
    let _ = io::copy(&mut io::stdin(), &mut io::sink());
    process::exit(1);
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, method, env_steps, episodes, updates, wall_seconds, stopped_by, .. } =
            self;
        writeln!(
            f,
            "{task} with {method}: {env_steps} environment steps in {episodes} episodes, {updates} updates"
        )?;
        writeln!(f, "{wall_seconds:.0} s of training, stopped by {stopped_by}")?;
        if let Some(first) = &self.demonstrations_only {
            writeln!(
                f,
                "after demonstrations alone: {} of {} validation episodes",
                first.successes, first.episodes
            )?;
        }
        self.eval.fmt(f)?;
        let Diagnosis { scenes, successes, findings, .. } = &self.diagnosis;
        writeln!(f, "diagnosis: {successes} of {scenes} further scenes; lpr diagnose tells more")?;
        for finding in findings.iter().take(FINDINGS) {
            writeln!(f, "  {}", finding.text)?;
        }
        Ok(())
    }
}
