//! A run with the files that it writes.

mod evaluating;

use super::demonstrations;
use super::interruption::{Interruption, continuing_command};
use super::progress::{Bar, Limits, Meter, Phase, Workload, networks_line, slowness};
use super::setup::{config_toml, demonstrate, refuse_other_run};
use super::{Arguments, Report, ValidationPoint};
use crate::animation;
use crate::artist::{Artist, BEAUTY, Size};
use crate::cli::arguments::VALIDATION_SEEDS;
use crate::cli::eval::evaluation_report;
use crate::cli::failure::{Failure, Result};
use crate::cli::settings::load_config;
use crate::cli::simulator::simulator;
use crate::episode::EpisodeFile;
use crate::files;
use crate::images;
use crate::metrics::{self, MetricsWriter};
use crate::run_directory;
use crate::tensorboard::EventWriter;
use evaluating::{TEST_SEEDS, Validation};
use lpr_core::agent::{Eyes, PoseSource};
use lpr_core::env::Environment as _;
use lpr_core::sim::SimEnvironment;
use lpr_core::train::{Metrics, Run, StepLog, Trainer};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Validation success at which a run stops by itself.
const GOOD_ENOUGH: f64 = 0.97;
/// Validations in a row that have to be that good together. With three, of a run that validates
/// often, chance stops too early.
const GOOD_VALIDATIONS: usize = 5;
/// Size of the animations that checkpoints leave.
const ANIMATION_SIZE: Size = Size { width: 240, height: 180 };

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
    /// Some training episode has succeeded.
    succeeded: bool,
    bar: Bar,
    meter: Meter,
    interruption: Interruption,
}

/// The parts of a run that was made or found.
struct Parts {
    trainer: Trainer<SimEnvironment>,
    environment: SimEnvironment,
    metrics: MetricsWriter,
    events: EventWriter,
    bar: Bar,
}

impl<'a> Session<'a> {
    pub(super) fn create(arguments: &'a Arguments, interruption: Interruption) -> Result<Self> {
        let mut config = load_config(&arguments.preset)?;
        if let Some(demos) = arguments.demos {
            config.training.demonstrations = demos;
        }
        let run = Run {
            task: arguments.task.name.clone(),
            method: arguments.method,
            poses: if arguments.oracle_poses { PoseSource::Oracle } else { PoseSource::Learned },
            backend: arguments.backend,
            seed: arguments.seed,
            cameras: arguments.cameras.iter().map(|&name| name.to_owned()).collect(),
        };
        let environment =
            simulator(&arguments.task, &arguments.robot.robot, &run.cameras, &config)?;
        files::refuse_non_empty(&arguments.out)?;
        let (mut bar, before) = (new_bar(arguments), Instant::now());
        let demos = demonstrate(arguments, &environment, &config, &mut bar, &interruption)?;
        config.training.demonstrations = demos.len();
        let text = config_toml(&config, &run, &environment.robot().name, &demos)?;
        let mut trainer = Trainer::new(config, run, environment.clone())?;
        demonstrations::add(&mut trainer, &demos)?;
        run_directory::create(&arguments.out, &text)?;
        let metrics = MetricsWriter::create(&arguments.out)?;
        let events = EventWriter::create(&arguments.out, wall_clock())?;
        let parts = Parts { trainer, environment, metrics, events, bar };
        let mut session = Self::new(arguments, parts, interruption);
        let n_demos = session.trainer.config().training.demonstrations;
        let seconds = before.elapsed().as_secs_f64();
        session.bar.say(&format!("{}: {n_demos} in {seconds:.0} s", Phase::Demonstrations));
        session.warn_if_slow();
        session.learn_from_demonstrations()?;
        Ok(session)
    }

    pub(super) fn resume(arguments: &'a Arguments, interruption: Interruption) -> Result<Self> {
        let (step, checkpoint) = run_directory::latest(&arguments.out)?;
        let unusable = |error| run_directory::unusable(&arguments.out, step, &error);
        let header = lpr_core::checkpoint::read_header(&checkpoint.weights).map_err(unusable)?;
        refuse_other_run(arguments, &header.run).map_err(unusable)?;
        let environment = simulator(
            &arguments.task,
            &arguments.robot.robot,
            &header.run.cameras,
            &header.config,
        )?;
        let trainer = Trainer::resume(&checkpoint, environment.clone()).map_err(unusable)?;
        run_directory::clean(&arguments.out)?;
        let metrics = MetricsWriter::resume(&arguments.out, step)?;
        let events = EventWriter::resume(&arguments.out, step)?;
        let bar = new_bar(arguments);
        bar.say(&format!("resumed at environment step {step}"));
        let parts = Parts { trainer, environment, metrics, events, bar };
        let mut session = Self::new(arguments, parts, interruption);
        session.recall_time()?;
        session.recall_validations()?;
        session.recall_success()?;
        if session.trainer.demonstration_updates_left() > 0 {
            session.learn_from_demonstrations()?;
        }
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

    /// Results of the validations before the checkpoint: they decide when to stop, and the first is
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

    /// The first success is announced once in a run.
    fn recall_success(&mut self) -> Result<()> {
        let successes = metrics::history(&self.arguments.out, "episode/success")?;
        self.succeeded = successes.iter().any(|&(_, success)| success > 0.0);
        Ok(())
    }

    fn new(arguments: &'a Arguments, parts: Parts, interruption: Interruption) -> Self {
        let Parts { trainer, environment, metrics, events, bar } = parts;
        Self {
            arguments,
            trainer,
            environment,
            metrics,
            events,
            started: Instant::now(),
            demonstrations_only: None,
            validations: Vec::new(),
            succeeded: false,
            bar,
            meter: Meter::new(),
            interruption,
        }
    }

    /// Warns of a large network before it starts.
    fn warn_if_slow(&mut self) {
        let observation = self.environment.observe();
        let agent = self.trainer.agent();
        if agent.poses() == PoseSource::Oracle {
            return;
        }
        // The first pass also wakes threads and caches.
        let forward_seconds = (0..2).map(|_| {
            let start = Instant::now();
            let _ = agent.attend(observation.clone(), Eyes::Open);
            start.elapsed().as_secs_f64()
        });
        let forward_seconds = forward_seconds.fold(f64::INFINITY, f64::min);
        let training = &self.trainer.config().training;
        let workload = Workload {
            batch: training.q_attention_batch,
            updates_per_step: training.q_attention_updates_per_step,
            env_steps: self.arguments.env_steps,
            minutes: self.arguments.minutes,
        };
        if let Some(text) = slowness(workload, forward_seconds) {
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
        self.bar.announce(Phase::DemonstrationUpdates, total, &total.to_string());
        while self.trainer.demonstration_updates_left() > 0 {
            self.stop_if_interrupted()?;
            let start = Instant::now();
            self.trainer.update().map_err(|error| self.stopped_by(error))?;
            self.measure_rate(1, start);
            self.bar.advance(total - self.trainer.demonstration_updates_left());
        }
        // A run that was killed between this validation and its checkpoint knows it already.
        let point = match self.demonstrations_only {
            Some(point) => point,
            None => self.validate()?.point,
        };
        self.bar.say(&format!(
            "after {total} updates on demonstrations alone ({:.0} s): {} of {} validation episodes",
            self.started.elapsed().as_secs_f64(),
            point.successes,
            point.episodes
        ));
        self.demonstrations_only = Some(point);
        self.save()
    }

    /// Trains until something stops it, whose name is returned.
    pub(super) fn train(&mut self) -> Result<&'static str> {
        self.bar.enter_training();
        self.bar.say(&format!("{}: {}", Phase::Training, end_of_training(self.arguments)));
        loop {
            self.stop_if_interrupted()?;
            if let Some(reason) = self.reason_to_stop() {
                return Ok(reason);
            }
            let (start, before) = (Instant::now(), self.n_updates());
            let log = self.trainer.step().map_err(|error| self.stopped_by(error))?;
            self.measure_rate(log.updates - before, start);
            self.write(&log)?;
            self.announce_first_success(&log);
            let steps = log.progress.env_steps;
            self.bar.show(steps, self.started.elapsed().as_secs_f64(), &log.metrics);
            if steps % self.trainer.config().training.validation_interval == 0 {
                let validation = self.validate()?;
                self.report_progress(steps, &validation);
                self.save()?;
                self.bar.enter_training();
            }
        }
    }

    /// Says of a run that diverged what is left of it.
    fn stopped_by(&self, error: lpr_core::Error) -> Failure {
        let error = self.trainer.explained(error);
        if matches!(error, lpr_core::Error::Diverged { .. }) {
            self.bar.finish();
            let left = match run_directory::latest_step(&self.arguments.out) {
                Ok(Some(step)) => format!("the checkpoint of environment step {step} is good"),
                _ => "nothing was saved yet".to_owned(),
            };
            let steps = self.trainer.progress().env_steps;
            self.bar.say(&format!("environment step {steps}: the run diverged; {left}"));
        }
        error.into()
    }

    fn announce_first_success(&mut self, log: &StepLog) {
        let Some(episode) = log.episode.as_ref().filter(|episode| episode.success) else { return };
        if self.succeeded {
            return;
        }
        self.succeeded = true;
        self.bar.say(&format!(
            "first success: training episode {}, environment step {}, {:.0} s",
            episode.episode,
            log.progress.env_steps,
            self.started.elapsed().as_secs_f64()
        ));
    }

    /// Ends the run in good order when a signal has asked for that.
    fn stop_if_interrupted(&self) -> Result<()> {
        if !self.interruption.has_come() {
            return Ok(());
        }
        self.bar.finish();
        self.save_checkpoint()?;
        let out = self.arguments.out.display();
        self.bar.say(&format!("saved at environment step {}", self.trainer.progress().env_steps));
        self.bar.say(&format!("{}; all metrics: {out}/{}", self.curve()?, metrics::FILE_NAME));
        let command = continuing_command(std::env::args_os());
        self.bar.say(&format!("continue with: {command}"));
        Err(Failure::Interrupted)
    }

    /// Success of the validations so far, in a line.
    fn curve(&self) -> Result<String> {
        let rates = metrics::history(&self.arguments.out, "validation/success_rate")?;
        if rates.is_empty() {
            return Ok("no validation so far".to_owned());
        }
        let points = rates.iter().map(|(step, rate)| format!("{:.0} % at {step}", 100.0 * rate));
        let points: Vec<_> = points.collect();
        Ok(format!("validation success by environment step: {}", points.join(", ")))
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
        } else if !self.arguments.no_early_stop && is_good_enough(&self.validations) {
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
        self.save_checkpoint()?;
        self.save_episode(self.trainer.progress().env_steps)
    }

    fn save_checkpoint(&self) -> Result<()> {
        let checkpoint = self.trainer.checkpoint()?;
        let step = self.trainer.progress().env_steps;
        Ok(run_directory::save(&self.arguments.out, step, &checkpoint)?)
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
        let found = self.test()?;
        let diagnosis = self.diagnose()?;
        self.bar.finish();
        let progress = self.trainer.progress();
        let report = Report {
            task: self.arguments.task.name.clone(),
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
                &self.arguments.task.name,
                self.trainer.run().method.name(),
                TEST_SEEDS.start,
                &found,
            ),
            diagnosis,
        };
        run_directory::write_summary(&self.arguments.out, &report)?;
        Ok(report)
    }
}

fn new_bar(arguments: &Arguments) -> Bar {
    Bar::new(Limits { env_steps: arguments.env_steps, seconds: 60.0 * arguments.minutes })
}

/// The ends of training, in words.
fn end_of_training(arguments: &Arguments) -> String {
    let steps = arguments.env_steps.map(|steps| format!("{steps} environment steps"));
    let successes = arguments.stop_after_successes.map(|most| format!("{most} successes in a row"));
    let minutes = Some(format!("{} minutes", arguments.minutes));
    let validations = (!arguments.no_early_stop).then(|| "good validations".to_owned());
    let ends: Vec<_> = [steps, successes, minutes, validations].into_iter().flatten().collect();
    format!("until {}", ends.join(" or "))
}

/// Holds when the last validations together say that the task is learned.
fn is_good_enough(validations: &[ValidationPoint]) -> bool {
    let Some(last) = validations.last_chunk::<GOOD_VALIDATIONS>() else { return false };
    let successes: u64 = last.iter().map(|point| point.successes).sum();
    let episodes: u64 = last.iter().map(|point| point.episodes).sum();
    successes as f64 >= GOOD_ENOUGH * episodes as f64
}

fn wall_clock() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
