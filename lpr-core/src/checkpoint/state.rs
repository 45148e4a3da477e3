//! `state.bin`: what training needs beside the weights, sealed, in `postcard`.
//!
//! Types of the core are converted to what is stored here, so that none of them has to be built
//! from unchecked bytes.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::learner::{Learner, Row, Seen, UpdateCounts};
use crate::networks::Networks;
use crate::nn::{AdamState, NamedTensor};
use crate::path::{JointPath, Source};
use crate::perception::{Proprio, VoxelBounds};
use crate::policy::PolicyState;
use crate::q_attention::{DepthState, NextBestPose, QObservation, StoredPoint};
use crate::ranker::{RankedPath, RankerContext, RankerState};
use crate::replay::{
    Decision, Replay, ReplaySettings, ReplayState, Step, TransitionRow, join_steps, split_steps,
};
use crate::robot::{Gripper, JointConfig};
use crate::sealed::Seal;
use crate::train::{Choice, Episode, Progress, Taken, Trainer};

use glamx::Pose3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The head of the file.
const SEAL: Seal = Seal { magic: *b"LPRSTATE", version: 2, oldest: 1 };

/// State of training beside the weights.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct State {
    /// Digest of the weights that this belongs to.
    pub(super) weights_digest: u64,
    progress: Progress,
    updates: UpdateCounts,
    /// Each depth of Q-attention.
    q_attention: Option<Vec<StoredLearner>>,
    ranker: Option<StoredLearner>,
    policy: Option<AdamState>,
    /// The steps that the rows of all buffers link.
    steps: Vec<StoredStep>,
    paths: StoredBuffer,
    successes: StoredBuffer,
    scenes: StoredBuffer,
    episode: Option<StoredEpisode>,
    /// The alternatives of each step, or none at all; behind the rest since version 2.
    #[serde(skip)]
    alternatives: Vec<Vec<StoredPath>>,
}

/// Optimiser state and the network that does not act; the network that acts is stored with the
/// weights.
#[derive(Debug, Serialize, Deserialize)]
struct StoredLearner {
    /// The target network; where that acts, the online network.
    other: Vec<NamedTensor>,
    adam: AdamState,
}

#[derive(Debug, Serialize, Deserialize)]
struct StoredBuffer {
    rows: Vec<TransitionRow>,
    replay: ReplayState,
}

#[derive(Debug, Serialize, Deserialize)]
struct StoredStep {
    observation: Option<StoredObservation>,
    pose: Pose3,
    gripper: Gripper,
    gripper_open: f32,
    time: f32,
    path: Vec<JointConfig>,
    collides: bool,
    source: Option<StoredSource>,
}

/// A path, and whether it collides.
type StoredPath = (Vec<JointConfig>, bool);

#[derive(Debug, Serialize, Deserialize)]
struct StoredObservation {
    bounds: VoxelBounds,
    points: Vec<([u16; 3], [u8; 3])>,
    joints: JointConfig,
    gripper_width: f32,
    gripper_open: f32,
    finger_positions: [f32; 2],
    grip: Pose3,
    time: f32,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
enum StoredSource {
    Planner,
    Bezier,
    Policy,
    Linear,
    Screw,
}

#[derive(Debug, Serialize, Deserialize)]
struct StoredEpisode {
    scene_seed: u64,
    steps: Vec<StoredTaken>,
}

#[derive(Debug, Serialize, Deserialize)]
struct StoredTaken {
    step: StoredStep,
    value: Option<f32>,
    reward: f32,
}

impl State {
    /// The state of a run whose weights have that digest.
    pub(super) fn of<E>(trainer: &Trainer<E>, weights_digest: u64) -> Self {
        let (networks, learner) = (&trainer.agent.networks, &trainer.learner);
        let buffers = [&learner.paths, &learner.successes, &learner.scenes];
        // One list of all buffers' rows: a step that several rows share is stored once.
        let all: Vec<Row> = buffers.iter().flat_map(|buffer| buffer.rows()).cloned().collect();
        let (steps, rows) = split_steps(&all);
        let mut rows = rows.into_iter();
        let [paths, successes, scenes] = buffers.map(|buffer| StoredBuffer {
            rows: rows.by_ref().take(buffer.rows().len()).collect(),
            replay: buffer.state(),
        });
        let acting = trainer.config.training.acting_weights;
        let stored_depth = |DepthState { online, target, adam }| {
            let [_, other] = acting.acting_first([online, target]);
            StoredLearner { other, adam }
        };
        let ranks = trainer.config.ranker.acting_weights;
        let stored_ranker = |RankerState { online, target, adam }| {
            let [_, other] = ranks.acting_first([online, target]);
            StoredLearner { other, adam }
        };
        Self {
            weights_digest,
            progress: trainer.progress,
            updates: learner.updates,
            q_attention: networks
                .q_attention
                .as_ref()
                .map(|agent| agent.state().depths.into_iter().map(stored_depth).collect()),
            ranker: networks.ranker.as_ref().map(|ranker| stored_ranker(ranker.state())),
            policy: networks.policy.as_ref().map(|policy| policy.state().adam),
            steps: steps.iter().map(|step| StoredStep::of(step)).collect(),
            paths,
            successes,
            scenes,
            episode: trainer.episode.as_ref().map(StoredEpisode::of),
            alternatives: match trainer.shows_alternatives() {
                true => steps.iter().map(|step| stored_alternatives(&step.decision)).collect(),
                false => Vec::new(),
            },
        }
    }

    /// Brings a trainer with the weights of this checkpoint to this state.
    pub(super) fn restore<E>(mut self, trainer: &mut Trainer<E>) -> Result<()> {
        self.restore_networks(&mut trainer.agent.networks, &trainer.config)?;
        if !(self.alternatives.is_empty() || self.alternatives.len() == self.steps.len()) {
            return Err(damaged("alternatives of other steps"));
        }
        let mut alternatives = self.alternatives.into_iter();
        let steps: Vec<_> = self
            .steps
            .into_iter()
            .map(|step| step.restore(alternatives.next().unwrap_or_default()).map(Arc::new))
            .collect::<Result<_>>()?;
        let settings = &trainer.config.replay;
        let of_ranker = Learner::path_settings(settings, trainer.config.ranker.sampling);
        let learner = &mut trainer.learner;
        learner.paths = self.paths.restore(&steps, &of_ranker)?;
        learner.successes = self.successes.restore(&steps, &settings.uniform())?;
        learner.scenes = self.scenes.restore(&steps, settings)?;
        // An update takes for granted that poses lie within the bounds: what breaks that is refused
        // here.
        if let Some(attention) = &trainer.agent.networks.q_attention
            && !learner.scenes.rows().iter().all(|row| Learner::is_scene(row, attention))
        {
            return Err(damaged("a pose that Q-attention cannot learn is in its buffer"));
        }
        learner.updates = self.updates;
        trainer.progress = self.progress;
        trainer.episode = self.episode.map(StoredEpisode::restore).transpose()?;
        Ok(())
    }

    /// The networks that do not act, and optimisers.
    fn restore_networks(&mut self, networks: &mut Networks, config: &Config) -> Result<()> {
        match (&mut networks.q_attention, self.q_attention.take()) {
            (Some(attention), Some(stored)) => {
                let mut state = attention.state();
                if state.depths.len() != stored.len() {
                    return Err(damaged(&format!(
                        "{} depths of Q-attention, expected {}",
                        stored.len(),
                        state.depths.len()
                    )));
                }
                for (depth, StoredLearner { other, adam }) in state.depths.iter_mut().zip(stored) {
                    depth.adam = adam;
                    // Either network is the one that acts, from the weights.
                    let acting = core::mem::take(&mut depth.online);
                    [depth.online, depth.target] =
                        config.training.acting_weights.acting_first([acting, other]);
                }
                attention.restore(&state)?;
            }
            (None, None) => {}
            _ => return Err(damaged("Q-attention is in one file and not in the other")),
        }
        match (&mut networks.ranker, self.ranker.take()) {
            (Some(ranker), Some(StoredLearner { other, adam })) => {
                let acting = ranker.state().online;
                let [online, target] = config.ranker.acting_weights.acting_first([acting, other]);
                ranker.restore(&RankerState { online, target, adam })?;
            }
            (None, None) => {}
            _ => return Err(damaged("a ranker is in one file and not in the other")),
        }
        match (&mut networks.policy, self.policy.take()) {
            (Some(policy), Some(adam)) => {
                let network = policy.state().network;
                policy.restore(&PolicyState { network, adam })?;
            }
            (None, None) => {}
            _ => return Err(damaged("a policy is in one file and not in the other")),
        }
        Ok(())
    }

    pub(super) fn to_bytes(&self) -> Result<Vec<u8>> {
        let parts = (self, &self.alternatives);
        let payload = postcard::to_allocvec(&parts).map_err(|error| damaged(&error.to_string()))?;
        Ok(SEAL.seal(&payload))
    }

    pub(super) fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let payload = SEAL.open(bytes).map_err(|error| damaged(&error.to_string()))?;
        let (mut state, mut left): (Self, _) =
            postcard::take_from_bytes(payload).map_err(|error| damaged(&error.to_string()))?;
        // The first version ends here.
        if !left.is_empty() {
            (state.alternatives, left) =
                postcard::take_from_bytes(left).map_err(|error| damaged(&error.to_string()))?;
        }
        if left.is_empty() {
            Ok(state)
        } else {
            Err(damaged(&format!("{} bytes too many", left.len())))
        }
    }
}

fn damaged(what: &str) -> Error {
    Error::Checkpoint(format!("state: {what}"))
}

impl StoredBuffer {
    fn restore(self, steps: &[Arc<Step<Seen>>], settings: &ReplaySettings) -> Result<Replay<Row>> {
        Replay::restore(settings, join_steps(steps, &self.rows)?, self.replay)
    }
}

fn stored_path(path: &RankedPath) -> StoredPath {
    (path.path.configs().to_vec(), path.collides)
}

fn restored_path((configs, collides): StoredPath) -> Result<RankedPath> {
    let path = JointPath::new(configs).map_err(|error| damaged(&error.to_string()))?;
    Ok(RankedPath { path, collides })
}

fn stored_alternatives(decision: &Decision) -> Vec<StoredPath> {
    decision.alternatives.iter().map(stored_path).collect()
}

impl StoredStep {
    fn of(step: &Step<Seen>) -> Self {
        let Decision { context, taken, source, .. } = &step.decision;
        let (path, collides) = stored_path(taken);
        Self {
            observation: step.observation.as_ref().map(StoredObservation::of),
            pose: context.goal.pose,
            gripper: context.goal.gripper,
            gripper_open: context.gripper_open,
            time: context.time,
            path,
            collides,
            source: source.map(StoredSource::from),
        }
    }

    fn restore(self, alternatives: Vec<StoredPath>) -> Result<Step<Seen>> {
        let goal = NextBestPose { pose: self.pose, gripper: self.gripper };
        let context = RankerContext { goal, gripper_open: self.gripper_open, time: self.time };
        let taken = restored_path((self.path, self.collides))?;
        let alternatives = alternatives.into_iter().map(restored_path).collect::<Result<_>>()?;
        let source = self.source.map(Source::from);
        let decision = Decision { context, taken, source, alternatives };
        Ok(Step { observation: self.observation.map(StoredObservation::restore), decision })
    }
}

impl StoredObservation {
    fn of(observation: &QObservation) -> Self {
        let Proprio { joints, gripper_width, gripper_open, finger_positions, grip, time } =
            observation.proprio;
        let points = observation.points.iter().map(|point| (point.position, point.rgb)).collect();
        Self {
            bounds: observation.bounds,
            points,
            joints,
            gripper_width,
            gripper_open,
            finger_positions,
            grip,
            time,
        }
    }

    fn restore(self) -> QObservation {
        let Self {
            bounds,
            points,
            joints,
            gripper_width,
            gripper_open,
            finger_positions,
            grip,
            time,
        } = self;
        let points =
            points.into_iter().map(|(position, rgb)| StoredPoint { position, rgb }).collect();
        let proprio = Proprio { joints, gripper_width, gripper_open, finger_positions, grip, time };
        QObservation { bounds, points, proprio }
    }
}

impl From<Source> for StoredSource {
    fn from(source: Source) -> Self {
        match source {
            Source::Planner => Self::Planner,
            Source::Bezier => Self::Bezier,
            Source::Policy => Self::Policy,
            Source::Linear => Self::Linear,
            Source::Screw => Self::Screw,
        }
    }
}

impl From<StoredSource> for Source {
    fn from(source: StoredSource) -> Self {
        match source {
            StoredSource::Planner => Self::Planner,
            StoredSource::Bezier => Self::Bezier,
            StoredSource::Policy => Self::Policy,
            StoredSource::Linear => Self::Linear,
            StoredSource::Screw => Self::Screw,
        }
    }
}

impl StoredEpisode {
    fn of(episode: &Episode) -> Self {
        let stored = |taken: &Taken| StoredTaken {
            step: StoredStep::of(taken.choice.step()),
            value: taken.value,
            reward: taken.reward,
        };
        Self { scene_seed: episode.scene_seed, steps: episode.steps.iter().map(stored).collect() }
    }

    /// An episode goes on only after a path that ran, so every choice is one.
    fn restore(self) -> Result<Episode> {
        let taken = |StoredTaken { step, value, reward }| {
            Ok(Taken { choice: Choice::Path(Arc::new(step.restore(Vec::new())?)), value, reward })
        };
        let steps = self.steps.into_iter().map(taken).collect::<Result<_>>()?;
        Ok(Episode { scene_seed: self.scene_seed, steps, next: None })
    }
}
