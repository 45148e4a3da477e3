//! Greedy evaluation over fixed scenes: how often the task is done, with what paths, and why not.

mod best_of_all;
mod record;

#[cfg(feature = "sim")]
pub(crate) use best_of_all::best_candidate;
pub use best_of_all::{Regret, best_of_all, measure_regret};
pub use record::{RecordedStep, record_episode};

use crate::agent::{Action, Agent, Draws, Eyes};
use crate::env::{EPISODE_LENGTH, Environment, StepResult};
use crate::error::Result;
use crate::path::{CandidateStreams, Source};
use crate::perception::View;
use crate::train::{ChosenValue, chosen_values};

use core::ops::Range;
use std::collections::BTreeMap;

/// The factor of the standard error that makes a 95 % interval.
const Z_95: f64 = 1.959_964;

/// Findings of an evaluation.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Evaluation {
    /// Episodes run.
    pub episodes: u64,
    /// Episodes in which the task was done.
    pub successes: u64,
    /// Paths that ran, by their generator.
    pub chosen: BTreeMap<Source, u64>,
    /// Episodes that failed, by reason: names of invalid actions, `timeout` and `not_done`.
    pub failures: BTreeMap<&'static str, u64>,
    /// Seeds of their scenes.
    pub failed_scenes: Vec<u64>,
    /// Environment steps in which the policy's path was among the candidates.
    pub policy_valid: u64,
    /// Environment steps.
    pub steps: u64,
}

/// Input of Q-attention in place of the cameras' images: ablations that an agent which uses its
/// eyes must fail.
///
/// Proprioception, and the obstacles that paths are checked against, stay those of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// An image in which no pixel sees a point.
    Blank,
    /// The start of another scene of the task, whose seed is greater by [`FOREIGN_SEED_OFFSET`].
    Foreign,
}

/// From the seed of a scene to that of the scene which [`Shown::Foreign`] shows.
pub const FOREIGN_SEED_OFFSET: u64 = 1000;

/// An episode of an evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct EvaluatedEpisode {
    /// Seed of its scene.
    pub scene_seed: u64,
    /// Environment steps.
    pub steps: u64,
    /// The reason why the task was not done; none when it was.
    pub failure: Option<&'static str>,
    /// Value of the agent's choice and the discounted reward that came of it, for each step that
    /// ranked paths.
    pub values: Vec<ChosenValue>,
}

impl Evaluation {
    /// Share of episodes in which the task was done, 0 to 1.
    #[must_use]
    pub fn success_rate(&self) -> f64 {
        if self.episodes == 0 { 0.0 } else { self.successes as f64 / self.episodes as f64 }
    }

    /// The 95 % confidence interval of the success rate: see [`wilson_interval`].
    #[must_use]
    pub fn wilson95(&self) -> [f64; 2] {
        wilson95(self.successes, self.episodes)
    }

    fn add(&mut self, episode: &EvaluatedEpisode) {
        self.episodes += 1;
        self.steps += episode.steps;
        match episode.failure {
            None => self.successes += 1,
            Some(reason) => {
                *self.failures.entry(reason).or_default() += 1;
                self.failed_scenes.push(episode.scene_seed);
            }
        }
    }

    fn add_action(&mut self, action: &Action) {
        self.policy_valid += action.n_from(Source::Policy) as u64;
        if let Some(candidate) = action.path() {
            *self.chosen.entry(candidate.source).or_default() += 1;
        }
    }
}

/// [`wilson_interval`] of 95 %.
pub(crate) fn wilson95(successes: u64, trials: u64) -> [f64; 2] {
    wilson_interval(successes, trials, Z_95)
}

/// The score interval of a binomial proportion at `z` standard errors (Wilson 1927); 0 to 1 without
/// trials.
#[must_use]
pub fn wilson_interval(successes: u64, trials: u64, z: f64) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 1.0];
    }
    let n = trials as f64;
    let p = successes as f64 / n;
    let center = p + z * z / (2.0 * n);
    let spread = z * libm::sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n));
    let scale = 1.0 + z * z / n;
    [((center - spread) / scale).max(0.0), ((center + spread) / scale).min(1.0)]
}

/// Runs the agent greedily in the scenes of `seeds`; `on_episode` hears of each episode.
///
/// The episode of a scene depends on its seed and the agent alone, not on the other scenes.
///
/// # Errors
///
/// When a scene cannot be built, the environment fails, or a network's answer is not a number.
pub fn evaluate(
    agent: &Agent,
    environment: &mut impl Environment,
    seeds: Range<u64>,
    mut on_episode: impl FnMut(&EvaluatedEpisode),
) -> Result<Evaluation> {
    let mut evaluation = Evaluation::default();
    for seed in seeds {
        let mut run = |environment: &mut _, action: &Action| {
            evaluation.add_action(action);
            agent.execute(environment, action)
        };
        let episode = run_episode(agent, environment, seed, Eyes::Open, &mut run)?;
        evaluation.add(&episode);
        on_episode(&episode);
    }
    Ok(evaluation)
}

/// [`evaluate`] while Q-attention is shown something else than the scene.
///
/// # Errors
///
/// As [`evaluate`].
pub fn evaluate_shown<E: Environment + Clone>(
    agent: &Agent,
    environment: &mut E,
    shown: Shown,
    seeds: Range<u64>,
    mut on_episode: impl FnMut(&EvaluatedEpisode),
) -> Result<Evaluation> {
    let mut evaluation = Evaluation::default();
    for seed in seeds {
        let views = shown_views(environment, shown, seed)?;
        let mut run = |environment: &mut _, action: &Action| {
            evaluation.add_action(action);
            agent.execute(environment, action)
        };
        let episode = run_episode(agent, environment, seed, Eyes::Shown(&views), &mut run)?;
        evaluation.add(&episode);
        on_episode(&episode);
    }
    Ok(evaluation)
}

/// Images that Q-attention is shown in every step of the episode of scene `seed`.
fn shown_views<E: Environment + Clone>(
    environment: &E,
    shown: Shown,
    seed: u64,
) -> Result<Vec<View>> {
    let mut environment = environment.clone();
    match shown {
        Shown::Blank => {
            let views = environment.observe()?.views;
            Ok(views.into_iter().map(|view| View::empty(view.camera)).collect())
        }
        Shown::Foreign => {
            environment.reset(seed.wrapping_add(FOREIGN_SEED_OFFSET))?;
            Ok(environment.observe()?.views)
        }
    }
}

/// One greedy episode in which `run` executes every action.
fn run_episode<E: Environment>(
    agent: &Agent,
    environment: &mut E,
    seed: u64,
    eyes: Eyes<'_>,
    run: &mut impl FnMut(&mut E, &Action) -> Result<StepResult>,
) -> Result<EvaluatedEpisode> {
    environment.reset(seed)?;
    let mut steps = 0;
    let mut rewards = Vec::new();
    loop {
        let draws = Draws::greedy(CandidateStreams { seed, step: steps });
        let action = agent.decide(environment, eyes, draws)?;
        let result = run(environment, &action)?;
        rewards.push((action.chosen_value(), result.reward));
        steps += 1;
        if result.is_last() || steps >= EPISODE_LENGTH as u64 {
            let values = chosen_values(rewards.into_iter(), agent.discount());
            let failure = result.failure();
            return Ok(EvaluatedEpisode { scene_seed: seed, steps, failure, values });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{Method, PoseSource};
    use crate::q_attention::{NetworkSettings, NextBestPose};
    use crate::robot::PANDA;
    use crate::toy::Toy;
    use crate::train::tests::{config, run, trainer};
    use crate::train::{Run, Trainer, demonstration_scene};
    use proptest::prelude::{prop_assert, proptest};

    #[test]
    fn the_interval_is_that_of_published_tables() {
        // Newcombe (1998), "Two-sided confidence intervals for the single proportion", table I,
        // method 3.
        let cases = [
            ((81, 263), [0.2553, 0.3662]),
            ((15, 148), [0.0624, 0.1605]),
            ((0, 20), [0.0, 0.1611]),
            ((1, 29), [0.0061, 0.1718]),
        ];
        for ((successes, trials), expected) in cases {
            let found = wilson_interval(successes, trials, Z_95);
            let error = |side: usize| (found[side] - expected[side]).abs();
            assert!(error(0) < 6e-5 && error(1) < 6e-5, "{successes} of {trials}: {found:?}");
        }
        assert_eq!(wilson_interval(0, 0, Z_95), [0.0, 1.0]);
    }

    proptest! {
        #[test]
        fn the_interval_holds_the_share_and_narrows_with_trials(successes in 0_u64..200, failures in 0_u64..200) {
            let trials = successes + failures;
            let [low, high] = wilson_interval(successes, trials, Z_95);
            prop_assert!((0.0..=1.0).contains(&low) && (0.0..=1.0).contains(&high));
            if trials > 0 {
                let share = successes as f64 / trials as f64;
                prop_assert!(low <= share + 1e-12 && share <= high + 1e-12);
                let [more_low, more_high] = wilson_interval(4 * successes, 4 * trials, Z_95);
                prop_assert!(more_high - more_low < high - low);
            }
        }
    }

    /// A trainer whose agent has learned a little of where to look.
    fn attentive() -> Trainer<Toy> {
        let mut config = config();
        config.q_attention.voxels_per_side = 8;
        config.q_attention.rotation_bins = 24;
        config.q_attention.network = NetworkSettings::Fast {
            cell_channels: 8,
            block_channels: 12,
            head_channels: 4,
            attended_channels: 4,
            hidden: 16,
            harmonics: 4,
        };
        config.training.q_attention_batch = 4;
        let run = Run { poses: PoseSource::Learned, ..run(Method::Linear, 3) };
        let mut trainer =
            Trainer::new(config, run, Toy::new(&PANDA).unwrap()).expect("valid settings");
        for seed in 0..3 {
            let demo = Toy::new(&PANDA)
                .unwrap()
                .demonstration(demonstration_scene(3, seed))
                .expect("within reach");
            trainer.add_demonstration(&demo).expect("two keyframes");
        }
        while trainer.demonstration_updates_left() > 0 {
            trainer.update().expect("finite losses");
        }
        trainer
    }

    /// The pose that the agent comes to at the start of scene `seed`, and how it values every voxel
    /// of every depth.
    fn first_pose(agent: &Agent, shown: Option<Shown>, seed: u64) -> (NextBestPose, Vec<Vec<f32>>) {
        let mut toy = Toy::new(&PANDA).unwrap();
        let views = shown.map(|shown| shown_views(&toy, shown, seed).expect("within reach"));
        toy.reset(seed).expect("within reach");
        let eyes = views.as_deref().map_or(Eyes::Open, Eyes::Shown);
        let draws = Draws::greedy(CandidateStreams { seed, step: 0 });
        let action = agent.decide(&mut toy, eyes, draws).expect("finite values");
        let depths = action.attention.expect("poses are learned").depths;
        (action.goal, depths.into_iter().map(|depth| depth.values).collect())
    }

    #[test]
    fn a_foreign_cloud_leads_to_the_pose_of_its_scene_and_a_blank_one_to_one_pose_everywhere() {
        let trainer = attentive();
        let agent = trainer.agent();
        let blank = first_pose(agent, Some(Shown::Blank), 0);
        for seed in 0..4 {
            let own = first_pose(agent, None, seed);
            let foreign = first_pose(agent, Some(Shown::Foreign), seed);
            assert_eq!(foreign, first_pose(agent, None, seed + FOREIGN_SEED_OFFSET));
            assert_eq!(first_pose(agent, Some(Shown::Blank), seed), blank);
            assert!(own != foreign && own != blank, "the agent looks at the scene");
        }
    }

    #[test]
    fn an_agent_with_the_demonstrators_poses_does_what_it_did_whatever_is_shown() {
        let trainer = trainer(config(), Method::Lpr, 1);
        let own = evaluate(trainer.agent(), &mut Toy::new(&PANDA).unwrap(), 1000..1006, |_| ());
        for shown in [Shown::Blank, Shown::Foreign] {
            assert_eq!(
                evaluate_shown(
                    trainer.agent(),
                    &mut Toy::new(&PANDA).unwrap(),
                    shown,
                    1000..1006,
                    |_| ()
                ),
                own
            );
        }
    }
}
