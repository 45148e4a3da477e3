//! `lpr bench`: micro-benchmarks by names that stay the same from version to version.

mod networks;
mod planning;
mod resets;
mod simulation;

use super::failure::{Failure, Result};
use super::settings::default_preset;
use core::fmt;
use lpr_core::agent::{Agent, Init, Method, Networks, PoseSource};
use lpr_core::config::Config;

use lpr_core::nn::Backend;
use lpr_core::robot::XARM7;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::Task;
use serde::Serialize;
use std::borrow::Cow;
use std::hint::black_box;
use std::time::Instant;

/// Runs at least, after one that is not counted.
const MIN_RUNS: usize = 5;
/// Runs at most.
const MAX_RUNS: usize = 1000;
/// No further run begins after this, seconds.
const SECONDS: f64 = 1.0;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The measurements
    #[arg(value_enum, value_name = "WHAT")]
    subject: Subject,
    /// Threads [default: those of the machine]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Subject {
    Networks,
    Simulation,
    Resets,
    Planning,
    Candidates,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    results: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Row {
    name: Cow<'static, str>,
    threads: usize,
    median_ms: f64,
    min_ms: f64,
    runs: usize,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global()
            .map_err(|error| Failure::Usage(format!("--threads {threads}: {error}")))?;
    }
    let results = match arguments.subject {
        Subject::Networks => networks::run()?,
        Subject::Simulation => simulation::run()?,
        Subject::Resets => resets::run()?,
        Subject::Planning => planning::run()?,
        Subject::Candidates => vec![candidates()?],
    };
    Ok(Report { results })
}

/// Times `run`, whose result keeps it from being optimised away.
fn measure<T>(name: impl Into<Cow<'static, str>>, mut run: impl FnMut() -> T) -> Row {
    black_box(run());
    let begin = Instant::now();
    let mut millis = Vec::new();
    while millis.len() < MIN_RUNS
        || millis.len() < MAX_RUNS && begin.elapsed().as_secs_f64() < SECONDS
    {
        let start = Instant::now();
        black_box(run());
        millis.push(start.elapsed().as_secs_f64() * 1e3);
    }
    millis.sort_by(f64::total_cmp);
    let (median_ms, min_ms) = (millis[millis.len() / 2], millis[0]);
    Row {
        name: name.into(),
        threads: rayon::current_num_threads(),
        median_ms,
        min_ms,
        runs: millis.len(),
    }
}

impl Row {
    /// The same for one of `n` equal parts of a run: what is too short for the clock is measured in
    /// many.
    fn per(self, n: usize) -> Self {
        Self { median_ms: self.median_ms / n as f64, min_ms: self.min_ms / n as f64, ..self }
    }
}

/// The scene that is planned, simulated and looked at.
fn environment(config: &Config) -> Result<SimEnvironment> {
    const SCENE: u64 = 1000;
    let task = Task::by_name("toilet_seat_up")?;
    Ok(SimEnvironment::new(&task, &XARM7, SCENE, &["front"], &config.simulator)?)
}

/// An untrained agent of the preset `fast`: what it costs does not depend on its weights.
fn agent(config: &Config, poses: PoseSource) -> Result<Agent> {
    let init = Init { backend: Backend::Flex, seed: 0 };
    let networks = Networks::new(config.network_settings(), &XARM7, Method::Lpr, poses, init)?;
    Ok(Agent::new(config.agent_settings(), &XARM7, Method::Lpr, networks))
}

/// Algorithm 1 from the next-best pose to the path that runs: obstacles, 20 planner, 20 Bézier and
/// one policy path, ranked.
fn candidates() -> Result<Row> {
    use lpr_core::agent::{Draws, Goal};
    let config = default_preset();
    let (agent, mut env) = (agent(&config, PoseSource::Oracle)?, environment(&config)?);
    let observation = env.observe();
    let goal = env.plan().goals[0];
    let mut step = 0;
    Ok(measure("candidates_41", || {
        step += 1;
        let draws = Draws::greedy(lpr_core::path::CandidateStreams { seed: 0, step });
        agent.act(Goal::given(observation.clone(), goal), draws)
    }))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<40} {:>7} {:>12} {:>12} {:>6}",
            "name", "threads", "median ms", "least ms", "runs"
        )?;
        self.results.iter().try_for_each(|Row { name, threads, median_ms, min_ms, runs }| {
            writeln!(f, "{name:<40} {threads:>7} {median_ms:>12.6} {min_ms:>12.6} {runs:>6}")
        })
    }
}
