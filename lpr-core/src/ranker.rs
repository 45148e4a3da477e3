//! The ranker `Q^R`: learned value of a path, by temporal differences on the sparse reward (section IV-D, "Learned Path Ranking").
//!
//! One small network reads every configuration of a path, a maximum over the configurations pools what it found, and a head
//! turns that into the value. The target of a transition is `r + γ Q'(ξ_{t+1})` with the path that was taken next; when the
//! episode ended it is exactly `r`.
//!
//! # Differences from the paper
//!
//! - The paper gives the network the joints alone. [`RankerInput::Context`] also shows the head where the path starts and
//!   ends, the next-best pose, whether the path collides, the gripper's state and command, and the time: without them two
//!   keyframes whose paths look alike share one value. [`RankerInput::Joints`] is the paper's.
//! - Joint angles are scaled so that the limits are ±1; the paper does not say how they enter.
//! - The paper calls the network "the path policy" where it describes it; it is the ranker's.
//! - Optimiser, discount and target mix are not in the paper; presets take the released code's. Its twin networks
//!   ([`Critics::Twin`]) and clipped targets ([`TargetRange::UnitInterval`]) are settings.

use crate::error::{Error, Result};
use crate::nn::{Adam, AdamSettings, AdamState, Backend, GOAL_FEATURES, JointScale, Mlp, NamedTensor, Spread};
use crate::nn::{export, goal_features, import, mix, tensor, values};
use crate::path::JointPath;
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{DOF, Robot};

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

/// Numbers of the context: start and goal configuration, next-best pose, collides, gripper open, time.
const CONTEXT_FEATURES: usize = 2 * DOF + GOAL_FEATURES + 3;

/// What the ranker reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RankerInput {
    /// The configurations of the path: `Q^R(ξ)` of the paper.
    Joints,
    /// The configurations, and for the head the situation in which the path would be taken.
    Context,
}

/// How many value networks are trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Critics {
    /// One, as in the paper.
    Single,
    /// Two: targets use the smaller value, ranking the mean, as in the released code.
    Twin,
}

/// Where the targets of the temporal differences may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetRange {
    /// Anywhere, as in the paper.
    Unbounded,
    /// Clamped to 0 to 1, the range of a discounted reward that is 1 at most once.
    UnitInterval,
}

/// How the ranker is built and trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankerSettings {
    /// What it reads.
    pub input: RankerInput,
    /// Output sizes of the layers on every configuration: 64, 128, 1024 in the paper.
    pub config_widths: Vec<usize>,
    /// Output sizes of the layers after pooling, without the last (1): 512, 512 in the paper.
    pub head_widths: Vec<usize>,
    /// Number of value networks.
    pub critics: Critics,
    /// Range of the targets.
    pub target_range: TargetRange,
    /// Weight of the next path's value: `γ` in the paper.
    pub discount: f32,
    /// Part of the online network that enters the target network per update: `τ` in the paper.
    pub target_mix: f32,
    /// Optimiser.
    pub adam: AdamSettings,
}

/// A path as the ranker sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedPath {
    /// The path; all paths of one call have the same number of configurations.
    pub path: JointPath,
    /// Whether its configurations touch the scene.
    pub collides: bool,
}

/// The situation in which paths are ranked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankerContext {
    /// Where the paths lead: `g` in the paper.
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
    /// Importance weight from prioritised replay; 1 for uniform sampling.
    pub weight: f32,
}

/// What one update found.
#[derive(Debug, Clone, PartialEq)]
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

/// One value network.
#[derive(Module, Debug)]
struct Critic {
    encoder: Mlp,
    head: Mlp,
}

impl Critic {
    fn new(settings: &RankerSettings, device: &Device, rng: &mut Rng) -> Self {
        let encoder_widths: Vec<_> = [DOF].into_iter().chain(settings.config_widths.iter().copied()).collect();
        let pooled = encoder_widths[encoder_widths.len() - 1];
        let n_context = match settings.input {
            RankerInput::Joints => 0,
            RankerInput::Context => CONTEXT_FEATURES,
        };
        let head_widths: Vec<_> =
            [pooled + n_context].into_iter().chain(settings.head_widths.iter().copied()).chain([1]).collect();
        Self {
            encoder: Mlp::new(&encoder_widths, Spread::Kaiming { slope: 0.0 }, device, rng),
            head: Mlp::new(&head_widths, Spread::Xavier, device, rng),
        }
    }

    /// # Shapes
    ///
    /// - output: `[B]`
    fn forward(&self, input: &PathTensors) -> Tensor<1> {
        let [n_paths, path_len] = input.dims;
        let features = self.encoder.forward(input.configs.clone());
        let width = features.dims()[1];
        // ReLU after the maximum instead of before: the same values and gradients on 1/T of the numbers.
        let pooled = relu(features.reshape([n_paths, path_len, width]).max_dim(1).reshape([n_paths, width]));
        let pooled = match &input.context {
            Some(context) => Tensor::cat(vec![pooled, context.clone()], 1),
            None => pooled,
        };
        self.head.forward(pooled).reshape([n_paths])
    }
}

/// One or two value networks.
#[derive(Module, Debug)]
struct RankerNetwork {
    critics: Vec<Critic>,
}

impl RankerNetwork {
    fn new(settings: &RankerSettings, device: &Device, rng: &mut Rng) -> Self {
        let n_critics = match settings.critics {
            Critics::Single => 1,
            Critics::Twin => 2,
        };
        Self { critics: (0..n_critics).map(|_| Critic::new(settings, device, rng)).collect() }
    }

    /// Values per critic, each per path.
    fn forward(&self, input: &PathTensors) -> Vec<Vec<f32>> {
        self.critics.iter().map(|critic| values(critic.forward(input))).collect()
    }
}

/// A batch of paths as tensors.
#[derive(Debug)]
struct PathTensors {
    /// `[B * T, J]`, scaled joint angles.
    configs: Tensor<2>,
    /// `[B, CONTEXT_FEATURES]`.
    context: Option<Tensor<2>>,
    /// `B` and `T`.
    dims: [usize; 2],
}

/// The ranking function with its target network and optimiser.
#[derive(Debug)]
pub struct Ranker {
    settings: RankerSettings,
    joint_scale: JointScale,
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
    pub fn new(settings: &RankerSettings, robot: &Robot, backend: Backend, rng: &mut Rng) -> Result<Self> {
        check(settings)?;
        let device = backend.device();
        let online = RankerNetwork::new(settings, &device, rng);
        let (target, adam) = (online.clone(), Adam::new(settings.adam, &online));
        Ok(Self { settings: settings.clone(), joint_scale: JointScale::new(robot), device, online, target, adam })
    }

    /// The value of each path in one situation; the agent takes the path of the largest.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the paths differ in length.
    pub fn values(&self, context: &RankerContext, paths: &[RankedPath]) -> Result<Vec<f32>> {
        let samples: Vec<_> = paths.iter().map(|path| RankerSample { context, path }).collect();
        if samples.is_empty() {
            return Ok(Vec::new());
        }
        let per_critic = self.online.forward(&self.tensors(&samples, &self.device)?);
        Ok((0..paths.len()).map(|idx| mean(&per_critic, idx)).collect())
    }

    /// One gradient step on `batch`, then one step of the target network.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the batch is empty or its paths differ in length.
    pub fn update(&mut self, batch: &[RankerTransition<'_>]) -> Result<RankerUpdate> {
        let targets = self.targets(batch)?;
        let taken: Vec<_> = batch.iter().map(|transition| transition.taken).collect();
        let leaves = self.online.clone().train();
        let device = self.device.clone().autodiff();
        let input = self.tensors(&taken, &device)?;
        let value_tensors: Vec<_> = leaves.critics.iter().map(|critic| critic.forward(&input)).collect();
        let per_critic: Vec<_> = value_tensors.iter().map(|value| values(value.clone().inner())).collect();

        let n = batch.len();
        let weight = tensor(batch.iter().map(|transition| transition.weight).collect(), [n], &device);
        let target = tensor(targets.clone(), [n], &device);
        let loss = value_tensors
            .into_iter()
            .map(|value| ((target.clone() - value).square() * weight.clone()).mean())
            .reduce(Tensor::add)
            .expect("a ranker has at least one critic");
        let gradients = loss.backward();

        self.online = self.adam.step(self.online.clone(), &leaves, gradients);
        self.target = mix(self.target.clone(), &self.online, self.settings.target_mix);
        let td_errors = (0..n).map(|idx| targets[idx] - mean(&per_critic, idx)).collect();
        Ok(RankerUpdate { loss: loss.into_scalar(), td_errors })
    }

    /// `r + γ Q'(ξ_{t+1})`, or `r` where nothing follows.
    fn targets(&self, batch: &[RankerTransition<'_>]) -> Result<Vec<f32>> {
        let next: Vec<_> = batch.iter().filter_map(|transition| transition.next).collect();
        let per_critic = if next.is_empty() { Vec::new() } else { self.target.forward(&self.tensors(&next, &self.device)?) };
        let mut lowest = (0..next.len()).map(|idx| per_critic.iter().fold(f32::INFINITY, |low, values| low.min(values[idx])));
        Ok(batch
            .iter()
            .map(|transition| {
                let bootstrap = transition.next.and_then(|_| lowest.next());
                let target = bootstrap.map_or(transition.reward, |value| transition.reward + self.settings.discount * value);
                match self.settings.target_range {
                    TargetRange::Unbounded => target,
                    TargetRange::UnitInterval => target.clamp(0.0, 1.0),
                }
            })
            .collect())
    }

    /// The only place where paths become tensors.
    fn tensors(&self, samples: &[RankerSample<'_>], device: &Device) -> Result<PathTensors> {
        let path_len = samples.first().map_or(0, |sample| sample.path.path.configs().len());
        let mut configs = Vec::with_capacity(samples.len() * path_len * DOF);
        for sample in samples {
            let found = sample.path.path.configs();
            if found.len() != path_len {
                return Err(shape_error(format!("[{path_len}, {DOF}]"), format!("[{}, {DOF}]", found.len())));
            }
            configs.extend(found.iter().flat_map(|config| self.joint_scale.apply(config)));
        }
        if configs.is_empty() {
            return Err(shape_error("at least one path".to_owned(), "none".to_owned()));
        }
        let dims = [samples.len(), path_len];
        let context = match self.settings.input {
            RankerInput::Joints => None,
            RankerInput::Context => {
                let features = samples.iter().flat_map(|sample| self.context_features(sample)).collect();
                Some(tensor(features, [samples.len(), CONTEXT_FEATURES], device))
            }
        };
        Ok(PathTensors { configs: tensor(configs, [dims[0] * dims[1], DOF], device), context, dims })
    }

    fn context_features(&self, sample: &RankerSample<'_>) -> [f32; CONTEXT_FEATURES] {
        let RankedPath { path, collides } = sample.path;
        let context = sample.context;
        let mut features = [0.0; CONTEXT_FEATURES];
        let (configs, rest) = features.split_at_mut(2 * DOF);
        configs[..DOF].copy_from_slice(&self.joint_scale.apply(path.start()));
        configs[DOF..].copy_from_slice(&self.joint_scale.apply(path.goal()));
        rest[..GOAL_FEATURES].copy_from_slice(&goal_features(&context.goal));
        rest[GOAL_FEATURES..].copy_from_slice(&[f32::from(u8::from(*collides)), context.gripper_open, context.time]);
        features
    }

    /// What a checkpoint stores.
    #[must_use]
    pub fn state(&self) -> RankerState {
        RankerState { online: export(&self.online), target: export(&self.target), adam: self.adam.state().clone() }
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

fn check(settings: &RankerSettings) -> Result<()> {
    if settings.config_widths.is_empty() {
        return Err(Error::Config("ranker.config_widths: expected at least one layer".to_owned()));
    }
    if settings.config_widths.iter().chain(&settings.head_widths).any(|&width| width == 0) {
        return Err(Error::Config("ranker: every layer needs at least one output".to_owned()));
    }
    for (name, factor) in [("discount", settings.discount), ("target_mix", settings.target_mix)] {
        if !(0.0..=1.0).contains(&factor) {
            return Err(Error::Config(format!("ranker.{name}: expected 0 to 1, found {factor}")));
        }
    }
    Ok(())
}

fn shape_error(expected: String, found: String) -> Error {
    Error::Shape { what: "path for the ranker", expected, found }
}

/// Mean over critics of the value of path `idx`.
fn mean(per_critic: &[Vec<f32>], idx: usize) -> f32 {
    per_critic.iter().map(|values| values[idx]).sum::<f32>() / per_critic.len() as f32
}
