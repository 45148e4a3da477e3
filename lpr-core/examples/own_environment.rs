//! A world of your own that an agent learns in: the grip has to go over a hurdle that no camera
//! sees.
//!
//! ```text
//! cargo run -p lpr-core --example own_environment
//! ```
#![expect(clippy::print_stdout, reason = "an example shows what it found")]

use core::f32::consts::PI;
use lpr_core::agent::{Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::demo::{DemoEpisode, DemoStep};
use lpr_core::env::{Environment, InvalidAction, StepResult};
use lpr_core::evaluate::evaluate;
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::nn::Backend;
use lpr_core::path::{BezierCurve, JointPath};
use lpr_core::perception::{Camera, Observation, Proprio, View};
use lpr_core::q_attention::NextBestPose;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{Gripper, PANDA, Robot};
use lpr_core::train::{Run, Trainer, default_cameras, demonstration_scene};
use rand::RngExt as _;
use std::sync::Arc;

/// Least height of the grip's way above the straight line, metres.
const HURDLE: f32 = 0.04;

/// Environment steps of the training: seconds. Ten seeds learned 0.98 of the scenes or more in
/// these, 0.92 or more in half of them.
const N_STEPS: usize = 1200;

/// One way over the hurdle to a place that differs from scene to scene.
struct Hurdle {
    goal: Vec3,
}

impl Environment for Hurdle {
    fn robot(&self) -> &Arc<Robot> {
        &PANDA
    }

    fn reset(&mut self, seed: u64) -> lpr_core::Result<()> {
        let rng = &mut stream(seed, Stream::Placement, 0);
        self.goal = Vec3::new(rng.random_range(0.4..0.55), rng.random_range(-0.3..-0.15), 0.25);
        Ok(())
    }

    fn observe(&mut self) -> lpr_core::Result<Observation> {
        let view = View::empty(
            Camera::looking("above", Vec3::new(0.5, 0.0, 1.0), -Vec3::Z, 1.0).with_size(8, 8),
        );
        let (joints, grip) = (PANDA.start, PANDA.grip(&PANDA.start));
        let proprio = Proprio {
            joints,
            gripper_width: 0.0,
            gripper_open: 0.0,
            finger_positions: [0.0; 2],
            grip,
            time: 1.0,
        };
        Ok(Observation { views: vec![view], proprio })
    }

    fn step(&mut self, path: &JointPath, _: Gripper) -> lpr_core::Result<StepResult> {
        let positions: Vec<_> =
            path.configs().iter().map(|config| PANDA.grip(config).translation).collect();
        let (start, way) = (positions[0], self.goal - positions[0]);
        let above =
            |at: &Vec3| (*at - start - way * ((*at - start).dot(way) / way.length_squared())).z;
        let is_over = positions.iter().map(above).fold(0.0, f32::max) > HURDLE;
        let invalid = (!is_over).then_some(InvalidAction::Force { link: "hand", newtons: 100.0 });
        Ok(StepResult {
            reward: f32::from(u8::from(is_over)),
            terminated: true,
            truncated: false,
            invalid,
        })
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        Some(NextBestPose {
            pose: Pose3::from_parts(self.goal, Quat::from_rotation_x(PI)),
            gripper: Gripper::Close,
        })
    }
}

/// A curve that bows upwards; none where the arm cannot follow it.
fn demonstration(seed: u64) -> Option<DemoEpisode> {
    let mut world = Hurdle { goal: Vec3::ZERO };
    world.reset(seed).ok()?;
    let (observation, goal) = (world.observe().ok()?, world.demonstrated_goal()?);
    let start = PANDA.grip(&PANDA.start);
    let middle = 0.5 * (start.translation + goal.pose.translation) + 3.0 * HURDLE * Vec3::Z;
    let path = BezierCurve::new(&start, middle, &goal.pose).to_joints(&PANDA, &PANDA.start).ok()?;
    Some(DemoEpisode { start: 0, steps: vec![DemoStep { observation, goal, path }] })
}

/// The preset `fast` with smaller networks and fewer candidates.
fn config() -> lpr_core::Result<Config> {
    let mut config = Config::preset("fast")?;
    (config.candidates.path_len, config.candidates.planner_paths, config.candidates.bezier_paths) =
        (8, 4, 16);
    config.candidates.bezier.sigma = 0.12;
    (config.ranker.config_widths, config.ranker.head_widths, config.policy.widths) =
        (vec![32, 64], vec![64], vec![32, 64]);
    (
        config.training.path_batch,
        config.training.path_updates_per_step,
        config.training.demonstration_updates,
    ) = (32, 2, 20);
    Ok(config)
}

/// Learns, and says in how many of 60 new scenes the agent gets over the hurdle: a share before and
/// one after.
pub fn learn() -> lpr_core::Result<[f64; 2]> {
    let (method, poses, backend) = (Method::Lpr, PoseSource::Oracle, Backend::Flex);
    let run = Run {
        task: "hurdle".to_owned(),
        method,
        poses,
        backend,
        seed: 0,
        cameras: default_cameras(),
    };
    let mut trainer = Trainer::new(config()?, run, Hurdle { goal: Vec3::ZERO })?;
    for demo in (0..20).filter_map(|demo| demonstration(demonstration_scene(0, demo))).take(3) {
        trainer.add_demonstration(&demo)?;
    }
    let success = |trainer: &Trainer<Hurdle>| -> lpr_core::Result<f64> {
        Ok(evaluate(trainer.agent(), &mut Hurdle { goal: Vec3::ZERO }, 1000..1060, |_| ())?
            .success_rate())
    };
    let before = success(&trainer)?;
    while trainer.demonstration_updates_left() > 0 {
        trainer.update()?;
    }
    for _ in 0..N_STEPS {
        trainer.step()?;
    }
    Ok([before, success(&trainer)?])
}

fn main() -> lpr_core::Result<()> {
    let [before, after] = learn()?;
    println!("of 60 scenes: {before:.2} before, {after:.2} after {N_STEPS} steps");
    assert!(after >= 0.95, "the ranker knows which paths go over the hurdle");
    Ok(())
}
