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
//!   demonstrations need.
//! - Joint angles are scaled so that the limits are ±1; the paper does not say how they enter.
//! - The paper calls the network "the path policy" where it describes it; it is the ranker's.
//! - Optimiser, discount and target mix are not in the paper; presets take the released code's. Its
//!   twin networks ([`Critics::Twin`]) and clipped targets ([`TargetRange::UnitInterval`]) are
//!   settings.

#[cfg(test)]
mod golden;
mod network;

use crate::error::{Error, Result};
use crate::features::JointScale;
use crate::nn::{Adam, AdamSettings, AdamState, Backend, NamedTensor};
use crate::nn::{export, import, mix, tensor, values};
use crate::path::JointPath;
use crate::q_attention::{NetworkCost, NextBestPose};
use crate::rng::Rng;
use crate::robot::Robot;
use network::{Encoding, RankerNetwork};
use std::sync::Arc;

use burn::module::Module as _;
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
}

/// Number of value networks that are trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Critics {
    /// One, as in the paper.
    Single,
    /// Two: targets use the smaller value, ranking the mean, as in the released code.
    Twin,
}

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
        let samples: Vec<_> = paths.iter().map(|path| RankerSample { context, path }).collect();
        if samples.is_empty() {
            return Ok(Vec::new());
        }
        let per_critic = self.online.forward(&self.encoding.encode(&samples, &self.device)?);
        Ok((0..paths.len()).map(|idx| mean(&per_critic, idx)).collect())
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
        let targets = self.targets(batch)?;
        let taken: Vec<_> = batch.iter().map(|transition| transition.taken).collect();
        let leaves = self.online.clone().train();
        let device = self.device.clone().autodiff();
        let input = self.encoding.encode(&taken, &device)?;
        let value_tensors: Vec<_> =
            leaves.critics.iter().map(|critic| critic.forward(&input)).collect();
        let per_critic: Vec<_> =
            value_tensors.iter().map(|value| values(value.clone().inner())).collect();

        let n = batch.len();
        let weight =
            tensor(batch.iter().map(|transition| transition.weight).collect(), [n], &device);
        let target = tensor(targets.clone(), [n], &device);
        let loss = value_tensors
            .into_iter()
            .map(|value| ((target.clone() - value).square() * weight.clone()).mean())
            .reduce(Tensor::add)
            .expect("a ranker has at least one critic");
        let gradients = loss.backward();

        // Line 19: σ ← σ - λ ∇J_R; line 20: σ' ← τσ + (1-τ)σ'.
        self.online = self.adam.step(self.online.clone(), &leaves, gradients);
        self.target = mix(self.target.clone(), &self.online, self.settings.target_mix);
        // Of the values before the step, as are the targets.
        let td_errors = (0..n).map(|idx| targets[idx] - mean(&per_critic, idx)).collect();
        Ok(RankerUpdate { loss: loss.into_scalar(), td_errors })
    }

    /// `r + γ Q'(ξ_{t+1})`, or `r` where nothing follows.
    fn targets(&self, batch: &[RankerTransition<'_>]) -> Result<Vec<f32>> {
        let next: Vec<_> = batch.iter().filter_map(|transition| transition.next).collect();
        let per_critic = if next.is_empty() {
            Vec::new()
        } else {
            self.target.forward(&self.encoding.encode(&next, &self.device)?)
        };
        // Of two critics the smaller value, against overestimates. One entry for each transition
        // that goes on, in the order of the batch.
        let mut lowest = (0..next.len())
            .map(|idx| per_critic.iter().fold(f32::INFINITY, |low, values| low.min(values[idx])));
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

/// Mean over critics of the value of path `idx`.
fn mean(per_critic: &[Vec<f32>], idx: usize) -> f32 {
    per_critic.iter().map(|values| values[idx]).sum::<f32>() / per_critic.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::GradientClip;
    use crate::rng::{Stream, stream};
    use crate::robot::{Gripper, PANDA};

    use glamx::{Pose3, Quat, Vec3};
    use rand::RngExt as _;

    fn settings() -> RankerSettings {
        RankerSettings {
            input: RankerInput::Context,
            config_widths: vec![32, 64],
            head_widths: vec![32],
            critics: Critics::Single,
            target_range: TargetRange::Unbounded,
            discount: 0.99,
            target_mix: 0.05,
            adam: AdamSettings { learning_rate: 3e-3, l2: 0.0, clip: GradientClip::None },
        }
    }

    fn ranker(settings: &RankerSettings, seed: u64) -> Ranker {
        Ranker::new(settings, &PANDA, Backend::Flex, &mut stream(seed, Stream::Init, 0))
            .expect("valid settings")
    }

    fn context() -> RankerContext {
        let pose = Pose3::from_parts(Vec3::new(0.4, 0.1, 0.2), Quat::from_rotation_x(3.0));
        RankerContext {
            goal: NextBestPose { pose, gripper: Gripper::Close },
            gripper_open: 1.0,
            time: 0.5,
        }
    }

    /// A path of eight configurations from the start to a fixed goal, bent by `bend` radians at
    /// every joint.
    fn bent_path(bend: f32) -> RankedPath {
        let goal = PANDA.start.map(|q| q + 0.5);
        let configs = (0..8).map(|idx| {
            let s = idx as f32 / 7.0;
            PANDA.start.lerp(&goal, s).map(|q| q + 4.0 * s * (1.0 - s) * bend)
        });
        RankedPath {
            path: JointPath::new(configs.collect()).expect("eight configurations"),
            collides: false,
        }
    }

    fn random_paths(n: usize, rng: &mut Rng) -> Vec<RankedPath> {
        (0..n).map(|_| bent_path(rng.random_range(-1.0..1.0))).collect()
    }

    fn transition<'a>(
        taken: &'a RankedPath,
        next: Option<&'a RankedPath>,
        context: &'a RankerContext,
    ) -> RankerTransition<'a> {
        let sample = |path| RankerSample { context, path };
        RankerTransition { taken: sample(taken), reward: 0.7, next: next.map(sample), weight: 1.0 }
    }

    #[test]
    fn the_target_is_the_reward_alone_when_the_episode_terminated() {
        let (ranker, context) = (ranker(&settings(), 1), context());
        let (taken, next) = (bent_path(0.1), bent_path(-0.3));
        let batch = [transition(&taken, None, &context), transition(&taken, Some(&next), &context)];
        let targets = ranker.targets(&batch).expect("a valid batch");
        let value = ranker.values(&context, &[next]).expect("one path")[0];
        assert_eq!(targets[0].to_bits(), 0.7_f32.to_bits());
        assert_eq!(targets[1], 0.7 + 0.99 * value);
    }

    #[test]
    fn the_order_of_configurations_between_the_ends_does_not_matter_and_the_context_does() {
        let (context, path) = (context(), bent_path(0.4));
        let mut configs = path.path.configs().to_vec();
        configs[1..7].reverse();
        let shuffled = RankedPath {
            path: JointPath::new(configs).expect("eight configurations"),
            collides: false,
        };
        let colliding = RankedPath { collides: true, ..path.clone() };
        let paths = [path, shuffled, colliding];
        let values = |input| {
            ranker(&RankerSettings { input, ..settings() }, 2)
                .values(&context, &paths)
                .expect("three paths")
        };
        let seen = values(RankerInput::Context);
        assert_eq!(seen[0], seen[1]);
        assert_ne!(seen[0], seen[2]);
        let unseen = values(RankerInput::Joints);
        assert_eq!(unseen[0], unseen[2]);
    }

    #[test]
    fn twin_critics_rank_by_their_mean_and_bootstrap_from_the_smaller() {
        let settings = RankerSettings { critics: Critics::Twin, ..settings() };
        let (ranker, context) = (ranker(&settings, 3), context());
        let path = bent_path(0.2);
        let sample = RankerSample { context: &context, path: &path };
        let per_critic = ranker
            .target
            .forward(&ranker.encoding.encode(&[sample], &ranker.device).expect("one path"));
        let (a, b) = (per_critic[0][0], per_critic[1][0]);
        assert_ne!(a, b);
        let target =
            ranker.targets(&[transition(&path, Some(&path), &context)]).expect("a valid batch")[0];
        assert_eq!(target, 0.7 + 0.99 * a.min(b));
        assert_eq!(ranker.values(&context, &[path]).expect("one path"), [(a + b) / 2.0]);
    }

    #[test]
    fn it_learns_which_kind_of_path_is_rewarded() {
        // Three kinds of path lead to the goal, and only the one bent upwards opens the drawer.
        let kinds = [0.0, 0.6, -0.6];
        let context = context();
        for seed in 0..3 {
            let mut ranker = ranker(&settings(), seed);
            let mut rng = stream(seed, Stream::Replay, 0);
            let mut around = |bend: f32| bent_path(bend + rng.random_range(-0.15..0.15));
            for update in 0..150 {
                let paths: Vec<_> = (0..24).map(|idx| around(kinds[(idx + update) % 3])).collect();
                let taken = |(idx, path)| {
                    let reward = if (idx + update) % 3 == 1 { 1.0 } else { 0.0 };
                    RankerTransition { reward, ..transition(path, None, &context) }
                };
                let batch: Vec<_> = paths.iter().enumerate().map(taken).collect();
                ranker.update(&batch).expect("a valid batch");
            }
            let candidates: Vec<_> = (0..30).map(|idx| around(kinds[idx % 3])).collect();
            let values = ranker.values(&context, &candidates).expect("paths of one length");
            let best =
                (0..30).max_by(|&a, &b| values[a].total_cmp(&values[b])).expect("thirty paths");
            assert_eq!(best % 3, 1, "seed {seed}: {values:?}");
            let worst_good =
                (1..30).step_by(3).map(|idx| values[idx]).fold(f32::INFINITY, f32::min);
            let best_bad = (0..30)
                .filter(|idx| idx % 3 != 1)
                .map(|idx| values[idx])
                .fold(f32::NEG_INFINITY, f32::max);
            assert!(worst_good > best_bad, "seed {seed}: {values:?}");
        }
    }

    /// Losses of `n` updates on random batches.
    fn losses(ranker: &mut Ranker, n: u64) -> Vec<u32> {
        let context = context();
        (0..n)
            .map(|idx| {
                let mut rng = stream(9, Stream::Replay, idx);
                let (taken, next) = (random_paths(16, &mut rng), random_paths(16, &mut rng));
                let batch: Vec<_> = taken
                    .iter()
                    .zip(&next)
                    .map(|(taken, next)| transition(taken, Some(next), &context))
                    .collect();
                ranker.update(&batch).expect("a valid batch").loss.to_bits()
            })
            .collect()
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn the_same_seed_gives_the_same_losses_for_any_thread_count() {
        // Wide enough for every matrix product to be split.
        let settings =
            RankerSettings { config_widths: vec![64, 256], head_widths: vec![256], ..settings() };
        let run = |n_threads| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool");
            pool.install(|| losses(&mut ranker(&settings, 4), 20))
        };
        let alone = run(1);
        assert_eq!(alone, run(1));
        assert_eq!(alone, run(2));
        assert_eq!(alone, run(5));
        assert!(f32::from_bits(alone[19]) < f32::from_bits(alone[0]));
    }

    #[test]
    fn a_restored_ranker_goes_on_bit_by_bit() {
        let mut straight = ranker(&settings(), 5);
        losses(&mut straight, 3);
        let mut resumed = ranker(&settings(), 6);
        resumed.restore(&straight.state()).expect("the same settings");
        assert_eq!(losses(&mut straight, 5), losses(&mut resumed, 5));
        assert_eq!(straight.state(), resumed.state());
        let other = ranker(&RankerSettings { head_widths: vec![31], ..settings() }, 5);
        assert!(resumed.restore(&other.state()).is_err());
    }

    #[test]
    fn broken_input_is_an_error() {
        let (mut ranker, context) = (ranker(&settings(), 1), context());
        let short = RankedPath { path: bent_path(0.0).path.resample(3), collides: false };
        let paths = [bent_path(0.0), short];
        assert!(ranker.values(&context, &paths).is_err());
        assert!(
            ranker
                .update(&[
                    transition(&paths[0], None, &context),
                    transition(&paths[1], None, &context)
                ])
                .is_err()
        );
        assert!(ranker.update(&[]).is_err());
        assert_eq!(ranker.values(&context, &[]), Ok(vec![]));
        let build = |settings: RankerSettings| {
            Ranker::new(&settings, &PANDA, Backend::Flex, &mut stream(0, Stream::Init, 0))
        };
        assert!(build(RankerSettings { config_widths: vec![], ..settings() }).is_err());
        assert!(build(RankerSettings { discount: 1.5, ..settings() }).is_err());
    }
}
