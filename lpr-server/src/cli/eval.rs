//! `lpr eval`: greedy evaluation of a run, or of a method with the demonstrator's poses.

use super::arguments::seed_range;
use super::failure::{Failure, Result};
use super::settings::load_config;
use super::simulator::simulator;
use crate::files::FileError;
use crate::run_directory;
use clap::{Args, ValueEnum};
use core::fmt;
use lpr_core::agent::{Agent, Init, Method, Networks, PoseSource};
use lpr_core::config::Config;
use lpr_core::evaluate::{
    Evaluation, Shown, best_of_all, evaluate, evaluate_shown, measure_regret,
};
use lpr_core::nn::Backend;
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::tasks::Task;
use lpr_core::train::default_cameras;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Name of the oracle among the methods.
pub(super) const BEST_OF_ALL: &str = "best-of-all";

/// Options of `lpr eval`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A run directory; with --oracle-poses and no --checkpoint, a task
    subject: String,
    /// Episodes
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    episodes: u64,
    /// Scene seed of the first episode
    #[arg(long, default_value_t = 5000)]
    seed: u64,
    /// Take next-best poses from the demonstrator
    #[arg(long)]
    oracle_poses: bool,
    /// Method: lpr, lpr-no-policy, c2farm, linear, shortest-free, random or best-of-all
    #[arg(long, requires = "oracle_poses")]
    method: Option<String>,
    /// Run directory whose weights rank paths
    #[arg(long, requires = "oracle_poses")]
    checkpoint: Option<PathBuf>,
    /// The arm: xarm7 or panda [default: that of the run, else xarm7]
    #[arg(long, value_name = "NAME", value_parser = Robot::by_name)]
    robot: Option<Arc<Robot>>,
    /// Input of the choice of poses: the cameras' images (own), an image without points, or the
    /// start of another scene
    #[arg(long, value_enum, default_value_t = Observations::Own)]
    observations: Observations,
    /// Execute every candidate too: how far the chosen stays behind the best of all
    #[arg(long)]
    regret: bool,
}

/// Input of the choice of poses; the last two are ablations that an agent which uses its eyes
/// must fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Observations {
    Own,
    Blank,
    Foreign,
}

impl Observations {
    const fn shown(self) -> Option<Shown> {
        match self {
            Self::Own => None,
            Self::Blank => Some(Shown::Blank),
            Self::Foreign => Some(Shown::Foreign),
        }
    }
}

/// The report of `lpr eval`.
#[derive(Debug, Clone, Serialize)]
pub(super) struct EvalReport {
    task: String,
    method: String,
    observations: Observations,
    /// Seed of the first scene.
    first_scene: u64,
    episodes: u64,
    successes: u64,
    success_rate: f64,
    wilson95: [f64; 2],
    chosen: BTreeMap<&'static str, u64>,
    failures: BTreeMap<&'static str, u64>,
    /// Seeds of the scenes in which the task was not done.
    failed_scenes: Vec<u64>,
    policy_valid: u64,
    steps: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    regret: Option<f64>,
}

/// The report of an evaluation.
pub(super) fn evaluation_report(
    task: &str,
    method: &str,
    first_scene: u64,
    found: &Evaluation,
) -> EvalReport {
    EvalReport {
        task: task.to_owned(),
        method: method.to_owned(),
        observations: Observations::Own,
        first_scene,
        episodes: found.episodes,
        successes: found.successes,
        success_rate: found.success_rate(),
        wilson95: found.wilson95(),
        chosen: found.chosen.iter().map(|(source, count)| (source.name(), *count)).collect(),
        failures: found.failures.clone(),
        failed_scenes: found.failed_scenes.clone(),
        policy_valid: found.policy_valid,
        steps: found.steps,
        regret: None,
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<EvalReport> {
    let seeds = seed_range(arguments.seed, arguments.episodes)?;
    let Subject { agent, task, robot, cameras, config, method } = subject(arguments)?;
    let mut environment = simulator(&task, &robot, &cameras, &config)?;
    let best = method == BEST_OF_ALL;
    let found = match arguments.observations.shown() {
        Some(_) if agent.poses() == PoseSource::Oracle || best || arguments.regret => {
            let reason = "--observations: is for poses that a run has learned to see, without --oracle-poses and --regret";
            return Err(Failure::Usage(reason.to_owned()));
        }
        Some(shown) => evaluate_shown(&agent, &mut environment, shown, seeds.clone(), |_| {})?,
        None if best => best_of_all(&agent, &mut environment, seeds.clone(), |_| {})?,
        None => evaluate(&agent, &mut environment, seeds.clone(), |_| {})?,
    };
    let mut report = evaluation_report(&task.name, &method, arguments.seed, &found);
    report.observations = arguments.observations;
    if arguments.regret {
        report.regret = measure_regret(&agent, &mut environment, seeds)?.mean();
    }
    Ok(report)
}

/// The agent that is evaluated, and its world.
struct Subject {
    agent: Agent,
    task: Arc<Task>,
    robot: Arc<Robot>,
    cameras: Vec<String>,
    config: Config,
    method: String,
}

fn subject(arguments: &Arguments) -> Result<Subject> {
    match &arguments.checkpoint {
        Some(run) => {
            let task = task(&arguments.subject)?;
            let subject = trained(arguments, run)?;
            if subject.task.name == task.name {
                Ok(subject)
            } else {
                Err(foreign(run, "task", &subject.task.name, &task.name))
            }
        }
        None if arguments.oracle_poses => untrained(arguments),
        None => trained(arguments, Path::new(&arguments.subject)),
    }
}

/// The newest checkpoint of a run.
fn trained(arguments: &Arguments, run: &Path) -> Result<Subject> {
    let mut saved = run_directory::latest_agent(run)?;
    let task = Task::by_name(&saved.header.run.task)
        .map_err(|error| FileError::content(run, error.to_string()))?;
    let robot = Arc::clone(saved.agent.robot());
    if let Some(asked) = &arguments.robot
        && asked.name != robot.name
    {
        return Err(foreign(run, "robot", &robot.name, &asked.name));
    }
    let own = saved.agent.method().name();
    let method = arguments.method.as_deref().unwrap_or(own);
    if method != own && method != BEST_OF_ALL {
        return Err(foreign(run, "method", own, method));
    }
    if arguments.oracle_poses {
        saved.agent.networks.q_attention = None;
    }
    let method = method.to_owned();
    let cameras = saved.header.run.cameras;
    Ok(Subject { agent: saved.agent, task, robot, cameras, config: saved.header.config, method })
}

fn foreign(run: &Path, option: &str, found: &str, asked: &str) -> Failure {
    FileError::content(run, format!("is a run of {option} `{found}`, asked to evaluate `{asked}`"))
        .into()
}

fn task(name: &str) -> Result<Arc<Task>> {
    Task::by_name(name).map_err(|error| Failure::Usage(error.to_string()))
}

/// A method without weights, on the demonstrator's poses.
fn untrained(arguments: &Arguments) -> Result<Subject> {
    let task = task(&arguments.subject)?;
    let robot = arguments.robot.clone().unwrap_or_else(|| Arc::clone(ROBOTS[0]));
    let config = load_config("fast")?;
    let name = arguments.method.clone().unwrap_or_else(|| Method::C2fArm.name().to_owned());
    let unknown = |error: lpr_core::Error| Failure::Usage(format!("{error}, {BEST_OF_ALL}"));
    let method = if name == BEST_OF_ALL {
        Method::Random
    } else {
        Method::by_name(&name).map_err(unknown)?
    };
    if method.has_ranker() {
        let reason = format!(
            "--method {name}: needs --checkpoint: a ranker without weights chooses at random"
        );
        return Err(Failure::Usage(reason));
    }
    let init = Init { backend: Backend::Flex, seed: arguments.seed };
    let networks =
        Networks::new(config.network_settings(), &robot, method, PoseSource::Oracle, init)?;
    let agent = Agent::new(config.agent_settings(), &robot, method, networks);
    Ok(Subject { agent, task, robot, cameras: default_cameras(), config, method: name })
}

impl fmt::Display for EvalReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.wilson95.map(|bound| 100.0 * bound);
        let rate = 100.0 * self.success_rate;
        let Self { task, method, episodes, successes, .. } = self;
        writeln!(
            f,
            "{task} with {method}: {successes} of {episodes} episodes, {rate:.0} % (95 %: {low:.0} to {high:.0})"
        )?;
        match self.observations {
            Observations::Own => {}
            Observations::Blank => writeln!(f, "poses chosen without any point of the scene")?,
            Observations::Foreign => writeln!(f, "poses chosen from the points of another scene")?,
        }
        if let Some(regret) = self.regret {
            writeln!(f, "regret to the best of all candidates: {:.0} points", 100.0 * regret)?;
        }
        let counts = |map: &BTreeMap<&'static str, u64>| {
            map.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
        };
        writeln!(f, "chosen: {}", counts(&self.chosen))?;
        if !self.failures.is_empty() {
            writeln!(f, "failures: {}", counts(&self.failures))?;
        }
        Ok(())
    }
}
