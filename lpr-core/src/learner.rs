//! The learner: the replay buffers, and one gradient step of each network on what they hold
//! (Algorithm 1, lines 17–20).
//!
//! There is one buffer per question, and all share the steps that they hold: the ranker draws by
//! its temporal differences or uniformly ([`Sampling`]), the policy draws uniformly among the steps
//! of successful episodes, Q-attention draws by its own priorities.
//!
//! # Differences from the paper
//!
//! - Each network draws a batch of its own, by priorities where it has some: the ranker and
//!   Q-attention; the policy draws from successes only. The released code draws one batch for all
//!   networks and multiplies the policy's loss by the success of the episode. Where few episodes
//!   succeed, that leaves the policy next to nothing of a batch.

use crate::error::{Error, Result};
use crate::networks::Networks;
use crate::path::CandidateStreams;
use crate::q_attention::{QAttention, QObservation, QSample};
use crate::ranker::Sampling;
use crate::replay::{Draw, Replay, ReplaySettings, Step, Transition};
use crate::rng::{Rng, Stream, stream};

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The part of an observation that the replay keeps: the input of Q-attention, or nothing with the
/// demonstrator's poses.
pub type Seen = Option<QObservation>;

/// A step of experience.
pub type Row = Transition<Seen>;

/// Numbers of the generators of one update: one for each network.
const GENERATORS: u64 = 3;

/// A loss, a target or a temporal difference beyond this is of a network that diverges: values are
/// discounted rewards, of which an episode has at most one of 1.
const LARGEST: f32 = 1e4;

/// Updates so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UpdateCounts {
    /// Updates of ranker and policy.
    pub paths: u64,
    /// Updates of Q-attention.
    pub q_attention: u64,
}

/// The replay buffers (`D` in the paper) and what draws from them.
#[derive(Debug)]
pub struct Learner {
    seed: u64,
    /// Rows that the ranker learns from.
    pub(crate) paths: Replay<Row>,
    /// Rows of successful episodes, which the policy learns from.
    pub(crate) successes: Replay<Row>,
    /// Rows that Q-attention learns from.
    pub(crate) scenes: Replay<Row>,
    pub(crate) updates: UpdateCounts,
    /// The last batch of each network, to be named when the network diverges.
    last: BTreeMap<&'static str, Batch>,
}

/// An update and the rows that it learned from, by their numbers.
#[derive(Debug, Clone)]
struct Batch {
    update: u64,
    rows: Vec<u64>,
}

impl Batch {
    fn new(update: u64, draws: &[Draw]) -> Self {
        Self { update, rows: draws.iter().map(|draw| draw.row).collect() }
    }
}

/// Findings of one update of ranker and policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathUpdate {
    /// The ranker's loss and the mean absolute temporal difference.
    pub ranker: Option<(f32, f32)>,
    /// The policy's loss, square radians; none before the first success.
    pub policy: Option<f32>,
}

/// Findings of one update of Q-attention.
#[derive(Debug, Clone, PartialEq)]
pub struct AttentionUpdate {
    /// Loss, summed over depths.
    pub loss: f32,
    /// Mean of the targets.
    pub mean_target: f32,
}

impl Learner {
    /// Empty buffers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when the settings cannot work.
    pub fn new(settings: &ReplaySettings, ranker: Sampling, seed: u64) -> Result<Self> {
        Ok(Self {
            seed,
            paths: Replay::new(&Self::path_settings(settings, ranker))?,
            successes: Replay::new(&settings.uniform())?,
            scenes: Replay::new(settings)?,
            updates: UpdateCounts::default(),
            last: BTreeMap::new(),
        })
    }

    /// Settings of the buffer that the ranker learns from.
    pub(crate) fn path_settings(settings: &ReplaySettings, ranker: Sampling) -> ReplaySettings {
        match ranker {
            Sampling::Prioritised => settings.clone(),
            Sampling::Uniform => settings.uniform(),
        }
    }

    /// Keeps a step in which a path was taken.
    pub fn push_path(&mut self, row: &Row) {
        self.paths.push(row.clone());
        if row.episode_success {
            self.successes.push(row.clone());
        }
    }

    /// Keeps a step in which Q-attention chose a pose, unless `attention` cannot learn from it.
    pub fn push_scene(&mut self, row: &Row, attention: &QAttention) {
        if Self::is_scene(row, attention) {
            self.scenes.push(row.clone());
        }
    }

    /// Checks that Q-attention can learn from a row: it was seen, and the pose lies within the
    /// bounds of the first depth.
    pub(crate) fn is_scene(row: &Row, attention: &QAttention) -> bool {
        let is_seen = |step: &Step<Seen>| step.observation.is_some();
        let goal = &row.step.decision.context.goal;
        is_seen(&row.step)
            && row.next.as_deref().is_none_or(is_seen)
            && attention.codec().encode(goal).is_some()
    }

    /// Transitions added so far.
    #[must_use]
    pub const fn n_transitions(&self) -> u64 {
        let (paths, scenes) = (self.paths.added(), self.scenes.added());
        if paths > scenes { paths } else { scenes }
    }

    /// Streams of the alternatives to the demonstrated way with that number.
    pub(crate) const fn demonstration_streams(&self, number: u64) -> CandidateStreams {
        /// Numbers of the draws that no environment step takes.
        const DEMONSTRATIONS: u64 = 1 << 38;
        CandidateStreams { seed: self.seed, step: DEMONSTRATIONS | number }
    }

    /// Updates so far.
    #[must_use]
    pub const fn updates(&self) -> UpdateCounts {
        self.updates
    }

    /// Line 17: one gradient step of Q-attention; none before there is something to learn from.
    ///
    /// # Errors
    ///
    /// [`Error::Diverged`] when the network does not learn any more.
    pub fn update_q_attention(
        &mut self,
        attention: &mut QAttention,
        batch_size: usize,
    ) -> Result<Option<AttentionUpdate>> {
        let update = self.updates.q_attention;
        let draws = self.scenes.sample(batch_size, &mut self.generator(update, 2));
        if draws.is_empty() {
            return Ok(None);
        }
        let batch: Vec<_> = rows(&self.scenes, &draws)
            .filter_map(|(row, weight)| attention_sample(row, weight))
            .collect();
        let report = attention.update(&batch, &mut stream(self.seed, Stream::Augment, update));
        let losses = report.losses.iter().map(|&loss| ("loss", loss));
        let numbers = losses.chain([("mean target", report.mean_target)]);
        self.check("q_attention", Batch::new(update, &draws), numbers)?;
        self.scenes.update_priorities(&draws, &report.priorities)?;
        self.updates.q_attention += 1;
        Ok(Some(AttentionUpdate {
            loss: report.losses.iter().sum(),
            mean_target: report.mean_target,
        }))
    }

    /// Lines 18–20: one gradient step of the policy and one of the ranker, which sees an alternative
    /// of each demonstrated way beside it `with_alternatives`.
    ///
    /// # Errors
    ///
    /// [`Error::Diverged`] when a network does not learn any more.
    pub fn update_paths(
        &mut self,
        networks: &mut Networks,
        batch_size: usize,
        with_alternatives: bool,
    ) -> Result<PathUpdate> {
        if networks.ranker.is_none() && networks.policy.is_none() {
            return Ok(PathUpdate { ranker: None, policy: None });
        }
        let update = self.updates.paths;
        self.updates.paths += 1;
        // Line 18.
        let policy_draws = self.successes.sample(batch_size, &mut self.generator(update, 1));
        let policy = self.update_policy(networks, &policy_draws)?;
        // Lines 19 and 20.
        let rng = &mut self.generator(update, 0);
        let draws = self.paths.sample(batch_size, rng);
        let Some(ranker) = networks.ranker.as_mut().filter(|_| !draws.is_empty()) else {
            return Ok(PathUpdate { ranker: None, policy });
        };
        let mut batch: Vec<_> =
            rows(&self.paths, &draws).map(|(row, weight)| row.for_ranker(weight)).collect();
        if with_alternatives {
            batch.extend(
                rows(&self.paths, &draws).filter_map(|(row, weight)| {
                    row.alternative(rng.random::<u32>() as usize, weight)
                }),
            );
        }
        let report = ranker.update(&batch)?;
        // Priorities are of the rows, not of their alternatives.
        let errors = report.td_errors.iter().take(draws.len());
        let errors: Vec<f32> = errors.map(|error| error.abs()).collect();
        let td_errors = errors.iter().map(|&error| ("temporal difference", error));
        let numbers = td_errors.chain([("loss", report.loss)]);
        self.check("ranker", Batch::new(update, &draws), numbers)?;
        self.paths.update_priorities(&draws, &errors)?;
        let mean_error = errors.iter().sum::<f32>() / errors.len() as f32;
        Ok(PathUpdate { ranker: Some((report.loss, mean_error)), policy })
    }

    fn update_policy(&mut self, networks: &mut Networks, draws: &[Draw]) -> Result<Option<f32>> {
        let Some(policy) = networks.policy.as_mut().filter(|_| !draws.is_empty()) else {
            return Ok(None);
        };
        let batch: Vec<_> = rows(&self.successes, draws)
            .filter_map(|(row, weight)| row.for_policy(weight))
            .collect();
        let loss = policy.update(&batch)?;
        self.check("policy", Batch::new(self.updates.paths - 1, draws), [("loss", loss)])?;
        Ok(Some(loss))
    }

    /// Refuses numbers of an update that are none, or beyond [`LARGEST`].
    fn check(
        &mut self,
        network: &'static str,
        batch: Batch,
        numbers: impl IntoIterator<Item = (&'static str, f32)>,
    ) -> Result<()> {
        self.last.insert(network, batch);
        // False for what is not a number.
        let is_sound = |number: f32| number.abs() <= LARGEST;
        match numbers.into_iter().find(|(_, number)| !is_sound(*number)) {
            Some((name, number)) => Err(self.diverged(network, format!("{name} {number}"))),
            None => Ok(()),
        }
    }

    fn diverged(&self, network: &'static str, found: String) -> Error {
        let Batch { update, rows } =
            self.last.get(network).cloned().unwrap_or_else(|| Batch::new(0, &[]));
        Error::Diverged { network, update, found, rows }
    }

    /// `error`, and for answers that are no numbers the update and batch after which they are none.
    pub(crate) fn explained(&self, error: Error) -> Error {
        match error {
            Error::NotFinite { network, found } => self.diverged(network, found),
            error => error,
        }
    }

    fn generator(&self, update: u64, network: u64) -> Rng {
        stream(self.seed, Stream::Replay, update * GENERATORS + network)
    }
}

/// The drawn rows with their weights.
fn rows<'a>(replay: &'a Replay<Row>, draws: &'a [Draw]) -> impl Iterator<Item = (&'a Row, f32)> {
    draws.iter().map(|&draw| {
        (replay.get(draw).expect("drawn from this buffer since its last row"), draw.weight)
    })
}

/// Q-attention's view of a row.
fn attention_sample(row: &Row, weight: f32) -> Option<QSample<'_>> {
    Some(QSample {
        observation: row.step.observation.as_ref()?,
        action: row.step.decision.context.goal,
        reward: row.reward,
        next: row.next.as_ref().and_then(|step| step.observation.as_ref()),
        weight,
        imitated: row.episode_success,
    })
}
