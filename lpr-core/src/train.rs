//! Algorithm 1 of the paper: a coarse-to-fine agent with learned path ranking learns from
//! demonstrations and from what it tries.
//!
//! [`Trainer::step`] is the algorithm's loop with the paper's line numbers. It runs one environment
//! step and the gradient steps that follow, so that the caller decides when to stop, to look and to
//! save, and reads clocks.
//!
//! # Differences from the paper
//!
//! - Before the first environment step come updates on the demonstrations alone
//!   (`training.demonstration_updates`). Q-attention and the path networks have their own numbers of
//!   updates per environment step.
//! - One call is one environment step: the loops over episodes and steps (lines 4 and 5) are the
//!   caller's.
//! - A transition enters the replay when its episode ends: only then is it known whether the
//!   episode succeeded, which the policy's loss asks for. The released code does the same.
//! - What running out of steps means is a setting: [`Timeout`].
//! - A pose that no path reaches ends the episode. Its step teaches Q-attention, and neither ranker
//!   nor policy.

mod episode;
mod log;

pub(crate) use episode::{Choice, Episode, Taken};
pub(crate) use log::chosen_values;
pub use log::{ChosenValue, EpisodeLog, Metrics, StepLog};

use crate::agent::{Action, Agent, Draws, Eyes, Init, Method, Networks, PoseSource};
use crate::config::{Config, Timeout};
use crate::demo::{Alternatives, DemoEpisode};
use crate::env::{Environment, StepResult};
use crate::error::{Error, Result};
use crate::learner::{AttentionUpdate, Learner, PathUpdate};
use crate::nn::Backend;
use crate::path::CandidateStreams;
use crate::rng::{Stream, stream};

use rand::Rng as _;
use serde::{Deserialize, Serialize};

/// Task, method, seed and the rest that, with the configuration, decide a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Name of the task; for people, the trainer asks its environment.
    pub task: String,
    /// The way in which paths are chosen.
    pub method: Method,
    /// Source of the next-best poses.
    pub poses: PoseSource,
    /// Implementation that computes the networks.
    pub backend: Backend,
    /// Seed of everything drawn.
    pub seed: u64,
    /// Names of the cameras that the agent sees with.
    #[serde(default = "default_cameras")]
    pub cameras: Vec<String>,
}

/// The camera of a run that names none.
#[must_use]
pub fn default_cameras() -> Vec<String> {
    vec!["front".to_owned()]
}

/// Progress of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Environment steps: macro actions.
    pub env_steps: u64,
    /// Episodes that ended.
    pub episodes: u64,
    /// Episodes that succeeded since the last that did not.
    pub successes_in_a_row: u64,
}

/// A run of Algorithm 1 between two environment steps.
#[derive(Debug)]
pub struct Trainer<E> {
    pub(crate) config: Config,
    pub(crate) run: Run,
    pub(crate) agent: Agent,
    pub(crate) learner: Learner,
    pub(crate) progress: Progress,
    pub(crate) episode: Option<Episode>,
    environment: E,
}

impl<E: Environment> Trainer<E> {
    /// Lines 1–3 of Algorithm 1 without the demonstrations: see [`Self::add_demonstration`].
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when settings cannot work.
    pub fn new(config: Config, run: Run, environment: E) -> Result<Self> {
        let robot = environment.robot();
        let init = Init { backend: run.backend, seed: run.seed };
        // Lines 1 and 2: Q-attention, policy and ranker with fresh parameters.
        let networks =
            Networks::new(config.network_settings(), robot, run.method, run.poses, init)?;
        let agent = Agent::new(config.agent_settings(), robot, run.method, networks);
        // Line 3: the buffer.
        let learner = Learner::new(&config.replay, config.ranker.sampling, run.seed)?;
        Ok(Self {
            config,
            run,
            agent,
            learner,
            progress: Progress::default(),
            episode: None,
            environment,
        })
    }

    /// Line 3: a chain of keyframes, as keyframe discovery and demo augmentation make them, into
    /// the buffer.
    ///
    /// # Errors
    ///
    /// When the demonstration has no steps.
    pub fn add_demonstration(&mut self, demo: &DemoEpisode) -> Result<()> {
        episode::add_demonstration(demo, &self.config.demos, &self.agent, &mut self.learner)
    }

    /// Updates on the demonstrations alone that are still to be made before the first environment
    /// step.
    #[must_use]
    pub fn demonstration_updates_left(&self) -> u64 {
        let networks = &self.agent.networks;
        let has_nothing_to_learn = self.learner.n_transitions() == 0
            || networks.ranker.is_none()
                && networks.policy.is_none()
                && networks.q_attention.is_none();
        if has_nothing_to_learn || self.progress.env_steps > 0 {
            return 0;
        }
        self.config.training.demonstration_updates.saturating_sub(self.made_updates())
    }

    /// One update of every network on what the buffer holds, without an environment step.
    ///
    /// # Errors
    ///
    /// [`Error::Diverged`] when a network does not learn any more.
    pub fn update(&mut self) -> Result<Metrics> {
        let mut updates = Updates::default();
        updates.q_attention.extend(self.update_q_attention()?);
        updates.paths.push(self.update_paths()?);
        let mut metrics = Metrics::default();
        updates.write(&mut metrics);
        Ok(metrics)
    }

    /// Algorithm 1, lines 4–22: one environment step and the gradient steps after it.
    ///
    /// # Errors
    ///
    /// When the scene of an episode cannot be built;
    /// [`Error::Diverged`] when a network does not learn any more.
    pub fn step(&mut self) -> Result<StepLog> {
        // Lines 4 and 5: for each iteration, for each environment step t.
        let mut episode = self.running_episode()?;
        // Lines 6–12: o_t ← (b_t, p_t, z_t); g_t ← Q_θ(o_t); Ξ ← paths to g_t; ξ* ← argmax Q^R(Ξ).
        let draws = self.draws();
        let action = self
            .agent
            .decide(&mut self.environment, Eyes::Open, draws)
            .map_err(|error| self.explained(error))?;
        // Line 13: o_{t+1}, r ← env.step(ξ*).
        let result = self.agent.execute(&mut self.environment, &action)?;
        // Line 14: D ← D ∪ {(o_t, g_t, r, o_{t+1}, ξ*)}, once the episode's end is known.
        episode.push(&action, &result);
        self.progress.env_steps += 1;
        let ended = self.store_if_ended(episode, &result)?;
        // Lines 15–22: end for; for each gradient step: update Q_θ, μ ← μ - λ ∇J_π, σ ← σ - λ ∇J_R,
        // σ' ← τσ + (1-τ)σ'.
        let updates = self.gradient_steps()?;
        Ok(self.log(action, result, ended, &updates))
    }

    fn gradient_steps(&mut self) -> Result<Updates> {
        let mut updates = Updates::default();
        let settings = &self.config.training;
        if self.learner.n_transitions() < settings.transitions_before_updates {
            return Ok(updates);
        }
        let (n_q_attention, n_paths) =
            (settings.q_attention_updates_per_step, settings.path_updates_per_step);
        for _ in 0..n_q_attention {
            updates.q_attention.extend(self.update_q_attention()?);
        }
        for _ in 0..n_paths {
            updates.paths.push(self.update_paths()?);
        }
        Ok(updates)
    }

    fn update_q_attention(&mut self) -> Result<Option<AttentionUpdate>> {
        let Some(attention) = &mut self.agent.networks.q_attention else { return Ok(None) };
        self.learner.update_q_attention(attention, self.config.training.q_attention_batch)
    }

    fn update_paths(&mut self) -> Result<PathUpdate> {
        let batch_size = self.config.training.path_batch;
        let with_alternatives = self.shows_alternatives();
        self.learner.update_paths(&mut self.agent.networks, batch_size, with_alternatives)
    }

    /// The episode that is under way, or a new one.
    fn running_episode(&mut self) -> Result<Episode> {
        if let Some(episode) = self.episode.take() {
            return Ok(episode);
        }
        let seed = training_scene(self.run.seed, self.progress.episodes);
        self.environment.reset(seed)?;
        Ok(Episode::new(seed))
    }

    fn draws(&self) -> Draws {
        let step = self.progress.env_steps;
        let streams = CandidateStreams { seed: self.run.seed, step };
        Draws { streams, exploration: self.config.training.exploration.at(step) }
    }

    /// Line 14 for a whole episode.
    fn store_if_ended(
        &mut self,
        mut episode: Episode,
        last: &StepResult,
    ) -> Result<Option<EpisodeLog>> {
        if !last.is_last() {
            self.episode = Some(episode);
            return Ok(None);
        }
        let bootstraps = self.config.training.timeout == Timeout::Truncated;
        if last.truncated && !last.terminated && bootstraps {
            self.decide_once_more(&mut episode)?;
        }
        episode.store(&self.agent, &mut self.learner);
        let log = episode.log(self.progress.episodes, last, self.config.ranker.discount);
        self.progress.episodes += 1;
        self.progress.successes_in_a_row =
            if log.success { self.progress.successes_in_a_row + 1 } else { 0 };
        Ok(Some(log))
    }

    /// Decides once more after the last step of an episode that was cut off: the step's value
    /// bootstraps from this decision.
    fn decide_once_more(&mut self, episode: &mut Episode) -> Result<()> {
        /// Numbers of the draws that no environment step takes.
        const AFTER_THE_END: u64 = 1 << 39;
        // A demonstrator may have no further pose: then nothing follows.
        if self.agent.is_out_of_poses(&self.environment) {
            return Ok(());
        }
        let streams =
            CandidateStreams { seed: self.run.seed, step: AFTER_THE_END | self.progress.env_steps };
        let draws = Draws::greedy(streams);
        let action = self.agent.decide(&mut self.environment, Eyes::Open, draws)?;
        episode.push_next(&action);
        Ok(())
    }

    fn log(
        &self,
        action: Action,
        result: StepResult,
        episode: Option<EpisodeLog>,
        updates: &Updates,
    ) -> StepLog {
        let mut metrics = Metrics::default();
        log::write_action(&action, &result, &mut metrics);
        if let Some(episode) = &episode {
            log::write_episode(episode, &mut metrics);
        }
        updates.write(&mut metrics);
        let (progress, updates) = (self.progress, self.made_updates());
        StepLog { progress, updates, action, result, episode, metrics }
    }

    /// Updates of the network that was updated most.
    fn made_updates(&self) -> u64 {
        let made = self.learner.updates();
        made.paths.max(made.q_attention)
    }
}

impl<E> Trainer<E> {
    /// True if the next update of the ranker sees alternatives of demonstrated ways.
    pub(crate) fn shows_alternatives(&self) -> bool {
        match self.config.demos.alternatives {
            Alternatives::Never => false,
            Alternatives::First => self.progress.env_steps == 0,
            Alternatives::Always => true,
        }
    }

    /// The agent as it is now, to evaluate or to save.
    #[must_use]
    pub const fn agent(&self) -> &Agent {
        &self.agent
    }

    /// Every setting.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// The run that is trained.
    #[must_use]
    pub const fn run(&self) -> &Run {
        &self.run
    }

    /// Its progress.
    #[must_use]
    pub const fn progress(&self) -> Progress {
        self.progress
    }

    /// Updates of ranker and policy, and of Q-attention.
    #[must_use]
    pub const fn updates(&self) -> crate::learner::UpdateCounts {
        self.learner.updates()
    }

    /// `error` of the agent, and for answers that are no numbers the update after which they are
    /// none: [`Error::Diverged`].
    #[must_use]
    pub fn explained(&self, error: Error) -> Error {
        self.learner.explained(error)
    }

    /// The world that it acts in.
    pub const fn environment(&mut self) -> &mut E {
        &mut self.environment
    }
}

/// Scene seed of training episode `episode` of a run with `seed`: never one that an evaluation
/// uses.
#[must_use]
pub fn training_scene(seed: u64, episode: u64) -> u64 {
    (1 << 32) | u64::from(stream(seed, Stream::Placement, episode).next_u32())
}

/// Scene seed of demonstration `demo` for a run with `seed`: never one of training or evaluation.
#[must_use]
pub fn demonstration_scene(seed: u64, demo: u64) -> u64 {
    (2 << 32) | u64::from(stream(seed, Stream::Demo, demo).next_u32())
}

/// Findings of the gradient steps after an environment step.
#[derive(Debug, Default)]
struct Updates {
    q_attention: Vec<AttentionUpdate>,
    paths: Vec<PathUpdate>,
}

impl Updates {
    fn write(&self, metrics: &mut Metrics) {
        metrics.push_mean("losses/q_attention", self.q_attention.iter().map(|update| update.loss));
        metrics.push_mean(
            "value/q_attention_target",
            self.q_attention.iter().map(|update| update.mean_target),
        );
        metrics.push_mean(
            "losses/ranker",
            self.paths.iter().filter_map(|update| Some(update.ranker?.0)),
        );
        metrics
            .push_mean("td_error", self.paths.iter().filter_map(|update| Some(update.ranker?.1)));
        metrics.push_mean("losses/policy", self.paths.iter().filter_map(|update| update.policy));
    }
}

#[cfg(test)]
pub(crate) mod tests;
