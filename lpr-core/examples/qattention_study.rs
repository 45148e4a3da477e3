//! How fast Q-attention learns one keyframe from ten demonstrations of a synthetic scene, and how fast it computes.
//!
//! ```text
//! cargo run -p lpr-core --release --example qattention_study -- [updates] [seed]
//! ```
//!
//! A table with a pan (handle and knob) and two distractors, at random places with random yaw; the keyframe is a grasp of the
//! knob from above with its yaw given by the handle. Prints the share of 100 unseen scenes whose grasp is within 2 cm, and
//! also within 15° (up to the gripper's symmetry), as training goes on.
#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a study that prints its table and may stop at bad arguments"
)]

use std::time::Instant;

use core::f32::consts::PI;
use glamx::{Pose3, Quat, Vec3};
use lpr_core::nn::Backend;
use lpr_core::perception::{Proprio, VoxelBounds};
use lpr_core::q_attention::{NetworkSettings, NextBestPose, QAttention, QAttentionSettings, QObservation, QSample, Weights};
use lpr_core::rng::{Rng, Stream, stream};
use lpr_core::robot::{Gripper, PANDA};
use rand::RngExt as _;

const N_DEMOS: usize = 10;
const N_TEST: usize = 100;
const BATCH: usize = 16;

/// A scene and the grasp that is right in it.
struct Scene {
    observation: QObservation,
    goal: NextBestPose,
}

fn main() {
    let arguments = std::env::args().skip(1).map(|argument| argument.parse::<f32>().unwrap()).collect::<Vec<_>>();
    let argument = |idx: usize, default: f32| arguments.get(idx).copied().unwrap_or(default);
    let (n_updates, seed) = (argument(0, 1200.0) as u64, argument(1, 0.0) as u64);
    let settings = settings(&argument);
    println!("{settings:?}");

    let scenes = |stream_of: Stream, n: usize| (0..n as u64).map(|i| scene(&mut stream(seed, stream_of, i))).collect::<Vec<_>>();
    let (demos, unseen) = (scenes(Stream::Demo, N_DEMOS), scenes(Stream::Placement, N_TEST));
    let n_bytes = demos.iter().map(|demo| demo.observation.n_bytes()).sum::<usize>();
    println!("{} points in the first scene, {} bytes an observation", demos[0].observation.points.len(), n_bytes / N_DEMOS);

    let rng = &mut stream(seed, Stream::Init, 0);
    let mut agent = QAttention::new(settings, VoxelBounds::scene(&PANDA), Backend::Flex, rng).unwrap();
    println!("{:?}", agent.costs());
    println!("chained updates (half the batch goes on): {:.2}/s", chained_rate(agent.clone(), &demos));

    let mut seconds = 0.0;
    println!("updates  weights  coarse  2 cm  and 15 deg  trained s  updates/s  loss");
    for update in 1..=n_updates {
        let rows = rows(&demos, &mut stream(seed, Stream::Replay, update));
        let start = Instant::now();
        let report = agent.update(&rows, &mut stream(seed, Stream::Augment, update));
        seconds += start.elapsed().as_secs_f32();
        if update % (n_updates / 6).max(1) == 0 {
            let rate = update as f32 / seconds;
            for weights in [Weights::Online, Weights::Target] {
                let Score { coarse, near, right } = score(&agent, &unseen, weights);
                print!("{update:7}  {weights:?}  {coarse:6}  {near:4}  {right:10}  {seconds:9.1}  {rate:9.2}");
                println!("  {:?}", report.losses);
            }
        }
    }
    let start = Instant::now();
    let value = agent.act(&unseen[0].observation, Weights::Online).value;
    println!("one decision: {:.1} ms (value {value:.2})", start.elapsed().as_secs_f32() * 1e3);
}

/// The settings under study; later arguments change single numbers.
fn settings(argument: &dyn Fn(usize, f32) -> f32) -> QAttentionSettings {
    QAttentionSettings {
        voxels_per_side: 16,
        zoom_half_widths: vec![0.15],
        rotation_bins: 72,
        discount: 0.99,
        learning_rate: argument(2, 2e-3),
        weight_decay: 1e-6,
        gradient_clip: None,
        target_mix: 0.02,
        translation_regularisation: vec![argument(11, 8.0), argument(12, 1.0)],
        rotation_regularisation: argument(3, 0.6),
        crop_jitter: argument(4, 0.2),
        yaw_range: argument(5, PI / 4.0),
        shift_range: Vec3::new(0.125, 0.125, 0.0),
        network: NetworkSettings::Fast {
            cell_channels: argument(6, 32.0) as usize,
            block_channels: argument(7, 96.0) as usize,
            head_channels: argument(8, 16.0) as usize,
            hidden: argument(9, 256.0) as usize,
            harmonics: argument(10, 8.0) as usize,
        },
    }
}

/// A batch of terminal transitions.
fn rows<'a>(demos: &'a [Scene], rng: &mut Rng) -> Vec<QSample<'a>> {
    let row =
        |demo: &'a Scene| QSample { observation: &demo.observation, action: demo.goal, reward: 1.0, next: None, weight: 1.0 };
    (0..BATCH).map(|_| row(&demos[rng.random_range(0..demos.len())])).collect()
}

/// Updates a second when half of the batch goes on to another observation, as in a replay of whole episodes.
fn chained_rate(mut agent: QAttention, demos: &[Scene]) -> f32 {
    const N: u64 = 10;
    let mut batch = rows(demos, &mut stream(0, Stream::Replay, 0));
    for (i, row) in batch.iter_mut().enumerate().filter(|(i, _)| i % 2 == 0) {
        (row.reward, row.next) = (0.0, Some(&demos[i % demos.len()].observation));
    }
    agent.update(&batch, &mut stream(0, Stream::Augment, 0));
    let start = Instant::now();
    for update in 1..=N {
        agent.update(&batch, &mut stream(0, Stream::Augment, update));
    }
    N as f32 / start.elapsed().as_secs_f32()
}

/// Counts of scenes.
#[derive(Default)]
struct Score {
    /// The first depth attends within one of its voxels of the grasp along each axis.
    coarse: usize,
    /// The grasp is within 2 cm.
    near: usize,
    /// It is also within 15° and closes the gripper.
    right: usize,
}

fn score(agent: &QAttention, scenes: &[Scene], weights: Weights) -> Score {
    let mut score = Score::default();
    for scene in scenes {
        let decision = agent.act(&scene.observation, weights);
        let space = agent.codec().scene();
        let attended = space.point_from_voxel(decision.action.voxels[0]);
        let goal = scene.goal.pose;
        let chosen = decision.goal.pose;
        let near = chosen.translation.distance(goal.translation) < 0.02;
        let turned = goal.rotation * Quat::from_rotation_z(PI);
        let angle = [goal.rotation, turned].map(|goal| chosen.rotation.angle_between(goal));
        let right = angle[0].min(angle[1]) < 15_f32.to_radians() && decision.goal.gripper == scene.goal.gripper;
        score.coarse += usize::from((attended - goal.translation).abs().cmple(1.5 * space.voxel_size()).all());
        score.near += usize::from(near);
        score.right += usize::from(near && right);
    }
    score
}

/// A table, a pan and two distractors.
fn scene(rng: &mut Rng) -> Scene {
    let center = PANDA.workspace_center.extend(0.0);
    let place = |rng: &mut Rng| center + Vec3::new(rng.random_range(-0.2..0.2), rng.random_range(-0.25..0.25), 0.0);
    let pan = place(rng);
    let yaw = rng.random_range(-PI..PI);
    let mut cloud = Vec::new();
    surface(&mut cloud, Pose3::from_translation(center), Vec3::new(0.5, 0.5, 0.0), [150, 120, 90], rng);
    let placed = |at: Vec3, yaw: f32| Pose3::from_parts(at, Quat::from_rotation_z(yaw));
    disc(&mut cloud, pan, 0.11, 0.08, [60, 60, 65], rng);
    disc(&mut cloud, pan + Vec3::Z * 0.08, 0.03, 0.03, [200, 40, 40], rng);
    let handle = placed(pan + Quat::from_rotation_z(yaw) * Vec3::new(0.2, 0.0, 0.0) + Vec3::Z * 0.05, yaw);
    surface(&mut cloud, handle, Vec3::new(0.1, 0.015, 0.01), [30, 30, 30], rng);
    for rgb in [[40, 90, 200], [60, 170, 70]] {
        let mut at = place(rng);
        while at.distance(pan) < 0.2 {
            at = place(rng);
        }
        surface(&mut cloud, placed(at + Vec3::Z * 0.03, rng.random_range(-PI..PI)), Vec3::new(0.03, 0.05, 0.03), rgb, rng);
    }
    let rotation = Quat::from_rotation_z(yaw) * Quat::from_rotation_x(PI);
    let pose = Pose3::from_parts(pan + Vec3::Z * 0.1, rotation);
    let observation = QObservation::from_points(cloud, proprio(), VoxelBounds::scene(&PANDA), 0.01);
    Scene { observation, goal: NextBestPose { pose, gripper: Gripper::Close } }
}

/// Points about 8 mm apart on the top of a box and on its sides that face the camera, which looks along -x.
fn surface(cloud: &mut Vec<(Vec3, [u8; 3])>, world_from_box: Pose3, half: Vec3, rgb: [u8; 3], rng: &mut Rng) {
    let faces = [
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::Y, Vec3::Z),
        (Vec3::Y, Vec3::X, Vec3::Z),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
    ];
    for (normal, u, v) in faces {
        if (world_from_box.rotation * normal).dot(Vec3::new(0.9, 0.0, 0.42)) <= 0.05 {
            continue;
        }
        let n_points = (4.0 * half.dot(u) * half.dot(v) / (0.008 * 0.008)) as usize;
        for _ in 0..n_points {
            let mut along = |axis: Vec3| axis * half.dot(axis) * rng.random_range(-1.0..1.0);
            let point = normal * half.dot(normal.abs()) + along(u) + along(v);
            cloud.push((world_from_box * point + noise(rng), rgb));
        }
    }
}

/// Points on the top of an upright cylinder and on the half of its side that faces the camera.
fn disc(cloud: &mut Vec<(Vec3, [u8; 3])>, base: Vec3, radius: f32, height: f32, rgb: [u8; 3], rng: &mut Rng) {
    for _ in 0..(PI * radius * radius / (0.008 * 0.008)) as usize {
        let (r, angle) = (radius * rng.random::<f32>().sqrt(), rng.random_range(-PI..PI));
        cloud.push((base + Vec3::new(r * angle.cos(), r * angle.sin(), height) + noise(rng), rgb));
    }
    for _ in 0..(PI * radius * height / (0.008 * 0.008)) as usize {
        let angle = rng.random_range(-PI / 2.0..PI / 2.0);
        let point = Vec3::new(radius * angle.cos(), radius * angle.sin(), height * rng.random::<f32>());
        cloud.push((base + point + noise(rng), rgb));
    }
}

/// Up to 2 mm along each axis.
fn noise(rng: &mut Rng) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| rng.random_range(-0.002..0.002)))
}

fn proprio() -> Proprio {
    Proprio {
        joints: PANDA.start,
        gripper_width: 0.08,
        gripper_open: 1.0,
        finger_positions: [0.04; 2],
        grip: PANDA.grip(&PANDA.start),
        time: 1.0,
    }
}
