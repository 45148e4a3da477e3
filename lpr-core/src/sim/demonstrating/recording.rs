//! From a scripted demonstration to what an agent learns from: frames, keyframes, observations and
//! paths.

use super::{Demonstration, demonstrate};
use crate::demo::{DemoEpisode, DemoFrame, DemoSettings, DemoStep, augment_demo};
use crate::env::{EPISODE_LENGTH, Environment as _};
use crate::path::JointPath;
use crate::perception::Proprio;
use crate::q_attention::NextBestPose;
use crate::rng::{Stream, stream};
use crate::robot::{DOF, Gripper, JointConfig};
use crate::sim::environment::SimEnvironment;

/// The frames of a demonstration, one each control step.
#[must_use]
pub fn demo_frames(env: &SimEnvironment, demo: &Demonstration) -> Vec<DemoFrame> {
    let robot = env.robot();
    let control_dt = env.world().params().control_dt;
    let frame = |idx: usize| {
        let world = &demo.frames[idx];
        let before = demo.frames[idx.saturating_sub(1)].config();
        let joints = *world.config();
        let width = world.gripper_width();
        DemoFrame {
            joints,
            joint_velocities: core::array::from_fn::<f32, DOF, _>(|j| {
                (joints[j] - before[j]) / control_dt
            }),
            gripper_open: Proprio::openness(width, env.world().gripper_spec().max_width) > 0.5,
            gripper_width: width,
            grip: robot.grip(&joints),
        }
    };
    (0..demo.frames.len()).map(frame).collect()
}

/// Every chain of keyframes that demo augmentation makes of a demonstration recorded in `env`.
#[must_use]
pub fn demo_episodes(
    env: &SimEnvironment,
    demo: &Demonstration,
    settings: &DemoSettings,
) -> Vec<DemoEpisode> {
    let frames = demo_frames(env, demo);
    let mut episodes: Vec<DemoEpisode> = Vec::new();
    for transition in augment_demo(&frames, settings) {
        let mut seen = env.at(
            demo.frames[transition.observation].clone(),
            transition.step.min(EPISODE_LENGTH - 1),
        );
        let configs: Vec<_> = frames[transition.observation..=transition.keyframe]
            .iter()
            .map(|frame| frame.joints)
            .collect();
        let Ok(path) = JointPath::new(configs) else { continue };
        let keyframe = &frames[transition.keyframe];
        let gripper = if keyframe.gripper_open { Gripper::Open } else { Gripper::Close };
        let goal = NextBestPose { pose: keyframe.grip, gripper };
        let step = DemoStep { observation: seen.observe(), goal, path };
        match episodes.last_mut() {
            Some(episode) if transition.step > 0 => episode.steps.push(step),
            _ => episodes.push(DemoEpisode { start: transition.observation, steps: vec![step] }),
        }
    }
    episodes
}

/// The arm in one frame of a demonstration that is to be followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowedFrame {
    /// Configuration of the arm.
    pub joints: JointConfig,
    /// Distance between the pads, metres.
    pub gripper_width: f32,
}

/// Does what a demonstration did, in `env`, which has just been reset to its scene: the arm goes
/// from frame to frame, and where the pads move while it stands still, the gripper gets that
/// command. It may end otherwise than the demonstration did.
#[must_use]
pub fn follow(env: &mut SimEnvironment, frames: &[FollowedFrame]) -> Demonstration {
    /// Pads that move less than this were not commanded, metres: what they hold gives way by less.
    const COMMANDED: f32 = 0.001;
    /// An arm that moves less than this stands still, radians in every joint.
    const STILL: f32 = 1e-6;
    let mut demo = Demonstration {
        frames: vec![env.world().clone()],
        waypoint_frames: Vec::new(),
        success: false,
        invalid: None,
    };
    for pair in frames.windows(2) {
        let opened_by = pair[1].gripper_width - pair[0].gripper_width;
        let stands = pair[1].joints.max_joint_distance(&pair[0].joints) < STILL;
        let command = if opened_by > 0.0 { Gripper::Open } else { Gripper::Close };
        let moved = match (stands, opened_by.abs() > COMMANDED) {
            (true, true) => env.move_gripper(command),
            _ => env.move_straight(&pair[1].joints),
        };
        demo.frames.push(env.world().clone());
        if let Err(invalid) = moved {
            demo.invalid = Some(invalid);
            return demo;
        }
    }
    demo.success = env.world().success();
    demo
}

/// Records a successful demonstration in scene `seed` and augments it; `None` when the demonstrator
/// fails there.
///
/// # Errors
///
/// When the scene cannot be placed.
pub fn record_demo(
    env: &SimEnvironment,
    seed: u64,
    settings: &DemoSettings,
) -> crate::Result<Option<Vec<DemoEpisode>>> {
    let mut env = env.clone();
    env.reset(seed)?;
    let start = env.clone();
    let demo = demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0));
    Ok(demo.success.then(|| demo_episodes(&start, &demo, settings)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::robot::{PANDA, Robot, XARM7};
    use crate::sim::tasks::{TASKS, Task};
    use crate::sim::world::{SimParams, World};
    use std::sync::Arc;

    #[test]
    fn demonstrations_have_the_keyframes_of_their_task_and_braking_is_none() {
        let config = Config::preset("fast").expect("a preset");
        for task in TASKS.iter() {
            let env = SimEnvironment::new(task, &XARM7, 0, &["front"], &config.simulator)
                .expect("a scene");
            for seed in 0..8 {
                let Some(chains) = record_demo(&env, seed, &config.demos).expect("a scene") else {
                    continue;
                };
                let whole = chains.first().expect("a chain from the first frame");
                assert_eq!(whole.steps.len(), task.keyframes, "{} {seed}", task.name);
            }
        }
    }

    fn followed(task: &Arc<Task>, robot: &Arc<Robot>, seed: u64) -> (Demonstration, Demonstration) {
        let mut env = SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD)
            .expect("a scene");
        let mut again = env.clone();
        let demo = demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0));
        let frame = |world: &World| FollowedFrame {
            joints: *world.config(),
            gripper_width: world.gripper_width(),
        };
        let frames: Vec<_> = demo.frames.iter().map(frame).collect();
        (follow(&mut again, &frames), demo)
    }

    #[test]
    fn demonstrations_that_are_followed_do_the_task_again() {
        for task in TASKS.iter() {
            for (robot, seed) in [(&XARM7, 1), (&PANDA, 2)] {
                let (again, demo) = followed(task, robot, seed);
                assert!(again.success, "{} with {}: {:?}", task.name, robot.name, again.invalid);
                assert_eq!(again.frames.len(), demo.frames.len());
                for (again, demo) in again.frames.iter().zip(&demo.frames) {
                    assert!(again.config().max_joint_distance(demo.config()) < 1e-5);
                }
            }
        }
    }
}
