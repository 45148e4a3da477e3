//! The path policy `π`: one more candidate path, cloned from the paths of successful episodes
//! (section IV-B, "Path Learning").
//!
//! The network is asked once per configuration. It reads where the path starts and ends and the
//! fraction `s` of the way, and answers how far the configuration lies from the straight
//! joint-space line:
//! `c(s) = c_start + s (c_goal - c_start) + 4 s (1 - s) f(c_start, c_goal, g, s)`. So both ends are
//! exact from the first step on, and the untrained policy, whose last layer is zero, proposes the
//! straight line.
//!
//! # Differences from the paper
//!
//! - The paper's network has `d` outputs and a path `T d` numbers; it does not say how the path
//!   comes about. Asking once per configuration, with `s` as an input, keeps the paper's sizes and
//!   serves any `T`.
//! - Inputs are the start and a goal configuration and the next-best pose with its gripper command,
//!   instead of proprioception and the pose: a goal pose has many configurations, and the path has
//!   to end in the one that was chosen.
//! - The loss is the mean over the batch, configurations and joints of the squared differences,
//!   where the paper has their sum.

use crate::error::{Error, Result};
use crate::features::{GOAL_FEATURES, JointScale, goal_features};
use crate::nn::{Adam, AdamSettings, AdamState, Backend, Mlp, NamedTensor, ParameterGradients};
use crate::nn::{Spread, export, import, in_halves, parameter_gradients, sum_of_gradients};
use crate::nn::{tensor, values};
use crate::path::JointPath;
use crate::q_attention::{NetworkCost, NextBestPose};
use crate::rng::Rng;
use crate::robot::{DOF, JointConfig, Robot};

use burn::module::Module as _;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// Numbers per configuration: start, goal configuration, next-best pose, fraction of the way.
const INPUTS: usize = 2 * DOF + GOAL_FEATURES + 1;

/// Settings of the policy: its network and its training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySettings {
    /// Output sizes of the layers without the last (one per joint): 64, 256, 256 in the paper.
    pub widths: Vec<usize>,
    /// Optimiser.
    pub adam: AdamSettings,
}

/// A path of an episode that ended in success, demonstrations included: `ξ*` in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicySample<'a> {
    /// The path.
    pub path: &'a JointPath,
    /// The pose that it led to.
    pub goal: &'a NextBestPose,
    /// Importance weight from prioritised replay; 1 for uniform sampling.
    pub weight: f32,
}

/// Everything that makes a policy go on bit by bit: part of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyState {
    /// The network.
    pub network: Vec<NamedTensor>,
    /// The optimiser.
    pub adam: AdamState,
}

/// The path policy with its optimiser.
#[derive(Debug)]
pub struct Policy {
    joint_scale: JointScale,
    device: Device,
    network: Mlp,
    adam: Adam,
}

/// Input rows of the network with what turns its outputs into joint offsets.
#[derive(Debug, Default)]
struct Rows {
    /// `[N, INPUTS]`.
    inputs: Vec<f32>,
    /// `4 s (1 - s)` per row.
    bumps: Vec<f32>,
}

impl Policy {
    /// A policy with fresh weights from `rng` (stream `Init`).
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when a layer has no outputs.
    pub fn new(
        settings: &PolicySettings,
        robot: &Robot,
        backend: Backend,
        rng: &mut Rng,
    ) -> Result<Self> {
        if settings.widths.contains(&0) {
            return Err(Error::Config(
                "policy.widths: every layer needs at least one output".to_owned(),
            ));
        }
        let widths: Vec<_> =
            [INPUTS].into_iter().chain(settings.widths.iter().copied()).chain([DOF]).collect();
        let device = backend.device();
        let network = Mlp::new(&widths, Spread::Zero, &device, rng);
        let adam = Adam::new(settings.adam, &network);
        Ok(Self { joint_scale: JointScale::new(robot), device, network, adam })
    }

    /// The path that the policy proposes from `start` to `goal_config`, which reaches `goal`, in
    /// `n_configs` configurations.
    ///
    /// The caller tests that the path stays within the limits and is short enough to be ranked.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] with fewer than two configurations; [`Error::NotFinite`] when the network's
    /// answer is no number.
    pub fn path(
        &self,
        start: &JointConfig,
        goal_config: &JointConfig,
        goal: &NextBestPose,
        n_configs: usize,
    ) -> Result<JointPath> {
        if n_configs < 2 {
            let expected = "at least 2 configurations".to_owned();
            return Err(Error::Shape {
                what: "path of the policy",
                expected,
                found: n_configs.to_string(),
            });
        }
        let mut rows = Rows::default();
        self.push_rows(&mut rows, [start, goal_config], goal, n_configs);
        let outputs =
            values(self.network.forward(tensor(rows.inputs, [n_configs, INPUTS], &self.device)));
        if let Some(output) = outputs.iter().find(|output| !output.is_finite()) {
            let found = format!("output {output}");
            return Err(Error::NotFinite { network: "policy", found });
        }
        let configs =
            outputs.chunks_exact(DOF).zip(&rows.bumps).enumerate().map(|(idx, (output, bump))| {
                // The ends are exact even where the line's arithmetic is not.
                match idx {
                    0 => *start,
                    _ if idx + 1 == n_configs => *goal_config,
                    _ => {
                        let line = start.lerp(goal_config, fraction(idx, n_configs));
                        JointConfig::from_fn(DOF, |j| line[j] + bump * output[j])
                    }
                }
            });
        JointPath::new(configs.collect())
    }

    /// Parameters, and operations of one forward pass of a path of `path_len` configurations.
    #[must_use]
    pub fn cost(&self, path_len: usize) -> NetworkCost {
        let parameters = self.network.num_params();
        NetworkCost { parameters, flops: 2 * path_len * parameters }
    }

    /// One gradient step towards the paths of `batch`, which may differ in length; the loss before
    /// it, in square radians.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] when the batch is empty.
    pub fn update(&mut self, batch: &[PolicySample<'_>]) -> Result<f32> {
        if batch.is_empty() {
            let expected = "at least one path".to_owned();
            return Err(Error::Shape {
                what: "batch of the policy",
                expected,
                found: "none".to_owned(),
            });
        }
        let halves = in_halves(batch, |half| self.half(half, batch.len()));
        let loss = halves.iter().map(|half| half.0).sum();
        let gradients = sum_of_gradients(halves.into_iter().map(|half| half.1));
        // Line 18: μ ← μ - λ ∇J_π.
        self.network = self.adam.step(self.network.clone(), gradients);
        Ok(loss)
    }

    /// Loss and gradients of some samples of a batch of `n_samples`.
    fn half(&self, batch: &[PolicySample<'_>], n_samples: usize) -> (f32, ParameterGradients) {
        let mut rows = Rows::default();
        let (mut offsets, mut weights) = (Vec::new(), Vec::new());
        for sample in batch {
            let configs = sample.path.configs();
            self.push_rows(
                &mut rows,
                [sample.path.start(), sample.path.goal()],
                sample.goal,
                configs.len(),
            );
            // The mean of each path, so that a path of many configurations counts no more than a
            // short one.
            let weight = sample.weight / (n_samples * configs.len() * DOF) as f32;
            weights.extend(configs.iter().map(|_| weight));
            for (idx, config) in configs.iter().enumerate() {
                let line =
                    sample.path.start().lerp(sample.path.goal(), fraction(idx, configs.len()));
                offsets.extend(config.iter().zip(line.iter()).map(|(q, on_line)| q - on_line));
            }
        }

        let n = weights.len();
        let device = self.device.clone().autodiff();
        let leaves = self.network.clone().train();
        let outputs = leaves.forward(tensor(rows.inputs, [n, INPUTS], &device));
        let predicted = outputs * tensor(rows.bumps, [n, 1], &device);
        let squares = (predicted - tensor(offsets, [n, DOF], &device)).square();
        let loss = (squares * tensor(weights, [n, 1], &device)).sum();
        let gradients = parameter_gradients(&leaves, loss.backward());
        (loss.into_scalar(), gradients)
    }

    fn push_rows(
        &self,
        rows: &mut Rows,
        ends: [&JointConfig; 2],
        goal: &NextBestPose,
        n_configs: usize,
    ) {
        let [start, end] = ends.map(|config| self.joint_scale.apply(config));
        let goal = goal_features(goal);
        for idx in 0..n_configs {
            let s = fraction(idx, n_configs);
            rows.inputs.extend(start.iter().chain(&end).chain(&goal).chain(&[2.0 * s - 1.0]));
            rows.bumps.push(4.0 * s * (1.0 - s));
        }
    }

    /// State of the policy, for a checkpoint.
    #[must_use]
    pub fn state(&self) -> PolicyState {
        PolicyState { network: export(&self.network), adam: self.adam.state().clone() }
    }

    /// Goes on from a checkpoint of a policy with the same settings.
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] naming the tensor that does not fit; the policy is unchanged then.
    pub fn restore(&mut self, state: &PolicyState) -> Result<()> {
        let network = import(self.network.clone(), &state.network)?;
        self.adam.restore(&state.adam)?;
        self.network = network;
        Ok(())
    }
}

/// Fraction of the way of configuration `idx`.
fn fraction(idx: usize, n_configs: usize) -> f32 {
    idx as f32 / (n_configs - 1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::golden::GoldenGoal;
    use crate::nn::GradientClip;
    use crate::nn::golden::{assert_close, assert_tensors_close};
    use crate::rng::{Stream, stream};
    use crate::robot::{Gripper, PANDA};
    use glamx::{Pose3, Quat, Vec3};

    fn settings() -> PolicySettings {
        let adam = AdamSettings { learning_rate: 3e-3, l2: 0.0, clip: GradientClip::None };
        PolicySettings { widths: vec![32, 64, 64], adam }
    }

    fn policy(seed: u64) -> Policy {
        Policy::new(&settings(), &PANDA, Backend::Flex, &mut stream(seed, Stream::Init, 1))
            .expect("valid settings")
    }

    fn goal() -> NextBestPose {
        let pose = Pose3::from_parts(Vec3::new(0.5, -0.1, 0.3), Quat::from_rotation_x(3.0));
        NextBestPose { pose, gripper: Gripper::Open }
    }

    /// An arc of `n` configurations around the straight line.
    fn arc(n: usize) -> JointPath {
        let end = PANDA.start.map(|q| q - 0.4);
        let configs = (0..n).map(|idx| {
            let s = idx as f32 / (n - 1) as f32;
            let line = PANDA.start.lerp(&end, s);
            JointConfig::from_fn(DOF, |j| {
                line[j] + 0.3 * (core::f32::consts::PI * s).sin() * (j as f32 - 3.0) / 3.0
            })
        });
        JointPath::new(configs.collect()).expect("several configurations")
    }

    fn largest_difference(a: &JointPath, b: &JointPath) -> f32 {
        a.configs()
            .iter()
            .zip(b.configs())
            .fold(0.0, |most, (a, b)| a.max_joint_distance(b).max(most))
    }

    #[test]
    fn the_untrained_policy_proposes_the_straight_line() {
        let end = PANDA.start.map(|q| q + 0.3);
        let path = policy(1).path(&PANDA.start, &end, &goal(), 9).expect("a path");
        for (idx, config) in path.configs().iter().enumerate() {
            assert!(config.max_joint_distance(&PANDA.start.lerp(&end, idx as f32 / 8.0)) < 1e-6);
        }
    }

    #[test]
    fn it_learns_a_path_and_keeps_the_ends_exact() {
        let demonstrated = arc(12);
        let goal = goal();
        let batch = [PolicySample { path: &demonstrated, goal: &goal, weight: 1.0 }];
        let mut policy = policy(2);
        let propose = |policy: &Policy, n| {
            policy.path(demonstrated.start(), demonstrated.goal(), &goal, n).expect("a path")
        };
        let before = largest_difference(&propose(&policy, 12), &demonstrated);
        for _ in 0..200 {
            policy.update(&batch).expect("a valid batch");
            let path = propose(&policy, 12);
            assert_eq!((path.start(), path.goal()), (demonstrated.start(), demonstrated.goal()));
        }
        let after = largest_difference(&propose(&policy, 12), &demonstrated);
        assert!(
            before > 0.25 && after < 0.03,
            "largest difference of a joint {before}, then {after} rad"
        );
        // The same curve in another number of configurations.
        let finer = largest_difference(&propose(&policy, 23), &arc(23));
        assert!(finer < 0.04, "{finer} rad");
    }

    #[test]
    fn the_same_seed_gives_the_same_losses_and_a_restored_policy_goes_on_bit_by_bit() {
        let (paths, goal) = ([arc(8), arc(11)], goal());
        let batch = paths.each_ref().map(|path| PolicySample { path, goal: &goal, weight: 0.5 });
        let run = |policy: &mut Policy, n| -> Vec<u32> {
            (0..n).map(|_| policy.update(&batch).expect("a valid batch").to_bits()).collect()
        };
        let mut straight = policy(3);
        let losses = run(&mut straight, 20);
        assert_eq!(losses, run(&mut policy(3), 20));
        let mut resumed = policy(4);
        resumed.restore(&straight.state()).expect("the same settings");
        assert_eq!(run(&mut straight, 5), run(&mut resumed, 5));
        assert_eq!(straight.state(), resumed.state());
    }

    #[test]
    fn broken_input_is_an_error() {
        let mut policy = policy(1);
        assert!(policy.path(&PANDA.start, &PANDA.start, &goal(), 1).is_err());
        assert!(policy.update(&[]).is_err());
        let settings = PolicySettings { widths: vec![8, 0], ..settings() };
        assert!(
            Policy::new(&settings, &PANDA, Backend::Flex, &mut stream(0, Stream::Init, 1)).is_err()
        );
    }

    #[derive(Deserialize)]
    struct Case {
        settings: PolicySettings,
        batch: Vec<Sample>,
        before: Vec<NamedTensor>,
        path: Vec<JointConfig>,
        losses: Vec<f32>,
        after: Vec<NamedTensor>,
    }

    #[derive(Deserialize)]
    struct Sample {
        configs: Vec<JointConfig>,
        goal: GoldenGoal,
        weight: f32,
    }

    #[test]
    fn path_losses_and_parameters_are_those_of_pytorch() {
        let reference = include_str!("../../tests/golden/policy.json");
        let cases: Vec<Case> =
            serde_json::from_str(reference).expect("written by tests/peers/networks.py");
        for case in &cases {
            let rng = &mut stream(0, Stream::Init, 1);
            let mut policy =
                Policy::new(&case.settings, &PANDA, Backend::Flex, rng).expect("valid settings");
            let adam = policy.state().adam;
            policy
                .restore(&PolicyState { network: case.before.clone(), adam })
                .expect("tensors of these settings");
            let path_of = |sample: &Sample| {
                JointPath::new(sample.configs.clone()).expect("at least two configurations")
            };
            let owned: Vec<_> = case
                .batch
                .iter()
                .map(|sample| (path_of(sample), sample.goal.next_best_pose()))
                .collect();
            let (path, goal) = &owned[0];
            let found =
                policy.path(path.start(), path.goal(), goal, case.path.len()).expect("a path");
            for (found, expected) in found.configs().iter().zip(&case.path) {
                assert_close("path", found, expected, 1e-5);
            }
            let samples: Vec<_> = owned.iter().zip(&case.batch).collect();
            let batch: Vec<_> = samples
                .iter()
                .map(|((path, goal), sample)| PolicySample { path, goal, weight: sample.weight })
                .collect();
            for expected in &case.losses {
                assert_close(
                    "loss",
                    &[policy.update(&batch).expect("a valid batch")],
                    &[*expected],
                    1e-5,
                );
            }
            assert_tensors_close(&policy.state().network, &case.after, 2e-5);
        }
    }
}
