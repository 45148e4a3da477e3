//! The ranker `Q^R`: learned value of a path, by temporal differences on the sparse reward (section
//! IV-C, "Learned Path Ranking").
//!
//! One small network reads every configuration of a path, a maximum over the configurations pools
//! what it found, and a head turns that into the value. The target of a transition is
//! `r + γ Q'(ξ_{t+1})` with the path that was taken next; when the episode ended it is exactly `r`.
//!
//! # Differences from the paper
//!
//! - The paper gives the network the joints alone. [`RankerInput::Context`] also shows the head
//!   where the path starts and ends, the next-best pose, whether the path collides, the gripper's
//!   state and command, and the time: without them two keyframes whose paths look alike share one
//!   value. [`RankerInput::Joints`] is the paper's. [`RankerInput::Grip`] adds for every
//!   configuration the pose of the grip in the frame of the next-best pose, by forward kinematics:
//!   a path that turns a hinge is then the same set of numbers wherever the hinge stands, which ten
//!   demonstrations need. [`RankerInput::Chord`] adds how far off the straight line it is, and
//!   [`RankerInput::Motion`] leaves out joints and places.
//! - Beside a demonstrated path it may be shown other candidates of the same way, as failures
//!   ([`Alternatives`](crate::demo::Alternatives)): demonstrations hold only paths that work. Some of
//!   them would have worked too; what comes of the agent's own paths corrects that.
//! - A running mean of the weights may rank ([`RankerSettings::acting_weights`]).
//! - Joint angles are scaled so that the limits are ±1; the paper does not say how they enter.
//! - The paper calls the network "the path policy" where it describes it; it is the ranker's.
//! - It may learn from all rows alike ([`Sampling::Uniform`]): the paper draws them by priorities.
//! - [`Objective::Outcome`] reads values as probabilities and fits them to what came of the episode:
//!   nothing bootstraps, and no value leaves 0 to 1.
//! - Optimiser, discount and target mix are not in the paper; presets take the released code's. Its
//!   twin networks ([`Critics::Twin`]) and clipped targets ([`TargetRange::UnitInterval`]) are
//!   settings.

#[cfg(test)]
mod golden;
mod network;

use crate::error::{Error, Result};
use crate::features::JointScale;
use crate::nn::{Adam, AdamSettings, AdamState, Backend, NamedTensor, ParameterGradients};
use crate::nn::{export, import, in_halves, mix, parameter_gradients, sum_of_gradients};
use crate::nn::{tensor, values};
use crate::path::JointPath;
use crate::q_attention::{ActingNetwork, NetworkCost, NextBestPose};
use crate::rng::Rng;
use crate::robot::Robot;
use network::{Encoding, RankerNetwork, common_path_len};
use std::sync::Arc;

use burn::module::Module as _;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

/// Input of the ranker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RankerInput {
    /// The configurations of the path: `Q^R(ξ)` of the paper.
    Joints,
    /// The configurations, and for the head the situation in which the path would be taken.
    Context,
    /// [`Self::Context`], and for every configuration where the grip is, seen from the next-best
    /// pose.
    Grip,
    /// [`Self::Grip`], and for every configuration its place on the path and how far off the
    /// straight line between the ends it is; for the head the lengths of the path.
    Chord,
    /// [`Self::Chord`] without joints and without places in the world: the same motion towards the
    /// same pose is the same input wherever it happens, also with the hand half turned.
    Motion,
}

/// Meaning of a value, and what it is fitted to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Discounted reward: `r + γ Q'(ξ_{t+1})`, by squared error, as in the paper.
    #[default]
    TemporalDifference,
    /// Probability that the episode succeeds: what came of it, by cross-entropy.
    Outcome,
}

/// Rows that an update draws.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Those of large errors more often, as in the paper.
    #[default]
    Prioritised,
    /// All alike. What came of a path is partly chance: rows that chance decided keep a large error,
    /// and priorities draw them again and again.
    Uniform,
}

/// Number of value networks that are trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Critics {
    /// One, as in the paper.
    Single,
    /// Two: targets use the smaller value, ranking the mean, as in the released code.
    Twin,
    /// That many: targets use the smallest value, ranking the mean. The best of many candidates is
    /// often one that a single network overestimates.
    Ensemble(usize),
}

impl Critics {
    /// Number of value networks.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::Single => 1,
            Self::Twin => 2,
            Self::Ensemble(n) => n,
        }
    }
}

/// Most value networks of a ranker.
const MOST_CRITICS: usize = 16;

/// Range of the targets of the temporal differences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetRange {
    /// Anywhere, as in the paper.
    Unbounded,
    /// Clamped to 0 to 1, the range of a discounted reward that is 1 at most once.
    UnitInterval,
}

/// Settings of the ranker: its network and its training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankerSettings {
    /// Input of the network.
    pub input: RankerInput,
    /// Output sizes of the layers on every configuration: 64, 128, 1024 in the paper.
    pub config_widths: Vec<usize>,
    /// Output sizes of the layers after pooling, without the last (1): 512, 512 in the paper.
    pub head_widths: Vec<usize>,
    /// Meaning of the values.
    #[serde(default)]
    pub objective: Objective,
    /// Rows that it learns from.
    #[serde(default)]
    pub sampling: Sampling,
    /// Number of value networks.
    pub critics: Critics,
    /// Weights that rank: the paper's are those that gradients change.
    #[serde(default = "online")]
    pub acting_weights: ActingNetwork,
    /// Range of the targets.
    pub target_range: TargetRange,
    /// Weight of the next path's value: `γ` in the paper.
    pub discount: f32,
    /// Part of the online network that enters the target network per update: `τ` in the paper.
    pub target_mix: f32,
    /// Optimiser.
    pub adam: AdamSettings,
}

/// The weights that rank where nothing else is said.
const fn online() -> ActingNetwork {
    ActingNetwork::Online
}

/// A path as the ranker sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedPath {
    /// The path; all paths of one call have the same number of configurations.
    pub path: JointPath,
    /// True if its configurations touch the scene.
    pub collides: bool,
}

/// The situation in which paths are ranked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankerContext {
    /// The pose that the paths lead to: `g` in the paper.
    pub goal: NextBestPose,
    /// 1 when the gripper is open, 0 when it is closed.
    pub gripper_open: f32,
    /// Time feature: +1 at the first to -1 at the last step of an episode.
    pub time: f32,
}

/// One path in its situation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankerSample<'a> {
    /// The situation.
    pub context: &'a RankerContext,
    /// The path.
    pub path: &'a RankedPath,
}

/// One step of experience.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankerTransition<'a> {
    /// The path that was taken: `ξ_t` in the paper.
    pub taken: RankerSample<'a>,
    /// Reward for it: `r` in the paper.
    pub reward: f32,
    /// The path that was taken next (`ξ_{t+1}`); none when the episode terminated.
    pub next: Option<RankerSample<'a>>,
    /// 1 if the episode ended in success, else 0.
    pub outcome: f32,
    /// Importance weight from prioritised replay; 1 for uniform sampling.
    pub weight: f32,
}

/// Findings of one update.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RankerUpdate {
    /// Weighted mean of the squared temporal differences, summed over critics.
    pub loss: f32,
    /// Target minus value (mean over critics), per transition of the batch.
    pub td_errors: Vec<f32>,
}

/// Everything that makes a ranker go on bit by bit: part of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankerState {
    /// The online networks.
    pub online: Vec<NamedTensor>,
    /// The target networks.
    pub target: Vec<NamedTensor>,
    /// The optimiser.
    pub adam: AdamState,
}

/// The ranking function with its target network and optimiser.
#[derive(Debug)]
pub struct Ranker {
    settings: RankerSettings,
    encoding: Encoding,
    device: Device,
    online: RankerNetwork,
    target: RankerNetwork,
    adam: Adam,
}

impl Ranker {
    /// A ranker with fresh weights from `rng` (stream `Init`).
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when a layer has no outputs, or a factor lies outside 0 to 1.
    pub fn new(
        settings: &RankerSettings,
        robot: &Arc<Robot>,
        backend: Backend,
        rng: &mut Rng,
    ) -> Result<Self> {
        check(settings)?;
        let device = backend.device();
        let online = RankerNetwork::new(settings, &device, rng);
        let (target, adam) = (online.clone(), Adam::new(settings.adam, &online));
        let encoding = Encoding {
            input: settings.input,
            joint_scale: JointScale::new(robot),
            robot: Arc::clone(robot),
        };
        Ok(Self { settings: settings.clone(), encoding, device, online, target, adam })
    }

    /// The value of each path in one situation; the agent takes the path of the largest.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the paths differ in length.
    pub fn values(&self, context: &RankerContext, paths: &[RankedPath]) -> Result<Vec<f32>> {
        Ok(means(&self.values_by_critic(context, paths)?))
    }

    /// The value of each path by each value network: [`Self::values`] are their means.
    ///
    /// # Errors
    ///
    /// As [`Self::values`].
    pub fn values_by_critic(
        &self,
        context: &RankerContext,
        paths: &[RankedPath],
    ) -> Result<Vec<Vec<f32>>> {
        let samples: Vec<_> = paths.iter().map(|path| RankerSample { context, path }).collect();
        if samples.is_empty() {
            return Ok(vec![Vec::new(); self.online.critics.len()]);
        }
        let network = match self.settings.acting_weights {
            ActingNetwork::Online => &self.online,
            ActingNetwork::Target => &self.target,
        };
        Ok(self.read(network.forward(&self.encoding.encode(&samples, &self.device)?)))
    }

    /// Parameters, and operations of one forward pass of a path of `path_len` configurations.
    #[must_use]
    pub fn cost(&self, path_len: usize) -> NetworkCost {
        let macs = self.online.critics.iter().map(|critic| critic.macs(path_len)).sum::<usize>();
        NetworkCost { parameters: self.online.num_params(), flops: 2 * macs }
    }

    /// One gradient step on `batch`, then one step of the target network.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the batch is empty or its paths differ in length.
    pub fn update(&mut self, batch: &[RankerTransition<'_>]) -> Result<RankerUpdate> {
        let taken: Vec<_> = batch.iter().map(|transition| transition.taken).collect();
        common_path_len(&taken)?;
        let targets = self.targets(batch)?;
        let n = batch.len();
        let samples: Vec<_> = batch.iter().zip(&targets).collect();
        let halves = in_halves(&samples, |half| self.half(half, n));
        let halves = halves.into_iter().collect::<Result<Vec<_>>>()?;
        let loss = halves.iter().map(|half| half.loss).sum();
        let values: Vec<_> = halves.iter().flat_map(|half| half.values.iter().copied()).collect();
        let gradients = sum_of_gradients(halves.into_iter().map(|half| half.gradients));

        // Line 19: σ ← σ - λ ∇J_R; line 20: σ' ← τσ + (1-τ)σ'.
        self.online = self.adam.step(self.online.clone(), gradients);
        self.target = mix(self.target.clone(), &self.online, self.settings.target_mix);
        // Of the values before the step, as are the targets.
        let td_errors = targets.iter().zip(values).map(|(target, value)| target - value).collect();
        Ok(RankerUpdate { loss, td_errors })
    }

    /// The part of some transitions, with their targets, in the update of a batch of `n_samples`.
    fn half(
        &self,
        transitions: &[(&RankerTransition<'_>, &f32)],
        n_samples: usize,
    ) -> Result<Half> {
        let taken: Vec<_> = transitions.iter().map(|(transition, _)| transition.taken).collect();
        let leaves = self.online.clone().train();
        let device = self.device.clone().autodiff();
        let input = self.encoding.encode(&taken, &device)?;
        let value_tensors: Vec<_> =
            leaves.critics.iter().map(|critic| critic.forward(&input)).collect();
        let outputs = value_tensors.iter().map(|value| values(value.clone().inner())).collect();
        let per_critic = self.read(outputs);

        let n = transitions.len();
        let weight =
            |(transition, _): &(&RankerTransition<'_>, _)| transition.weight / n_samples as f32;
        let weight = tensor(transitions.iter().map(weight).collect(), [n], &device);
        let target = tensor(transitions.iter().map(|(_, target)| **target).collect(), [n], &device);
        let loss = value_tensors
            .into_iter()
            .map(|value| {
                let losses = match self.settings.objective {
                    Objective::TemporalDifference => (target.clone() - value).square(),
                    Objective::Outcome => cross_entropy(value, target.clone()),
                };
                (losses * weight.clone()).sum()
            })
            .reduce(Tensor::add)
            .expect("a ranker has at least one critic");
        let gradients = parameter_gradients(&leaves, loss.backward());
        let values = means(&per_critic);
        Ok(Half { loss: loss.into_scalar(), values, gradients })
    }

    /// What the outputs of the networks mean, a critic each.
    fn read(&self, outputs: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        match self.settings.objective {
            Objective::TemporalDifference => outputs,
            Objective::Outcome => outputs
                .into_iter()
                .map(|logits| logits.into_iter().map(sigmoid).collect())
                .collect(),
        }
    }

    /// `r + γ Q'(ξ_{t+1})`, or `r` where nothing follows; what came of the episode.
    fn targets(&self, batch: &[RankerTransition<'_>]) -> Result<Vec<f32>> {
        if self.settings.objective == Objective::Outcome {
            return Ok(batch.iter().map(|transition| transition.outcome).collect());
        }
        let next: Vec<_> = batch.iter().filter_map(|transition| transition.next).collect();
        if !next.is_empty() {
            common_path_len(&next)?;
        }
        // Of two critics the smaller value, against overestimates. One entry for each transition
        // that goes on, in the order of the batch.
        let lowest = in_halves(&next, |half| {
            let per_critic = self.target.forward(&self.encoding.encode(half, &self.device)?);
            let lowest = |idx| {
                per_critic.iter().fold(f32::INFINITY, |low, values: &Vec<f32>| low.min(values[idx]))
            };
            Ok((0..half.len()).map(lowest).collect::<Vec<_>>())
        });
        let mut lowest = lowest.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten();
        Ok(batch
            .iter()
            .map(|transition| {
                let bootstrap = transition.next.and_then(|_| lowest.next());
                let target = bootstrap.map_or(transition.reward, |value| {
                    transition.reward + self.settings.discount * value
                });
                match self.settings.target_range {
                    TargetRange::Unbounded => target,
                    TargetRange::UnitInterval => target.clamp(0.0, 1.0),
                }
            })
            .collect())
    }

    /// State of the ranker, for a checkpoint.
    #[must_use]
    pub fn state(&self) -> RankerState {
        RankerState {
            online: export(&self.online),
            target: export(&self.target),
            adam: self.adam.state().clone(),
        }
    }

    /// Goes on from a checkpoint of a ranker with the same settings.
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] naming the tensor that does not fit; the ranker is unchanged then.
    pub fn restore(&mut self, state: &RankerState) -> Result<()> {
        let online = import(self.online.clone(), &state.online)?;
        let target = import(self.target.clone(), &state.target)?;
        self.adam.restore(&state.adam)?;
        (self.online, self.target) = (online, target);
        Ok(())
    }
}

/// The part of some transitions in an update.
struct Half {
    loss: f32,
    /// Mean over critics, one a transition.
    values: Vec<f32>,
    gradients: ParameterGradients,
}

fn check(settings: &RankerSettings) -> Result<()> {
    if settings.config_widths.is_empty() {
        return Err(Error::Config("ranker.config_widths: expected at least one layer".to_owned()));
    }
    if settings.config_widths.iter().chain(&settings.head_widths).any(|&width| width == 0) {
        return Err(Error::Config("ranker: every layer needs at least one output".to_owned()));
    }
    if !(1..=MOST_CRITICS).contains(&settings.critics.count()) {
        let found = settings.critics.count();
        return Err(Error::Config(format!(
            "ranker.critics: expected 1 to {MOST_CRITICS} networks, found {found}"
        )));
    }
    for (name, factor) in [("discount", settings.discount), ("target_mix", settings.target_mix)] {
        if !(0.0..=1.0).contains(&factor) {
            return Err(Error::Config(format!("ranker.{name}: expected 0 to 1, found {factor}")));
        }
    }
    Ok(())
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + libm::expf(-logit))
}

/// `-y log p - (1 - y) log(1 - p)` of `p = sigmoid(z)`, which is `max(z, 0) - y z + log(1 + e^-|z|)`.
fn cross_entropy(logits: Tensor<1>, outcomes: Tensor<1>) -> Tensor<1> {
    let tail = logits.clone().abs().neg().exp().log1p();
    relu(logits.clone()) - outcomes * logits + tail
}

/// Mean over critics of the value of each path.
pub(crate) fn means(per_critic: &[Vec<f32>]) -> Vec<f32> {
    let n_paths = per_critic.first().map_or(0, Vec::len);
    let mean = |idx: usize| {
        per_critic.iter().map(|values| values[idx]).sum::<f32>() / per_critic.len() as f32
    };
    (0..n_paths).map(mean).collect()
}

#[cfg(test)]
mod tests;
