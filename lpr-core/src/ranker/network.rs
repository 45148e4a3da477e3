//! The value network and the tensors that it reads.

use super::{RankedPath, RankerContext, RankerInput, RankerSample, RankerSettings};
use crate::error::{Error, Result};
use crate::features::{
    GOAL_FEATURES, GRIP_SCALE, GoalFrame, JointScale, POSE_FEATURES, goal_features, grip_features,
};
use crate::nn::{Mlp, Spread, tensor, values};
use crate::path::JointPath;
use crate::rng::Rng;
use crate::robot::{DOF, JointConfig, Robot};
use std::sync::Arc;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use glamx::Pose3;

/// Numbers of the context: start and goal configuration, next-best pose, collides, gripper open,
/// time.
const CONTEXT_FEATURES: usize = 2 * DOF + GOAL_FEATURES + SITUATION_FEATURES - 1;
/// Numbers of what is the same everywhere: the gripper's command, collides, gripper open, time.
const SITUATION_FEATURES: usize = 4;

/// Numbers of a grip pose in the frame of the goal: position and two columns of the rotation.
const GRIP_FEATURES: usize = POSE_FEATURES;

/// Numbers of a configuration's place: share of the way, and three of the grip's offset from the
/// straight line between the ends, in the frame of the goal.
const CHORD_FEATURES: usize = 4;
/// Offset that a feature of 1 stands for, metres: arcs that hold and arcs that slip off a hinge
/// differ by millimetres.
const OFFSET_SCALE: f32 = 0.05;
/// Lengths of a path: of the grip's way and of its chord (units of [`GRIP_SCALE`]), the turn of the
/// grip and that of the joints (radians).
const LENGTH_FEATURES: usize = 4;

/// Numbers of one configuration.
const fn config_features(input: RankerInput) -> usize {
    match input {
        RankerInput::Joints | RankerInput::Context => DOF,
        RankerInput::Grip => DOF + GRIP_FEATURES,
        RankerInput::Chord => DOF + GRIP_FEATURES + CHORD_FEATURES,
        RankerInput::Motion => GRIP_FEATURES + CHORD_FEATURES,
    }
}

/// Numbers that only the head reads.
const fn context_features(input: RankerInput) -> usize {
    match input {
        RankerInput::Joints => 0,
        RankerInput::Context => CONTEXT_FEATURES,
        RankerInput::Grip => CONTEXT_FEATURES + GRIP_FEATURES,
        RankerInput::Chord => CONTEXT_FEATURES + GRIP_FEATURES + LENGTH_FEATURES,
        RankerInput::Motion => SITUATION_FEATURES + GRIP_FEATURES + LENGTH_FEATURES,
    }
}

/// One value network.
#[derive(Module, Debug)]
pub(super) struct Critic {
    encoder: Mlp,
    head: Mlp,
}

impl Critic {
    pub(super) fn new(settings: &RankerSettings, device: &Device, rng: &mut Rng) -> Self {
        let encoder_widths: Vec<_> = [config_features(settings.input)]
            .into_iter()
            .chain(settings.config_widths.iter().copied())
            .collect();
        let pooled = encoder_widths[encoder_widths.len() - 1];
        let n_context = context_features(settings.input);
        let head_widths: Vec<_> = [pooled + n_context]
            .into_iter()
            .chain(settings.head_widths.iter().copied())
            .chain([1])
            .collect();
        Self {
            encoder: Mlp::new(&encoder_widths, Spread::Kaiming { slope: 0.0 }, device, rng),
            head: Mlp::new(&head_widths, Spread::Xavier, device, rng),
        }
    }

    /// # Shapes
    ///
    /// - output: `[B]`
    pub(super) fn forward(&self, input: &PathTensors) -> Tensor<1> {
        let [n_paths, path_len] = input.dims;
        let pooled = self.encoder.pooled(input.configs.clone(), path_len);
        let pooled = match &input.context {
            Some(context) => Tensor::cat(vec![pooled, context.clone()], 1),
            None => pooled,
        };
        self.head.forward(pooled).reshape([n_paths])
    }

    /// Multiplications and additions of one forward pass of one path; a weight counts as one.
    pub(super) fn macs(&self, path_len: usize) -> usize {
        path_len * self.encoder.num_params() + self.head.num_params()
    }
}

/// One or two value networks.
#[derive(Module, Debug)]
pub(super) struct RankerNetwork {
    pub(super) critics: Vec<Critic>,
}

impl RankerNetwork {
    pub(super) fn new(settings: &RankerSettings, device: &Device, rng: &mut Rng) -> Self {
        Self {
            critics: (0..settings.critics.count())
                .map(|_| Critic::new(settings, device, rng))
                .collect(),
        }
    }

    /// Values per critic, each per path.
    pub(super) fn forward(&self, input: &PathTensors) -> Vec<Vec<f32>> {
        self.critics.iter().map(|critic| values(critic.forward(input))).collect()
    }
}

/// A batch of paths as tensors.
#[derive(Debug)]
pub(super) struct PathTensors {
    /// `[B * T, J]`, scaled joint angles; with [`RankerInput::Grip`] followed by the grip in the
    /// frame of the goal.
    configs: Tensor<2>,
    /// `[B, context_features]`.
    context: Option<Tensor<2>>,
    /// `B` and `T`.
    dims: [usize; 2],
}

/// Encoding of paths as tensors.
#[derive(Debug)]
pub(super) struct Encoding {
    pub(super) input: RankerInput,
    pub(super) joint_scale: JointScale,
    pub(super) robot: Arc<Robot>,
}

impl Encoding {
    /// # Errors
    ///
    /// [`Error::Shape`] without samples, or when their paths differ in length.
    pub(super) fn encode(
        &self,
        samples: &[RankerSample<'_>],
        device: &Device,
    ) -> Result<PathTensors> {
        let path_len = common_path_len(samples)?;
        let (n_config, n_context) = (config_features(self.input), context_features(self.input));
        let mut configs = Vec::with_capacity(samples.len() * path_len * n_config);
        let mut context = Vec::with_capacity(samples.len() * n_context);
        for sample in samples {
            let path = sample.path.path.configs();
            match self.input {
                RankerInput::Joints => (),
                RankerInput::Context | RankerInput::Grip | RankerInput::Chord => {
                    context.extend(self.context_features(sample));
                }
                RankerInput::Motion => {
                    let all = self.context_features(sample);
                    context.extend_from_slice(&all[CONTEXT_FEATURES - SITUATION_FEATURES..]);
                }
            }
            if matches!(self.input, RankerInput::Joints | RankerInput::Context) {
                configs.extend(path.iter().flat_map(|config| self.joint_scale.apply(config)));
                continue;
            }
            let grips = self.grips_in_goal(path, sample.context);
            for (idx, (config, grip)) in path.iter().zip(&grips).enumerate() {
                if self.input != RankerInput::Motion {
                    configs.extend(self.joint_scale.apply(config));
                }
                configs.extend(grip_features(grip));
                if self.input != RankerInput::Grip {
                    configs.extend(chord_features(idx, &grips));
                }
            }
            // The maximum over the configurations forgets their order: the head is told the start.
            context.extend(grip_features(&grips[0]));
            if self.input != RankerInput::Grip {
                context.extend(length_features(&sample.path.path, &grips));
            }
        }
        let dims = [samples.len(), path_len];
        let context = (n_context > 0).then(|| tensor(context, [samples.len(), n_context], device));
        Ok(PathTensors {
            configs: tensor(configs, [dims[0] * dims[1], n_config], device),
            context,
            dims,
        })
    }

    /// The grip at each configuration seen from the goal: the same hinge gives the same numbers
    /// wherever it stands.
    fn grips_in_goal(&self, path: &[JointConfig], context: &RankerContext) -> Vec<Pose3> {
        let goal = &context.goal.pose;
        let grips: Vec<_> = path.iter().map(|config| self.robot.grip(config)).collect();
        if self.input == RankerInput::Motion {
            let frame = GoalFrame::new(&grips[0], goal);
            return grips.iter().map(|grip| frame.seen(grip)).collect();
        }
        let goal_from_world = goal.inverse();
        grips.iter().map(|grip| goal_from_world * *grip).collect()
    }

    fn context_features(&self, sample: &RankerSample<'_>) -> [f32; CONTEXT_FEATURES] {
        let RankedPath { path, collides } = sample.path;
        let context = sample.context;
        let mut features = [0.0; CONTEXT_FEATURES];
        let (configs, rest) = features.split_at_mut(2 * DOF);
        configs[..DOF].copy_from_slice(&self.joint_scale.apply(path.start()));
        configs[DOF..].copy_from_slice(&self.joint_scale.apply(path.goal()));
        rest[..GOAL_FEATURES].copy_from_slice(&goal_features(&context.goal));
        rest[GOAL_FEATURES..].copy_from_slice(&[
            f32::from(u8::from(*collides)),
            context.gripper_open,
            context.time,
        ]);
        features
    }
}

fn chord_features(idx: usize, grips: &[Pose3]) -> [f32; CHORD_FEATURES] {
    let [start, end] = [grips[0].translation, grips[grips.len() - 1].translation];
    let (chord, from_start) = (end - start, grips[idx].translation - start);
    let along = from_start.dot(chord) / chord.length_squared().max(1e-6);
    let [x, y, z] = ((from_start - along * chord) / OFFSET_SCALE).to_array();
    [idx as f32 / (grips.len() - 1).max(1) as f32, x, y, z]
}

fn length_features(path: &JointPath, grips: &[Pose3]) -> [f32; LENGTH_FEATURES] {
    let [first, last] = [&grips[0], &grips[grips.len() - 1]];
    let way = grips.windows(2).map(|pair| pair[0].translation.distance(pair[1].translation));
    let chord = first.translation.distance(last.translation);
    let turn = grips.windows(2).map(|pair| pair[0].rotation.angle_between(pair[1].rotation));
    [way.sum::<f32>() / GRIP_SCALE, chord / GRIP_SCALE, turn.sum(), path.length()]
}

/// The number of configurations of every path.
///
/// # Errors
///
/// [`Error::Shape`] without samples, or when their paths differ in length.
pub(super) fn common_path_len(samples: &[RankerSample<'_>]) -> Result<usize> {
    let n_configs = |sample: &RankerSample<'_>| sample.path.path.configs().len();
    let Some(expected) = samples.first().map(n_configs) else {
        return Err(shape_error("at least one path".to_owned(), "none".to_owned()));
    };
    match samples.iter().map(n_configs).find(|&found| found != expected) {
        None => Ok(expected),
        Some(found) => {
            Err(shape_error(format!("[{expected}, {DOF}]"), format!("[{found}, {DOF}]")))
        }
    }
}

fn shape_error(expected: String, found: String) -> Error {
    Error::Shape { what: "path for the ranker", expected, found }
}
