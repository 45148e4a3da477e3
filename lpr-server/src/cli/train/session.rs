//! A run with the files that it writes.

use super::super::Result;
use super::super::eval::{evaluation_report, simulator};
use super::demonstrations::{self, Demonstrated};
use super::progress::{Bar, Meter, networks_line, slowness};
use super::{Arguments, Report, ValidationPoint, load_config};
use crate::animation;
use crate::artist::{Artist, BEAUTY, Size};
use crate::episode::EpisodeFile;
use crate::files;
use crate::images;
use crate::metrics::{self, MetricsWriter};
use crate::run_directory;
use crate::tensorboard::EventWriter;
use core::fmt;
use core::ops::Range;
use lpr_core::agent::{Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::env::Environment as _;
use lpr_core::evaluate::{evaluate, measure_regret};
use lpr_core::sim::SimEnvironment;
use lpr_core::train::{Metrics, Run, StepLog, Trainer};
use serde::Serialize;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Scene seeds that stopping and tuning look at.
const VALIDATION_SEEDS: u64 = 1000;
/// Scenes of a validation in which every candidate is executed.
const REGRET_SCENES: u64 = 3;
/// Scene seeds of the final evaluation, used once.
const TEST_SEEDS: Range<u64> = 5000..5100;
/// Scene seeds that validations take their scenes from, each other ones.
const N_VALIDATION_SEEDS: u64 = 1000;
/// Validation success at which a run stops by itself.
const GOOD_ENOUGH: f64 = 0.97;
/// Validations in a row that have to be that good together. With three, of a run that validates
/// often, chance stops too early.
const GOOD_VALIDATIONS: usize = 5;
/// Size of the animations that checkpoints leave.
const ANIMATION_SIZE: Size = Size { width: 240, height: 180 };

/// The table of `config.toml` that says what the run was of; a preset has none.
pub(super) const RUN_TABLE: &str = "run";

/// A run with the files that it writes.
pub(super) struct Session<'a> {
    arguments: &'a Arguments,
    trainer: Trainer<SimEnvironment>,
    environment: SimEnvironment,
    metrics: MetricsWriter,
    events: EventWriter,
    started: Instant,
    demonstrations_only: Option<ValidationPoint>,
    /// All so far, the one after demonstrations alone first.
    validations: Vec<ValidationPoint>,
    bar: Bar,
    meter: Meter,
}

/// What a validation found.
struct Validation {
    point: ValidationPoint,
    metrics: Metrics,
}

impl<'a> Session<'a> {
    pub(super) fn create(arguments: &'a Arguments) -> Result<Self> {
        let mut config = load_config(&arguments.preset)?;
        if let Some(demos) = arguments.demos {
            config.training.demonstrations = demos;
        }
        let run = Run {
            task: arguments.task.name.to_owned(),
            method: arguments.method,
            poses: if arguments.oracle_poses { PoseSource::Oracle } else { PoseSource::Learned },
            backend: arguments.backend,
            seed: arguments.seed,
            cameras: arguments.cameras.iter().map(|&name| name.to_owned()).collect(),
        };
        let environment = simulator(arguments.task, &arguments.robot.robot, &run.cameras, &config)?;
        files::refuse_non_empty(&arguments.out)?;
        let demos = match &arguments.demo_dir {
            Some(directory) => {
                demonstrations::of_directory(&environment, &config.demos, directory)?
            }
            None => demonstrations::scripted(
                &environment,
                &config.demos,
                run.seed,
                config.training.demonstrations,
            )?,
        };
        config.training.demonstrations = demos.len();
        let text = config_toml(&config, &run, &environment.robot().name, &demos)?;
        let mut trainer = Trainer::new(config, run, environment.clone())?;
        demonstrations::add(&mut trainer, &demos)?;
        run_directory::create(&arguments.out, &text)?;
        let metrics = MetricsWriter::create(&arguments.out)?;
        let events = EventWriter::create(&arguments.out, wall_clock())?;
        let mut session = Self::new(arguments, trainer, environment, metrics, events);
        session.warn_if_slow();
        session.learn_from_demonstrations()?;
        Ok(session)
    }

    pub(super) fn resume(arguments: &'a Arguments) -> Result<Self> {
        let (step, checkpoint) = run_directory::latest(&arguments.out)?;
        let unusable = |error| run_directory::unusable(&arguments.out, step, &error);
        let header = lpr_core::checkpoint::read_header(&checkpoint.weights).map_err(unusable)?;
        refuse_other_run(arguments, &header.run).map_err(unusable)?;
        let environment =
            simulator(arguments.task, &arguments.robot.robot, &header.run.cameras, &header.config)?;
        let trainer = Trainer::resume(&checkpoint, environment.clone()).map_err(unusable)?;
        run_directory::clean(&arguments.out)?;
        let metrics = MetricsWriter::resume(&arguments.out, step)?;
        let events = EventWriter::resume(&arguments.out, step)?;
        let mut session = Self::new(arguments, trainer, environment, metrics, events);
        session.bar.say(&format!("resumed at environment step {step}"));
        session.recall_time()?;
        session.recall_validations()?;
        Ok(session)
    }

    /// Time goes on from where the checkpoint was made, so that --minutes is a cap on the whole
    /// run.
    fn recall_time(&mut self) -> Result<()> {
        let seconds = metrics::history(&self.arguments.out, "wall_seconds")?
            .last()
            .map_or(0.0, |&(_, seconds)| seconds);
        let earlier = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        self.started = self.started.checked_sub(earlier).unwrap_or(self.started);
        Ok(())
    }

    /// What the validations before the checkpoint found: it decides when to stop, and the first is
    /// reported.
    fn recall_validations(&mut self) -> Result<()> {
        let episodes = metrics::history(&self.arguments.out, "validation/episodes")?;
        let successes = metrics::history(&self.arguments.out, "validation/successes")?;
        for ((step, episodes), (_, successes)) in episodes.into_iter().zip(successes) {
            let point = ValidationPoint::new(episodes as u64, successes as u64);
            if step == 0 {
                self.demonstrations_only = Some(point);
            }
            self.validations.push(point);
        }
        Ok(())
    }

    fn new(
        arguments: &'a Arguments,
        trainer: Trainer<SimEnvironment>,
        environment: SimEnvironment,
        metrics: MetricsWriter,
        events: EventWriter,
    ) -> Self {
        Self {
            arguments,
            trainer,
            environment,
            metrics,
            events,
            started: Instant::now(),
            demonstrations_only: None,
            validations: Vec::new(),
            bar: Bar::new(arguments.env_steps, 60.0 * arguments.minutes),
            meter: Meter::new(),
        }
    }

    /// Says before it starts what a large network will cost.
    fn warn_if_slow(&mut self) {
        let observation = self.environment.observe();
        let agent = self.trainer.agent();
        let Some(seen) = agent.attended(&observation) else { return };
        // The first pass also wakes threads and caches.
        let forward_seconds = (0..2).map(|_| {
            let start = Instant::now();
            let _ = agent.goal(&seen);
            start.elapsed().as_secs_f64()
        });
        let forward_seconds = forward_seconds.fold(f64::INFINITY, f64::min);
        let batch = self.trainer.config().training.q_attention_batch;
        if let Some(text) = slowness(batch, forward_seconds, self.arguments.minutes) {
            self.bar.say(&format!("preset {}: {text}", self.arguments.preset));
        }
    }

    /// The updates on demonstrations alone, and what they achieve.
    fn learn_from_demonstrations(&mut self) -> Result<()> {
        let total = self.trainer.demonstration_updates_left();
        if total == 0 {
            // The first update comes late: sizes are told now, and once more with the rate.
            self.bar.say(&networks_line(self.trainer.agent(), None));
        }
        while self.trainer.demonstration_updates_left() > 0 {
            let start = Instant::now();
            let metrics = self.trainer.update()?;
            self.measure_rate(1, start);
            self.bar.show(0, self.started.elapsed().as_secs_f64(), &metrics);
        }
        let Validation { point, .. } = self.validate()?;
        self.bar.say(&format!(
            "after {total} updates on demonstrations alone ({:.0} s): {} of {} validation episodes",
            self.started.elapsed().as_secs_f64(),
            point.successes,
            point.episodes
        ));
        self.demonstrations_only = Some(point);
        self.save()
    }

    /// Trains until something stops it; says what.
    pub(super) fn train(&mut self) -> Result<&'static str> {
        loop {
            if let Some(reason) = self.reason_to_stop() {
                self.bar.finish();
                return Ok(reason);
            }
            let (start, before) = (Instant::now(), self.n_updates());
            let log = self.trainer.step()?;
            self.measure_rate(log.updates - before, start);
            self.write(&log)?;
            let steps = log.progress.env_steps;
            self.bar.show(steps, self.started.elapsed().as_secs_f64(), &log.metrics);
            if steps % self.trainer.config().training.validation_interval == 0 {
                let validation = self.validate()?;
                self.report_progress(steps, &validation);
                self.save()?;
            }
        }
    }

    fn reason_to_stop(&self) -> Option<&'static str> {
        let progress = self.trainer.progress();
        if self.arguments.env_steps.is_some_and(|most| progress.env_steps >= most) {
            Some("env_steps")
        } else if self
            .arguments
            .stop_after_successes
            .is_some_and(|most| progress.successes_in_a_row >= most)
        {
            Some("successes")
        } else if is_good_enough(&self.validations) {
            Some("validation")
        } else if self.started.elapsed().as_secs_f64() >= 60.0 * self.arguments.minutes {
            Some("minutes")
        } else {
            None
        }
    }

    /// Says once how large the networks are and how fast they learn.
    fn measure_rate(&mut self, updates: u64, since: Instant) {
        if let Some(rate) = self.meter.count(updates, since) {
            self.bar.say(&networks_line(self.trainer.agent(), Some(rate)));
        }
    }

    /// Success on the validation scenes, what the chosen paths were worth and, with the
    /// demonstrator's poses, how far they stay behind the best candidates.
    fn validate(&mut self) -> Result<Validation> {
        let n = self.trainer.config().training.validation_episodes;
        let mut values = Vec::new();
        // Fresh scenes each time: chance on one set of them would decide when to stop.
        let first = VALIDATION_SEEDS
            + self.validations.len() as u64 * n % N_VALIDATION_SEEDS.saturating_sub(n).max(1);
        let seeds = |n| first..first + n;
        let agent = self.trainer.agent();
        let found = evaluate(agent, &mut self.environment, seeds(n), |episode| {
            values.extend_from_slice(&episode.values)
        })?;
        let mut metrics = Metrics::default();
        metrics.push("validation/episodes", found.episodes as f32);
        metrics.push("validation/successes", found.successes as f32);
        metrics.push("validation/success_rate", found.success_rate() as f32);
        metrics.push_mean("validation/value_chosen", values.iter().map(|value| value.expected));
        metrics.push_mean("validation/value_realised", values.iter().map(|value| value.realised));
        metrics.push_mean(
            "validation/value_error",
            values.iter().map(|value| (value.expected - value.realised).abs()),
        );
        if agent.poses() == PoseSource::Oracle && agent.method().has_ranker() {
            let regret = measure_regret(agent, &mut self.environment, seeds(n.min(REGRET_SCENES)))?;
            metrics.push_mean(
                "validation/regret",
                regret.mean().into_iter().map(|regret| regret as f32),
            );
        }
        let point = ValidationPoint::new(found.episodes, found.successes);
        self.validations.push(point);
        self.bar.set_success(point.successes, point.episodes);
        let validation = Validation { point, metrics };
        self.write_metrics(self.trainer.progress().env_steps, &validation.metrics)?;
        Ok(validation)
    }

    fn write(&mut self, log: &StepLog) -> Result<()> {
        self.write_metrics(log.progress.env_steps, &log.metrics)
    }

    fn write_metrics(&mut self, env_steps: u64, metrics: &Metrics) -> Result<()> {
        let mut values: Vec<(&str, f64)> =
            metrics.iter().map(|(name, value)| (name, f64::from(value))).collect();
        values.push(("updates", self.n_updates() as f64));
        values.push(("wall_seconds", self.started.elapsed().as_secs_f64()));
        self.metrics.write(env_steps, &values)?;
        let scalars: Vec<_> = metrics.iter().collect();
        Ok(self.events.write_scalars(env_steps, wall_clock(), &scalars)?)
    }

    fn report_progress(&self, steps: u64, validation: &Validation) {
        let seconds = self.started.elapsed().as_secs_f64();
        let left = (60.0 * self.arguments.minutes - seconds).max(0.0);
        let Validation { point, metrics } = validation;
        let regret = metrics
            .get("validation/regret")
            .map_or(String::new(), |regret| format!(", regret {regret:.2}"));
        self.bar.say(&format!(
            "step {steps}, {} updates, {seconds:.0} s (at most {left:.0} s left): {} of {} validation episodes{regret}",
            self.n_updates(),
            point.successes,
            point.episodes
        ));
    }

    /// Updates of the network that was updated most.
    fn n_updates(&self) -> u64 {
        let updates = self.trainer.updates();
        updates.paths.max(updates.q_attention)
    }

    /// A checkpoint, and with it an episode of the agent as it is now.
    fn save(&mut self) -> Result<()> {
        let checkpoint = self.trainer.checkpoint()?;
        let step = self.trainer.progress().env_steps;
        run_directory::save(&self.arguments.out, step, &checkpoint)?;
        self.save_episode(step)
    }

    /// The first validation scene as an episode file and as an animation, so that what was learned
    /// can be looked at.
    fn save_episode(&mut self, step: u64) -> Result<()> {
        let path = run_directory::episode_path(&self.arguments.out, step)?;
        if path.exists() {
            return Ok(());
        }
        let episode =
            EpisodeFile::record(self.trainer.agent(), &mut self.environment, VALIDATION_SEEDS)?;
        let pictures = animation::episode(&episode, &mut Artist::quick(BEAUTY, ANIMATION_SIZE))?;
        let drawn = run_directory::animation_path(&self.arguments.out, step)?;
        images::write_gif(&drawn, ANIMATION_SIZE.width, ANIMATION_SIZE.height, &pictures)?;
        Ok(episode.write(&path)?)
    }

    pub(super) fn finish(mut self, stopped_by: &'static str) -> Result<Report> {
        let wall_seconds = self.started.elapsed().as_secs_f64();
        self.save()?;
        let found = evaluate(self.trainer.agent(), &mut self.environment, TEST_SEEDS, |_| {})?;
        let progress = self.trainer.progress();
        let report = Report {
            task: self.arguments.task.name.to_owned(),
            method: self.trainer.run().method.name(),
            oracle_poses: self.trainer.run().poses == PoseSource::Oracle,
            seed: self.trainer.run().seed,
            env_steps: progress.env_steps,
            episodes: progress.episodes,
            updates: self.n_updates(),
            wall_seconds,
            stopped_by,
            demonstrations_only: self.demonstrations_only,
            eval: evaluation_report(
                self.arguments.task.name,
                self.trainer.run().method.name(),
                &found,
            ),
        };
        run_directory::write_summary(&self.arguments.out, &report)?;
        Ok(report)
    }
}

/// Whether the last validations together say that the task is learned.
fn is_good_enough(validations: &[ValidationPoint]) -> bool {
    let Some(last) = validations.last_chunk::<GOOD_VALIDATIONS>() else { return false };
    let successes: u64 = last.iter().map(|point| point.successes).sum();
    let episodes: u64 = last.iter().map(|point| point.episodes).sum();
    successes as f64 >= GOOD_ENOUGH * episodes as f64
}

/// Refuses to go on with a run of other options than those that are given. Options with their
/// default value may be left out.
fn refuse_other_run(arguments: &Arguments, run: &Run) -> lpr_core::Result<()> {
    let differs = |option: &str, found: &dyn fmt::Display, asked: &dyn fmt::Display| {
        Err(lpr_core::Error::Checkpoint(format!(
            "of {option} `{found}`, asked to resume `{asked}`"
        )))
    };
    if run.task != arguments.task.name {
        return differs("task", &run.task, &arguments.task.name);
    }
    if arguments.method != Method::Lpr && arguments.method != run.method {
        return differs("method", &run.method.name(), &arguments.method.name());
    }
    if arguments.seed != 0 && arguments.seed != run.seed {
        return differs("seed", &run.seed, &arguments.seed);
    }
    if arguments.oracle_poses && run.poses == PoseSource::Learned {
        return differs("poses", &"learned", &"--oracle-poses");
    }
    Ok(())
}

fn wall_clock() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// `config.toml`: every setting, and what the run is of. As a preset it is read without the latter.
fn config_toml(config: &Config, run: &Run, robot: &str, demos: &[Demonstrated]) -> Result<String> {
    #[derive(Serialize)]
    struct Section<'a> {
        run: RunSection<'a>,
    }
    #[derive(Serialize)]
    struct RunSection<'a> {
        robot: &'a str,
        #[serde(flatten)]
        run: &'a Run,
        /// Scene seeds.
        demonstrations: Vec<u64>,
    }
    let demonstrations = demos.iter().map(|demo| demo.scene_seed).collect();
    let section = Section { run: RunSection { robot, run, demonstrations } };
    let section = toml::to_string(&section)
        .map_err(|error| lpr_core::Error::Config(format!("--seed: {error}")))?;
    Ok(format!("{}\n{section}", config.to_toml()))
}
