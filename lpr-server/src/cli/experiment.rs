//! `lpr experiment`: many runs whose figures belong together, in rows that are never run twice.

mod ablations;
mod page;
mod row;
mod runs;
mod statistics;

use super::arguments::RobotArgument;
use super::eval::BEST_OF_ALL;
use super::failure::{Failure, Result};
use crate::files::{self, FileError};
use crate::run_options::{DEFAULT_PRESET, check_trainable};
use clap::{Args, Subcommand};
use core::fmt;
use lpr_core::agent::{Method, PoseSource};
use lpr_core::sim::tasks::{TASKS, Task, TaskSet};
use row::{Key, Row};
use runs::{Plan, Work, complete};
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Actions of `lpr experiment`.
#[derive(Debug, Subcommand)]
pub(super) enum Action {
    /// Train and diagnose an agent on every task of the paper, and write a row for each
    Baseline(Box<Options>),
    /// The same on the tasks of set 1, and the baseline C2F-ARM beside it
    Set1(Box<Options>),
    /// The same on the tasks of set 2
    Set2(Box<Options>),
    /// The tasks of set 2 with the demonstrator's poses, and every method beside it
    Set2Oracle(Box<Options>),
    /// The opening of box and grill with the preset, and with each of its choices put back
    Ablations(Box<Options>),
    /// Make a page of the rows of a directory
    Report(ReportArguments),
}

/// Options of the experiments that train.
#[derive(Debug, Clone, Args)]
pub(super) struct Options {
    /// Directory of the rows, empty or absent unless --resume is given
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Directory in which agents are trained; a row needs it until it is written
    #[arg(long, value_name = "DIR", default_value = "runs/experiment")]
    runs: PathBuf,
    /// Go on: rows that are there stay, runs that were interrupted continue
    #[arg(long)]
    resume: bool,
    /// Tasks, separated by commas [default: those of the experiment]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = Task::by_name)]
    tasks: Vec<Arc<Task>>,
    /// Methods, separated by commas: those of `lpr train`; with the demonstrator's poses also those
    /// of `lpr eval` [default: those of the experiment]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// Seeds, separated by commas
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Environment steps of each run
    #[arg(long, value_name = "N", default_value_t = 800, value_parser = clap::value_parser!(u64).range(1..))]
    env_steps: u64,
    /// Demonstrations, in place of the preset's number
    #[arg(long, value_name = "N")]
    demos: Option<usize>,
    /// Presets, separated by commas: built-in, or files that list every setting
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = DEFAULT_PRESET)]
    preset: Vec<String>,
    #[command(flatten)]
    robot: RobotArgument,
    /// Scenes of the diagnosis
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    scenes: u64,
    /// Runs at once, each with one thread
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=256))]
    at_once: u16,
}

/// What an experiment looks at unless its options say otherwise.
struct Design {
    sets: &'static [TaskSet],
    methods: &'static [&'static str],
    poses: PoseSource,
}

const BASELINE: Design =
    Design { sets: &[TaskSet::One, TaskSet::Two], methods: &["lpr"], poses: PoseSource::Learned };
const SET_1: Design =
    Design { sets: &[TaskSet::One], methods: &["lpr", "c2farm"], poses: PoseSource::Learned };
const SET_2: Design = Design { sets: &[TaskSet::Two], ..SET_1 };
const SET_2_ORACLE: Design = Design {
    sets: &[TaskSet::Two],
    methods: &["lpr", "c2farm", "shortest-free", "linear", "random", BEST_OF_ALL],
    poses: PoseSource::Oracle,
};

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
    let (rows, directory) = match action {
        Action::Baseline(options) => (experiment(options, &BASELINE)?, &options.out),
        Action::Set1(options) => (experiment(options, &SET_1)?, &options.out),
        Action::Set2(options) => (experiment(options, &SET_2)?, &options.out),
        Action::Set2Oracle(options) => (experiment(options, &SET_2_ORACLE)?, &options.out),
        Action::Ablations(given) => {
            let mut options = given.clone();
            let [preset] = given.preset.as_slice() else {
                let reason = "--preset: the choices of one preset are put back at a time";
                return Err(Failure::Usage(reason.to_owned()));
            };
            let recipe = super::settings::load_config(preset)?;
            let directory = options.runs.with_extension("presets");
            options.preset.extend(ablations::write(&recipe, &directory)?);
            if options.tasks.is_empty() {
                let tasks = ["open_box", "open_grill"].map(Task::by_name);
                options.tasks = tasks.into_iter().collect::<lpr_core::Result<_>>()?;
            }
            (experiment(&options, &BASELINE)?, &given.out)
        }
        Action::Report(arguments) => {
            let rows = row::read_all(&arguments.rows)?;
            if rows.is_empty() {
                let reason = "holds no row of an experiment";
                return Err(FileError::content(&arguments.rows, reason).into());
            }
            (rows, &arguments.rows)
        }
    };
    let twice = |reason: String| FileError::content(directory, reason);
    let text = page::markdown(&rows).map_err(twice)?;
    if let Action::Report(ReportArguments { rows, page: Some(page) }) = action {
        page::insert(page, rows, &text)?;
    }
    Ok(Report { rows, text })
}

/// The rows of all seeds, tasks, methods and presets, those that were there among them.
fn experiment(options: &Options, design: &Design) -> Result<Vec<Row>> {
    let Options { out, runs, resume, at_once, .. } = options;
    if !resume {
        files::refuse_non_empty(out)?;
        files::refuse_non_empty(runs)?;
    }
    let plans = plans(options, design)?;
    let repeats =
        |(idx, plan): (usize, &Plan)| plans[..idx].iter().any(|other| other.key == plan.key);
    if plans.iter().enumerate().any(repeats) {
        let reason = "--tasks, --methods, --seeds, --preset: name each once";
        return Err(Failure::Usage(reason.to_owned()));
    }
    fs::create_dir_all(out).map_err(FileError::io("create", out))?;
    files::remove_partial(out)?;
    complete(&plans, usize::from(*at_once))
}

fn plans(options: &Options, design: &Design) -> Result<Vec<Plan>> {
    let of_design = TASKS.iter().filter(|task| design.sets.contains(&task.set)).cloned();
    let tasks = if options.tasks.is_empty() { of_design.collect() } else { options.tasks.clone() };
    let words = design.methods.iter().map(|&word| word.to_owned());
    let methods =
        if options.methods.is_empty() { words.collect() } else { options.methods.clone() };
    let mut plans = Vec::new();
    for (seed_idx, seed) in options.seeds.iter().enumerate() {
        for task in &tasks {
            for method in &methods {
                for (preset_idx, preset) in options.preset.iter().enumerate() {
                    let is_trained = is_trained(method, design.poses)?;
                    // A method without weights is the same for all.
                    if is_trained || (seed_idx, preset_idx) == (0, 0) {
                        let subject = Subject { task, method, seed: *seed, preset, is_trained };
                        plans.push(plan(options, design.poses, &subject)?);
                    }
                }
            }
        }
    }
    Ok(plans)
}

/// True for a method with weights.
fn is_trained(method: &str, poses: PoseSource) -> Result<bool> {
    if method == BEST_OF_ALL && poses == PoseSource::Oracle {
        return Ok(false);
    }
    let method = Method::by_name(method)
        .map_err(|error| Failure::Usage(format!("--methods: {error}, {BEST_OF_ALL}")))?;
    // C2F-ARM learns poses alone.
    let is_trained = method.has_ranker() || poses == PoseSource::Learned;
    if is_trained {
        check_trainable(method).map_err(|reason| Failure::Usage(format!("--methods: {reason}")))?;
    }
    Ok(is_trained)
}

/// Of what a row is.
struct Subject<'a> {
    task: &'a Task,
    method: &'a str,
    seed: u64,
    preset: &'a str,
    is_trained: bool,
}

fn plan(options: &Options, poses: PoseSource, subject: &Subject<'_>) -> Result<Plan> {
    let Subject { task, method, seed, preset, is_trained } = *subject;
    // `lpr eval` makes the candidates of a method without weights as the default preset says.
    let preset = if is_trained { preset } else { DEFAULT_PRESET };
    let mut config = super::settings::load_config(preset)?;
    config.training.demonstrations = options.demos.unwrap_or(config.training.demonstrations);
    let robot = &options.robot.robot.name;
    let stem = Path::new(preset).file_stem().unwrap_or_default();
    let key = Key {
        task: task.name.clone(),
        method: method.to_owned(),
        poses,
        robot: robot.clone(),
        preset: stem.to_string_lossy().into_owned(),
        demonstrations: config.training.demonstrations,
        seed,
        env_steps: if is_trained { options.env_steps } else { 0 },
        digest: Key::digest(&config, options.scenes),
    };
    let oracle = (poses == PoseSource::Oracle).then_some("--oracle-poses");
    let work = if is_trained {
        let demonstrations = key.demonstrations.to_string();
        let train = [
            &["train", &task.name, "--method", method, "--preset", preset][..],
            &["--seed", &seed.to_string(), "--env-steps", &options.env_steps.to_string()],
            &["--demos", &demonstrations, "--robot", robot],
            &["--minutes", "1000000", "--no-early-stop"],
            oracle.as_slice(),
        ];
        let ranks = Method::by_name(method).is_ok_and(Method::has_ranker);
        let scenes = options.scenes.to_string();
        Work::Train {
            train: owned(&train.concat()),
            diagnose: ranks.then(|| owned(&["--scenes", &scenes])),
        }
    } else {
        let words = ["eval", &task.name, "--oracle-poses", "--method", method, "--robot", robot];
        Work::Evaluate(owned(&words))
    };
    let name = key.name();
    let row = options.out.join(format!("{name}.json"));
    Ok(Plan { row, run: options.runs.join(name), key, work })
}

fn owned(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.to_owned()).collect()
}
