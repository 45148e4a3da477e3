//! `lpr eval`: greedy evaluation of a run, or of a method with the demonstrator's poses.

use super::train::load_config;
use super::{Failure, Result, RobotArgument};
use crate::run_directory;
use clap::Args;
use core::fmt;
use lpr_core::agent::{Agent, Init, Method, Networks, PoseSource};
use lpr_core::checkpoint::load_agent;
use lpr_core::config::Config;
use lpr_core::evaluate::{Evaluation, best_of_all, evaluate, measure_regret};
use lpr_core::nn::Backend;
use lpr_core::path::Source;
use lpr_core::perception::Camera;
use lpr_core::robot::Robot;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::Task;
use lpr_core::train::default_cameras;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Name of the oracle among the methods.
const BEST_OF_ALL: &str = "best-of-all";

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
    #[command(flatten)]
    robot: RobotArgument,
    /// Execute every candidate too: how far the chosen stays behind the best of all
    #[arg(long)]
    regret: bool,
}

/// What `lpr eval` reports.
#[derive(Debug, Clone, Serialize)]
pub(super) struct EvalReport {
    task: String,
    method: String,
    episodes: u64,
    successes: u64,
    success_rate: f64,
    wilson95: [f64; 2],
    chosen: BTreeMap<&'static str, u64>,
    failures: BTreeMap<&'static str, u64>,
    policy_valid: u64,
    steps: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    regret: Option<f64>,
}

/// The simulator with a configuration's settings.
pub(super) fn simulator(
    task: &'static Task,
    robot: &'static Robot,
    cameras: &[String],
    config: &Config,
) -> Result<SimEnvironment> {
    /// Any scene: every episode is reset to its own.
    const FIRST_SCENE: u64 = 1000;
    let cameras: Vec<_> = cameras.iter().map(|name| Camera::known_name(name)).collect::<Result<_, _>>()?;
    let mut environment = SimEnvironment::new(task, robot, FIRST_SCENE, &cameras, &config.simulator)?;
    environment.set_timing(config.timing.clone());
    Ok(environment)
}

/// The report of an evaluation.
pub(super) fn evaluation_report(task: &str, method: &str, found: &Evaluation) -> EvalReport {
    EvalReport {
        task: task.to_owned(),
        method: method.to_owned(),
        episodes: found.episodes,
        successes: found.successes,
        success_rate: found.success_rate(),
        wilson95: found.wilson95(),
        chosen: found.chosen.iter().map(|(source, count)| (source_name(*source), *count)).collect(),
        failures: found.failures.clone(),
        policy_valid: found.policy_valid,
        steps: found.steps,
        regret: None,
    }
}

const fn source_name(source: Source) -> &'static str {
    match source {
        Source::Planner => "planner",
        Source::Bezier => "bezier",
        Source::Policy => "policy",
        Source::Linear => "linear",
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<EvalReport> {
    let Subject { agent, task, robot, cameras, config, method } = subject(arguments)?;
    let mut environment = simulator(task, robot, &cameras, &config)?;
    let seeds = arguments.seed..arguments.seed + arguments.episodes;
    let found = if method == BEST_OF_ALL {
        best_of_all(&agent, &mut environment, seeds.clone(), |_| {})?
    } else {
        evaluate(&agent, &mut environment, seeds.clone(), |_| {})?
    };
    let mut report = evaluation_report(task.name, &method, &found);
    if arguments.regret {
        report.regret = measure_regret(&agent, &mut environment, seeds)?.mean();
    }
    Ok(report)
}

/// What is evaluated.
struct Subject {
    agent: Agent,
    task: &'static Task,
    robot: &'static Robot,
    cameras: Vec<String>,
    config: Config,
    method: String,
}

fn subject(arguments: &Arguments) -> Result<Subject> {
    let run = arguments.checkpoint.clone().or_else(|| (!arguments.oracle_poses).then(|| PathBuf::from(&arguments.subject)));
    let Some(run) = run else { return untrained(arguments) };
    let (_, checkpoint) = run_directory::latest(&run)?;
    let saved = load_agent(&checkpoint.weights)?;
    let task = Task::by_name(&saved.header.run.task)?;
    let robot = Robot::by_name(&saved.header.robot)?;
    let method = saved.header.run.method.name().to_owned();
    let cameras = saved.header.run.cameras;
    Ok(Subject { agent: saved.agent, task, robot, cameras, config: saved.header.config, method })
}

/// A method without weights, on the demonstrator's poses.
fn untrained(arguments: &Arguments) -> Result<Subject> {
    let task = Task::by_name(&arguments.subject)?;
    let robot = arguments.robot.robot;
    let config = load_config("fast")?;
    let name = arguments.method.clone().unwrap_or_else(|| Method::C2fArm.name().to_owned());
    let method = if name == BEST_OF_ALL { Method::Random } else { Method::by_name(&name)? };
    if method.has_ranker() {
        let reason = format!("method `{name}` needs --checkpoint: a ranker without weights chooses at random");
        return Err(Failure::Core(lpr_core::Error::Config(reason)));
    }
    let init = Init { backend: Backend::Flex, seed: arguments.seed };
    let networks = Networks::new(&config, robot, method, PoseSource::Oracle, init)?;
    let agent = Agent::new(&config, robot, method, networks);
    Ok(Subject { agent, task, robot, cameras: default_cameras(), config, method: name })
}

impl fmt::Display for EvalReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.wilson95.map(|bound| 100.0 * bound);
        let rate = 100.0 * self.success_rate;
        let Self { task, method, episodes, successes, .. } = self;
        writeln!(f, "{task} with {method}: {successes} of {episodes} episodes, {rate:.0} % (95 %: {low:.0} to {high:.0})")?;
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
