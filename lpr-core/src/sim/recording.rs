//! From a scripted demonstration to what an agent learns from: frames, keyframes, observations and paths.

use super::demonstrator::{Demonstration, demonstrate};
use super::env::SimEnvironment;
use crate::demo::{DemoFrame, DemoSettings, augment_demo};
use crate::env::{EPISODE_LENGTH, Environment as _};
use crate::path::JointPath;
use crate::perception::Proprio;
use crate::q_attention::NextBestPose;
use crate::rng::{Stream, stream};
use crate::robot::{DOF, Gripper};
use crate::train::{DemoEpisode, DemoStep};

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
            joint_velocities: core::array::from_fn::<f32, DOF, _>(|j| (joints[j] - before[j]) / control_dt),
            gripper_open: Proprio::openness(width, robot.gripper.max_width) > 0.5,
            gripper_width: width,
            grip: robot.grip(&joints),
        }
    };
    (0..demo.frames.len()).map(frame).collect()
}

/// Every chain of keyframes that demo augmentation makes of a demonstration recorded in `env`.
#[must_use]
pub fn demo_episodes(env: &SimEnvironment, demo: &Demonstration, settings: &DemoSettings) -> Vec<DemoEpisode> {
    let frames = demo_frames(env, demo);
    let mut episodes: Vec<DemoEpisode> = Vec::new();
    for transition in augment_demo(&frames, settings) {
        let mut seen = env.at(demo.frames[transition.observation].clone(), transition.step.min(EPISODE_LENGTH - 1));
        let configs: Vec<_> = frames[transition.observation..=transition.keyframe].iter().map(|frame| frame.joints).collect();
        let Ok(path) = JointPath::new(configs) else { continue };
        let keyframe = &frames[transition.keyframe];
        let gripper = if keyframe.gripper_open { Gripper::Open } else { Gripper::Close };
        let goal = NextBestPose { pose: keyframe.grip, gripper };
        let step = DemoStep { observation: seen.observe(), goal, path };
        match episodes.last_mut() {
            Some(episode) if transition.step > 0 => episode.steps.push(step),
            _ => episodes.push(DemoEpisode { steps: vec![step] }),
        }
    }
    episodes
}

/// Records a successful demonstration in scene `seed` and augments it; `None` when the demonstrator fails there.
///
/// # Errors
///
/// When the scene cannot be placed.
pub fn record_demo(env: &SimEnvironment, seed: u64, settings: &DemoSettings) -> crate::Result<Option<Vec<DemoEpisode>>> {
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
    use crate::robot::XARM7;
    use crate::sim::tasks::TASKS;

    #[test]
    fn demonstrations_have_the_keyframes_of_their_task_and_braking_is_none() {
        let config = Config::preset("fast").expect("a preset");
        for task in TASKS {
            let env = SimEnvironment::new(task, &XARM7, 0, &["front"], &config.simulator).expect("a scene");
            for seed in 0..8 {
                let Some(chains) = record_demo(&env, seed, &config.demos).expect("a scene") else { continue };
                let whole = chains.first().expect("a chain from the first frame");
                assert_eq!(whole.steps.len(), task.keyframes, "{} {seed}", task.name);
            }
        }
    }
}
