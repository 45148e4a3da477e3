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
//! With [`PolicySpace::Grip`] it bends the straight line of the grip instead, seen from the next-best
//! pose, and the arm follows: the arc of a hinge is then one and the same answer wherever the hinge
//! stands.
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
//! - [`PolicySpace::Grip`] is not in the paper.

mod encoding;

pub use encoding::PolicySpace;

use crate::error::{Error, Result};
use crate::nn::{Adam, AdamSettings, AdamState, Backend, Mlp, NamedTensor, ParameterGradients};
use crate::nn::{Spread, export, import, in_halves, parameter_gradients, sum_of_gradients};
use crate::nn::{tensor, values};
use crate::path::{JointPath, Rejection};
use crate::q_attention::{NetworkCost, NextBestPose};
use crate::rng::Rng;
use crate::robot::{JointConfig, Robot};
use encoding::{Encoding, fraction};
use std::sync::Arc;

use burn::module::Module as _;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// Settings of the policy: its network and its training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySettings {
    /// What its outputs bend.
    #[serde(default)]
    pub space: PolicySpace,
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

/// The policy's path, or why the arm cannot follow what it proposes.
pub type Proposal = core::result::Result<JointPath, Rejection>;

/// The path policy with its optimiser.
#[derive(Debug)]
pub struct Policy {
    encoding: Encoding,
    device: Device,
    network: Mlp,
    adam: Adam,
}

impl Policy {
    /// A policy with fresh weights from `rng` (stream `Init`).
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when a layer has no outputs.
    pub fn new(
        settings: &PolicySettings,
        robot: &Arc<Robot>,
        backend: Backend,
        rng: &mut Rng,
    ) -> Result<Self> {
        if settings.widths.contains(&0) {
            return Err(Error::Config(
                "policy.widths: every layer needs at least one output".to_owned(),
            ));
        }
        let encoding = Encoding::new(settings.space, robot);
        let widths: Vec<_> = [encoding.n_inputs()]
            .into_iter()
            .chain(settings.widths.iter().copied())
            .chain([encoding.n_outputs()])
            .collect();
        let device = backend.device();
        let network = Mlp::new(&widths, Spread::Zero, &device, rng);
        let adam = Adam::new(settings.adam, &network);
        Ok(Self { encoding, device, network, adam })
    }

    /// The path that the policy proposes from `start` to `goal_config`, which reaches `goal`, in
    /// `n_configs` configurations; in the space of the grip the arm may fail to follow.
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
    ) -> Result<Proposal> {
        if n_configs < 2 {
            let expected = "at least 2 configurations".to_owned();
            return Err(Error::Shape {
                what: "path of the policy",
                expected,
                found: n_configs.to_string(),
            });
        }
        let ends = [start, goal_config];
        let mut inputs = Vec::new();
        self.encoding.push_inputs(&mut inputs, ends, goal, n_configs);
        let inputs = tensor(inputs, [n_configs, self.encoding.n_inputs()], &self.device);
        let mut outputs = values(self.network.forward(inputs));
        if let Some(output) = outputs.iter().find(|output| !output.is_finite()) {
            let found = format!("output {output}");
            return Err(Error::NotFinite { network: "policy", found });
        }
        let n_outputs = self.encoding.n_outputs();
        for (idx, row) in outputs.chunks_exact_mut(n_outputs).enumerate() {
            let bump = bump(fraction(idx, n_configs));
            row.iter_mut().for_each(|output| *output *= bump);
        }
        self.encoding.bent(ends, goal, &outputs)
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
        let [n_inputs, n_outputs] = [self.encoding.n_inputs(), self.encoding.n_outputs()];
        let (mut inputs, mut bumps) = (Vec::new(), Vec::new());
        let (mut offsets, mut weights) = (Vec::new(), Vec::new());
        for PolicySample { path, goal, weight } in batch {
            let n_configs = path.configs().len();
            self.encoding.push_inputs(&mut inputs, [path.start(), path.goal()], goal, n_configs);
            self.encoding.push_offsets(&mut offsets, path, goal);
            bumps.extend((0..n_configs).map(|idx| bump(fraction(idx, n_configs))));
            // The mean of each path, so that a path of many configurations counts no more than a
            // short one.
            let weight = weight / (n_samples * n_configs * n_outputs) as f32;
            weights.extend((0..n_configs).map(|_| weight));
        }

        let n = weights.len();
        let device = self.device.clone().autodiff();
        let leaves = self.network.clone().train();
        let outputs = leaves.forward(tensor(inputs, [n, n_inputs], &device));
        let predicted = outputs * tensor(bumps, [n, 1], &device);
        let squares = (predicted - tensor(offsets, [n, n_outputs], &device)).square();
        let loss = (squares * tensor(weights, [n, 1], &device)).sum();
        let gradients = parameter_gradients(&leaves, loss.backward());
        (loss.into_scalar(), gradients)
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

/// `4 s (1 - s)`: nothing at the ends, 1 in the middle.
fn bump(s: f32) -> f32 {
    4.0 * s * (1.0 - s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::golden::GoldenGoal;
    use crate::nn::GradientClip;
    use crate::nn::golden::{assert_close, assert_tensors_close};
    use crate::path::ScrewMotion;
    use crate::rng::{Stream, stream};
    use crate::robot::{DOF, Gripper, PANDA};
    use glamx::{Pose3, Quat, Vec3};

    fn settings() -> PolicySettings {
        let adam = AdamSettings { learning_rate: 3e-3, l2: 0.0, clip: GradientClip::None };
        PolicySettings { space: PolicySpace::Joints, widths: vec![32, 64, 64], adam }
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
        let path =
            policy(1).path(&PANDA.start, &end, &goal(), 9).expect("numbers").expect("a path");
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
            policy
                .path(demonstrated.start(), demonstrated.goal(), &goal, n)
                .expect("numbers")
                .expect("a path")
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

    /// A turn of the grip by 0.7 rad about a hinge 25 cm from it, where the arm starts at `start`.
    fn hinge(start: &JointConfig) -> (JointPath, NextBestPose, Pose3) {
        let grip = PANDA.grip(start);
        let hinge = grip * Pose3::from_translation(Vec3::new(0.0, -0.25, 0.0));
        let direction = grip.rotation * Vec3::Z;
        let point = hinge.translation;
        let screw = ScrewMotion { start: grip, point, direction, angle: 0.7, slide: 0.0 };
        let path = screw.to_joints(&PANDA, start).expect("within reach").resample(30);
        (path, NextBestPose { pose: screw.pose(1.0), gripper: Gripper::Open }, hinge)
    }

    #[test]
    fn in_the_space_of_the_grip_an_arc_is_followed_wherever_its_hinge_stands() {
        let settings = PolicySettings { space: PolicySpace::Grip, ..settings() };
        let init = &mut stream(2, Stream::Init, 1);
        let mut policy =
            Policy::new(&settings, &PANDA, Backend::Flex, init).expect("valid settings");
        let (demonstrated, goal, _) = hinge(&PANDA.start);
        let batch = [PolicySample { path: &demonstrated, goal: &goal, weight: 1.0 }];
        // Elsewhere, and with the hand half turned.
        let mut starts = [PANDA.start; 3];
        starts[1][0] += 0.3;
        starts[2][0] -= 0.3;
        starts[2][DOF - 1] -= core::f32::consts::PI;
        let off_arc = |policy: &Policy, start: &JointConfig| {
            let (truth, mut goal, hinge) = hinge(&PANDA.start);
            let mut upright = *start;
            upright[DOF - 1] = PANDA.start[DOF - 1];
            let moved = PANDA.grip(&upright) * PANDA.grip(&PANDA.start).inverse();
            let turn = moved.rotation;
            let goal_config =
                JointConfig::from_fn(DOF, |j| truth.goal()[j] + start[j] - PANDA.start[j]);
            goal.pose = PANDA.grip(&goal_config);
            let found = policy.path(start, &goal_config, &goal, truth.configs().len());
            let found = found.expect("numbers").expect("a path");
            let hinge = (moved * hinge).translation;
            let radius = |config: &JointConfig| {
                let lever = PANDA.grip(config).translation - hinge;
                let along = turn * PANDA.grip(&PANDA.start).rotation * Vec3::Z;
                (lever - lever.dot(along) * along).length()
            };
            found.configs().iter().fold(0.0, |most: f32, q| most.max((radius(q) - 0.25).abs()))
        };
        let before = off_arc(&policy, &starts[1]);
        for _ in 0..300 {
            policy.update(&batch).expect("a valid batch");
        }
        let after = starts.map(|start| off_arc(&policy, &start));
        assert!(before > 0.01, "a straight line is {before} m off");
        assert!(after.iter().all(|&off| off < 0.002), "{after:?} m off");
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
            let found = policy
                .path(path.start(), path.goal(), goal, case.path.len())
                .expect("numbers")
                .expect("a path");
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
