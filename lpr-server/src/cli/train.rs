//! `lpr train`: Algorithm 1 on a task, with validation, checkpoints and a final evaluation.

use super::eval::{EvalReport, evaluation_report, simulator};
use super::{Failure, Result, RobotArgument};
use crate::files::FileError;
use crate::metrics::MetricsWriter;
use crate::run_directory;
use crate::tensorboard::EventWriter;
use clap::Args;
use core::fmt;
use core::ops::Range;
use lpr_core::agent::{Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::evaluate::{Evaluation, evaluate};
use lpr_core::nn::Backend;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::record_demo;
use lpr_core::sim::tasks::Task;
use lpr_core::train::{Run, StepLog, Trainer, default_cameras, demonstration_scene};
use serde::Serialize;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Scene seeds that stopping and tuning look at.
const VALIDATION_SEEDS: u64 = 1000;
/// Scene seeds of the final evaluation, used once.
const TEST_SEEDS: Range<u64> = 5000..5100;
/// Validation success at which a run stops by itself.
const GOOD_ENOUGH: f64 = 0.97;
/// Validations in a row that have to be that good.
const GOOD_VALIDATIONS: usize = 2;

/// Options of `lpr train`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The task; `lpr tasks` lists them
    #[arg(value_parser = Task::by_name)]
    task: &'static Task,
    /// Directory of the run, empty or absent unless --resume is given
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    robot: RobotArgument,
    /// How paths are chosen: lpr, lpr-no-policy or c2farm
    #[arg(long, value_parser = Method::by_name, default_value = Method::Lpr.name())]
    method: Method,
    /// A built-in preset (fast, paper, paper-narrow) or a file that lists every setting
    #[arg(long, default_value = "fast")]
    preset: String,
    /// Demonstrations, in place of the preset's number
    #[arg(long)]
    demos: Option<usize>,
    /// Take next-best poses from the demonstrator: only paths are learned
    #[arg(long)]
    oracle_poses: bool,
    /// Seed of everything drawn
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Stop after this many environment steps
    #[arg(long)]
    env_steps: Option<u64>,
    /// Stop after this many minutes of training
    #[arg(long, default_value_t = 15.0)]
    minutes: f64,
    /// Stop after this many training episodes in a row that succeeded
    #[arg(long)]
    stop_after_successes: Option<u64>,
    /// Go on from the newest checkpoint in --out
    #[arg(long)]
    resume: bool,
}

/// What `lpr train` reports and writes to `summary.json`.
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
}

/// A validation on seeds that neither training nor the final evaluation uses.
#[derive(Debug, Clone, Copy, Serialize)]
struct ValidationPoint {
    episodes: u64,
    successes: u64,
    success_rate: f64,
}

impl From<&Evaluation> for ValidationPoint {
    fn from(evaluation: &Evaluation) -> Self {
        let Evaluation { episodes, successes, .. } = *evaluation;
        Self { episodes, successes, success_rate: evaluation.success_rate() }
    }
}

/// A run with the files that it writes.
struct Session<'a> {
    arguments: &'a Arguments,
    trainer: Trainer<SimEnvironment>,
    environment: SimEnvironment,
    metrics: MetricsWriter,
    events: EventWriter,
    started: Instant,
    demonstrations_only: Option<ValidationPoint>,
    good_validations: usize,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    if !(arguments.minutes.is_finite() && arguments.minutes > 0.0) {
        return Err(lpr_core::Error::Config(format!("--minutes: above 0, got {}", arguments.minutes)).into());
    }
    if !matches!(arguments.method, Method::Lpr | Method::LprNoPolicy | Method::C2fArm) {
        let name = arguments.method.name();
        return Err(lpr_core::Error::Config(format!("--method: `{name}` has nothing to train, use `lpr eval`")).into());
    }
    let mut session = if arguments.resume { Session::resume(arguments)? } else { Session::create(arguments)? };
    let stopped_by = session.train()?;
    session.finish(stopped_by)
}

fn wall_clock() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Progress for people, on standard error; nobody may be listening.
fn say(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// The preset of that name, or the file of that path.
pub(super) fn load_config(preset: &str) -> Result<Config> {
    let path = Path::new(preset);
    if !path.exists() {
        return Ok(Config::preset(preset)?);
    }
    let text = std::fs::read_to_string(path).map_err(FileError::io("read", path))?;
    Config::from_toml(&text).map_err(|error| FileError::content(path, error.to_string()).into())
}

impl<'a> Session<'a> {
    fn create(arguments: &'a Arguments) -> Result<Self> {
        let mut config = load_config(&arguments.preset)?;
        if let Some(demos) = arguments.demos {
            config.training.demonstrations = demos;
        }
        let poses = if arguments.oracle_poses { PoseSource::Oracle } else { PoseSource::Learned };
        let cameras = default_cameras();
        let environment = simulator(arguments.task, arguments.robot.robot, &cameras, &config)?;
        let run = Run {
            task: arguments.task.name.to_owned(),
            method: arguments.method,
            poses,
            backend: Backend::Flex,
            seed: arguments.seed,
            cameras,
        };
        run_directory::create(&arguments.out, &config.to_toml())?;
        let mut trainer = Trainer::new(config, run, environment.clone())?;
        add_demonstrations(&mut trainer, &environment)?;
        let metrics = MetricsWriter::create(&arguments.out)?;
        let events = EventWriter::create(&arguments.out, wall_clock())?;
        let mut session = Self::new(arguments, trainer, environment, metrics, events);
        session.learn_from_demonstrations()?;
        Ok(session)
    }

    fn resume(arguments: &'a Arguments) -> Result<Self> {
        let (step, checkpoint) = run_directory::latest(&arguments.out)?;
        let header = lpr_core::checkpoint::read_header(&checkpoint.weights)?;
        if header.run.task != arguments.task.name {
            let (found, asked) = (&header.run.task, arguments.task.name);
            return Err(lpr_core::Error::Checkpoint(format!("of task `{found}`, asked to resume `{asked}`")).into());
        }
        let environment = simulator(arguments.task, arguments.robot.robot, &header.run.cameras, &header.config)?;
        let trainer = Trainer::resume(&checkpoint, environment.clone())?;
        let metrics = MetricsWriter::resume(&arguments.out, step)?;
        let events = EventWriter::resume(&arguments.out, step)?;
        say(&format!("resumed at environment step {step}"));
        Ok(Self::new(arguments, trainer, environment, metrics, events))
    }

    fn new(
        arguments: &'a Arguments,
        trainer: Trainer<SimEnvironment>,
        environment: SimEnvironment,
        metrics: MetricsWriter,
        events: EventWriter,
    ) -> Self {
        let started = Instant::now();
        Self { arguments, trainer, environment, metrics, events, started, demonstrations_only: None, good_validations: 0 }
    }

    /// The updates on demonstrations alone, and what they achieve.
    fn learn_from_demonstrations(&mut self) -> Result<()> {
        let total = self.trainer.demonstration_updates_left();
        while self.trainer.demonstration_updates_left() > 0 {
            self.trainer.update()?;
        }
        let validation = self.validate()?;
        say(&format!(
            "after {total} updates on demonstrations alone ({:.0} s): {} of {} validation episodes",
            self.started.elapsed().as_secs_f64(),
            validation.successes,
            validation.episodes
        ));
        self.demonstrations_only = Some(validation);
        self.save()
    }

    /// Trains until something stops it; says what.
    fn train(&mut self) -> Result<&'static str> {
        loop {
            if let Some(reason) = self.reason_to_stop() {
                return Ok(reason);
            }
            let log = self.trainer.step()?;
            self.write(&log)?;
            let steps = log.progress.env_steps;
            if steps % self.trainer.config().training.validation_interval == 0 {
                let validation = self.validate()?;
                self.report_progress(steps, &validation);
                self.save()?;
                let good = validation.success_rate >= GOOD_ENOUGH;
                self.good_validations = if good { self.good_validations + 1 } else { 0 };
            }
        }
    }

    fn reason_to_stop(&self) -> Option<&'static str> {
        let progress = self.trainer.progress();
        if self.arguments.env_steps.is_some_and(|most| progress.env_steps >= most) {
            Some("env_steps")
        } else if self.arguments.stop_after_successes.is_some_and(|most| progress.successes_in_a_row >= most) {
            Some("successes")
        } else if self.good_validations >= GOOD_VALIDATIONS {
            Some("validation")
        } else if self.started.elapsed().as_secs_f64() >= 60.0 * self.arguments.minutes {
            Some("minutes")
        } else {
            None
        }
    }

    fn validate(&mut self) -> Result<ValidationPoint> {
        let n = self.trainer.config().training.validation_episodes;
        let seeds = VALIDATION_SEEDS..VALIDATION_SEEDS + n;
        let found = evaluate(self.trainer.agent(), &mut self.environment, seeds, |_| {})?;
        Ok(ValidationPoint::from(&found))
    }

    fn write(&mut self, log: &StepLog) -> Result<()> {
        let mut values: Vec<(&str, f64)> = log.metrics.iter().map(|(name, value)| (name, f64::from(value))).collect();
        values.push(("updates", log.updates as f64));
        values.push(("wall_seconds", self.started.elapsed().as_secs_f64()));
        self.metrics.write(log.progress.env_steps, &values)?;
        let scalars: Vec<_> = log.metrics.iter().collect();
        Ok(self.events.write_scalars(log.progress.env_steps, wall_clock(), &scalars)?)
    }

    fn report_progress(&self, steps: u64, validation: &ValidationPoint) {
        let seconds = self.started.elapsed().as_secs_f64();
        let left = (60.0 * self.arguments.minutes - seconds).max(0.0);
        say(&format!(
            "step {steps}, {} updates, {seconds:.0} s (at most {left:.0} s left): {} of {} validation episodes",
            self.trainer.updates().paths.max(self.trainer.updates().q_attention),
            validation.successes,
            validation.episodes
        ));
    }

    fn save(&self) -> Result<()> {
        let checkpoint = self.trainer.checkpoint()?;
        Ok(run_directory::save(&self.arguments.out, self.trainer.progress().env_steps, &checkpoint)?)
    }

    fn finish(mut self, stopped_by: &'static str) -> Result<Report> {
        let wall_seconds = self.started.elapsed().as_secs_f64();
        self.save()?;
        let found = evaluate(self.trainer.agent(), &mut self.environment, TEST_SEEDS, |_| {})?;
        let progress = self.trainer.progress();
        let updates = self.trainer.updates();
        let report = Report {
            task: self.arguments.task.name.to_owned(),
            method: self.trainer.run().method.name(),
            oracle_poses: self.trainer.run().poses == PoseSource::Oracle,
            seed: self.trainer.run().seed,
            env_steps: progress.env_steps,
            episodes: progress.episodes,
            updates: updates.paths.max(updates.q_attention),
            wall_seconds,
            stopped_by,
            demonstrations_only: self.demonstrations_only,
            eval: evaluation_report(self.arguments.task.name, self.trainer.run().method.name(), &found),
        };
        run_directory::write_summary(&self.arguments.out, &report)?;
        Ok(report)
    }
}

/// Records demonstrations until the configuration's number has succeeded, each with its augmentation.
fn add_demonstrations(trainer: &mut Trainer<SimEnvironment>, environment: &SimEnvironment) -> Result<()> {
    /// Demonstrations that may fail for each that is asked for.
    const TRIES: u64 = 4;
    let wanted = trainer.config().training.demonstrations;
    let settings = trainer.config().demos.clone();
    let seed = trainer.run().seed;
    let mut recorded = 0;
    for demo in 0..wanted as u64 * TRIES {
        if recorded == wanted {
            break;
        }
        if let Some(chains) = record_demo(environment, demonstration_scene(seed, demo), &settings)? {
            chains.iter().try_for_each(|chain| trainer.add_demonstration(chain))?;
            recorded += 1;
        }
    }
    if recorded < wanted {
        let reason = format!("only {recorded} of {wanted} demonstrations succeeded");
        return Err(Failure::Core(lpr_core::Error::Environment(reason)));
    }
    Ok(())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, method, env_steps, episodes, updates, wall_seconds, stopped_by, .. } = self;
        writeln!(f, "{task} with {method}: {env_steps} environment steps in {episodes} episodes, {updates} updates")?;
        writeln!(f, "{wall_seconds:.0} s of training, stopped by {stopped_by}")?;
        if let Some(first) = &self.demonstrations_only {
            writeln!(f, "after demonstrations alone: {} of {} validation episodes", first.successes, first.episodes)?;
        }
        self.eval.fmt(f)
    }
}
