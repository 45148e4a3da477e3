//! Networks: forward passes and updates, on inputs of which only the size matters.

use super::{Row, agent, environment, measure};
use crate::cli::failure::Result;
use crate::cli::settings::default_preset;
use crate::cli::settings::load_config;
use lpr_core::agent::PoseSource;
use lpr_core::config::Config;

use lpr_core::nn::Backend;
use lpr_core::path::JointPath;
use lpr_core::policy::{Policy, PolicySample};
use lpr_core::q_attention::{ActingNetwork, NextBestPose, QObservation, QSample, UNet};
use lpr_core::ranker::{RankedPath, Ranker, RankerContext, RankerSample, RankerTransition};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::XARM7;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::record_demo;
use lpr_core::train::{Run, Trainer, default_cameras, demonstration_scene};

/// Samples of an update of Q-attention.
const SCENES: usize = 16;
/// Paths of an update of ranker and policy.
const PATHS: usize = 128;
/// Candidates that are ranked.
const CANDIDATES: usize = 41;

pub(super) fn run() -> Result<Vec<Row>> {
    let fast = default_preset();
    let env = environment(&fast)?;
    let mut rows = fast_network(&fast, env.clone())?;
    rows.push(update_fast(&fast, &env)?);
    rows.extend(path_networks(&env)?);
    rows.extend(unet());
    Ok(rows)
}

/// A U-Net of plain layers, of which tests/peers/pytorch has the same.
fn unet() -> [Row; 2] {
    let rng = &mut stream(0, Stream::Init, 2);
    let mut unet = UNet::new(Backend::Flex, rng);
    let batch = (0..SCENES).map(|_| UNet::random_sample(rng)).collect::<Vec<_>>();
    let train = measure("unet_train_b16", || unet.update(&batch));
    [train, measure("unet_infer_b1", || unet.infer(&batch[0]))]
}

/// The network of the preset `fast` with all its heads, at one depth. An update is one gradient
/// step on transitions that end their episodes, with the voxels that it reads.
fn fast_network(fast: &Config, mut env: SimEnvironment) -> Result<Vec<Row>> {
    let mut config = fast.clone();
    config.q_attention.zoom_half_widths.clear();
    config.q_attention.translation_regularisation.truncate(1);
    let mut networks = agent(&config, PoseSource::Learned)?.networks;
    let Some(attention) = &mut networks.q_attention else { return Ok(Vec::new()) };
    let bounds = lpr_core::perception::VoxelBounds::scene(&XARM7)?;
    let seen = QObservation::new(&env.observe(), bounds, config.training.cloud_spacing);
    let action = env.plan().goals[0];
    let batch = [QSample {
        observation: &seen,
        action,
        reward: 1.0,
        next: None,
        weight: 1.0,
        imitated: true,
    }; SCENES];
    let mut rng = stream(0, Stream::Augment, 0);
    let train = measure("fast_train_b16", || attention.update(&batch, &mut rng));
    Ok(vec![train, measure("fast_infer_b1", || attention.act(&seen, ActingNetwork::Online))])
}

/// One update of every network with the preset `fast`, replay included.
fn update_fast(fast: &Config, env: &SimEnvironment) -> Result<Row> {
    let run = Run {
        task: env.task().name.clone(),
        method: lpr_core::agent::Method::Lpr,
        poses: PoseSource::Learned,
        backend: Backend::Flex,
        seed: 0,
        cameras: default_cameras(),
    };
    let chains = record_demo(env, demonstration_scene(0, 0), &fast.demos)?.unwrap_or_default();
    let mut trainer = Trainer::new(fast.clone(), run, env.clone())?;
    chains.iter().try_for_each(|chain| trainer.add_demonstration(chain))?;
    Ok(measure("update_fast", || trainer.update()))
}

/// Ranker and policy in the sizes of the preset `paper`.
fn path_networks(env: &SimEnvironment) -> Result<Vec<Row>> {
    let paper = load_config("paper")?;
    let goal = env.plan().goals[0];
    let context = RankerContext { goal, gripper_open: 1.0, time: 1.0 };
    let mut ranker =
        Ranker::new(&paper.ranker, &XARM7, Backend::Flex, &mut stream(0, Stream::Init, 0))?;
    let mut rows = Vec::new();
    for (name, path_len) in [("ranker_train_b128_t30", 30), ("ranker_train_b128_t100", 100)] {
        let paths = ranked(PATHS, path_len);
        let transition = |path| RankerTransition {
            outcome: 0.0,
            taken: RankerSample { context: &context, path },
            reward: 1.0,
            next: None,
            weight: 1.0,
        };
        let batch: Vec<_> = paths.iter().map(transition).collect();
        rows.push(measure(name, || ranker.update(&batch)));
    }
    let candidates = ranked(CANDIDATES, 30);
    rows.push(measure("ranker_infer_b41_t30", || ranker.values(&context, &candidates)));
    rows.push(policy_train(&paper, &goal)?);
    Ok(rows)
}

fn policy_train(paper: &Config, goal: &NextBestPose) -> Result<Row> {
    let mut policy =
        Policy::new(&paper.policy, &XARM7, Backend::Flex, &mut stream(0, Stream::Init, 1))?;
    let paths = ranked(PATHS, paper.candidates.path_len);
    let batch: Vec<_> =
        paths.iter().map(|ranked| PolicySample { path: &ranked.path, goal, weight: 1.0 }).collect();
    Ok(measure("policy_train_b128", || policy.update(&batch)))
}

/// Different paths of that length.
fn ranked(n_paths: usize, path_len: usize) -> Vec<RankedPath> {
    let end = |idx: usize| XARM7.start.map(|angle| angle + 0.3 * (idx + 1) as f32 / n_paths as f32);
    let path = |idx| {
        JointPath::new(vec![XARM7.start, end(idx)]).expect("finite angles").resample(path_len)
    };
    (0..n_paths).map(|idx| RankedPath { path: path(idx), collides: false }).collect()
}
