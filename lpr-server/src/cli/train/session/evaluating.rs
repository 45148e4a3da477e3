//! Validations of a run, and its final evaluation.

use super::{Session, ValidationPoint};
use crate::cli::arguments::VALIDATION_SEEDS;
use crate::cli::failure::Result;
use crate::cli::train::demonstrations;
use crate::cli::train::progress::Phase;
use crate::run_directory;
use core::ops::Range;
use lpr_core::agent::PoseSource;
use lpr_core::diagnose::{Diagnosis, DiagnosisSettings, Subject, diagnose, references};
use lpr_core::evaluate::{Evaluation, evaluate, measure_regret};
use lpr_core::train::Metrics;

/// Scene seeds that validations take their scenes from, each other ones.
const N_VALIDATION_SEEDS: u64 = 1000;
/// Scenes of a validation in which every candidate is executed.
const REGRET_SCENES: u64 = 3;
/// Scene seeds of the final evaluation, used once.
pub(super) const TEST_SEEDS: Range<u64> = 5000..5100;

/// Scenes of the diagnosis at the end of a run; `lpr diagnose` looks at more.
const DIAGNOSIS_SCENES: u64 = 10;
/// Scene seeds of the diagnosis: the last of the validations', which few runs get to.
const DIAGNOSIS_SEEDS: u64 = VALIDATION_SEEDS + N_VALIDATION_SEEDS - DIAGNOSIS_SCENES;

/// Success and measurements of a validation.
pub(super) struct Validation {
    pub(super) point: ValidationPoint,
    pub(super) metrics: Metrics,
}

impl Session<'_> {
    /// Success on the validation scenes, what the chosen paths were worth and, with the
    /// demonstrator's poses, how far they stay behind the best candidates.
    pub(super) fn validate(&mut self) -> Result<Validation> {
        let n = self.trainer.config().training.validation_episodes;
        let mut values = Vec::new();
        // Fresh scenes each time: chance on one set of them would decide when to stop.
        let first = VALIDATION_SEEDS
            + self.validations.len() as u64 * n % N_VALIDATION_SEEDS.saturating_sub(n).max(1);
        let seeds = |n| first..first + n;
        let agent = self.trainer.agent();
        self.bar.enter(Phase::Validation, n);
        let found = evaluate(agent, &mut self.environment, seeds(n), |episode| {
            values.extend_from_slice(&episode.values);
            self.bar.advance(episode.scene_seed + 1 - first);
        })
        .map_err(|error| self.stopped_by(error))?;
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

    /// What the agent gets wrong, in scenes of no validation and of no final evaluation.
    pub(super) fn diagnose(&mut self) -> Result<Diagnosis> {
        self.stop_if_interrupted()?;
        let n = self.trainer.config().training.validation_episodes.min(DIAGNOSIS_SCENES);
        let seeds = DIAGNOSIS_SEEDS..DIAGNOSIS_SEEDS + n;
        self.bar.announce(Phase::Diagnosis, n, &format!("{n} scenes"));
        let scenes = run_directory::demonstration_scenes(&self.arguments.out)?;
        let demonstrations =
            demonstrations::again(&self.environment, &scenes, &self.trainer.config().demos)?;
        let references = references(&self.environment, seeds)?;
        let agent = self.trainer.agent();
        let subject = Subject {
            agent,
            demonstrations: &demonstrations,
            snapshots: &[],
            seed: self.trainer.run().seed,
        };
        Ok(diagnose(&subject, &references, DiagnosisSettings::BRIEF)?)
    }

    /// The final evaluation.
    pub(super) fn test(&mut self) -> Result<Evaluation> {
        let n_episodes = TEST_SEEDS.end - TEST_SEEDS.start;
        let text = format!("{n_episodes} episodes");
        self.bar.announce(Phase::FinalEvaluation, n_episodes, &text);
        let mut found = Evaluation::default();
        for seed in TEST_SEEDS {
            self.stop_if_interrupted()?;
            let agent = self.trainer.agent();
            add(&mut found, evaluate(agent, &mut self.environment, seed..seed + 1, |_| {})?);
            self.bar.advance(found.episodes);
        }
        Ok(found)
    }
}

/// Adds the counts of an evaluation in other scenes.
fn add(all: &mut Evaluation, some: Evaluation) {
    let Evaluation { episodes, successes, chosen, failures, failed_scenes, policy_valid, steps } =
        some;
    all.episodes += episodes;
    all.successes += successes;
    all.policy_valid += policy_valid;
    all.steps += steps;
    all.failed_scenes.extend(failed_scenes);
    for (source, count) in chosen {
        *all.chosen.entry(source).or_default() += count;
    }
    for (reason, count) in failures {
        *all.failures.entry(reason).or_default() += count;
    }
}
