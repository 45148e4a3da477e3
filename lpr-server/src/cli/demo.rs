//! `lpr demo`: scripted demonstrations of a task.

use super::arguments::{RobotArgument, TaskArgument, scene_seeds};
use super::failure::{Failure, Result};
use super::settings::default_preset;
use crate::files;
use crate::formats::DemoFile;
use core::fmt;
use lpr_core::perception::VoxelBounds;
use lpr_core::q_attention::{ActionCodec, NextBestPose};
use lpr_core::rng::{Stream, stream};
use lpr_core::sim::{Demonstration, SimEnvironment, SimParams, demonstrate};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    task: TaskArgument,
    #[command(flatten)]
    robot: RobotArgument,
    /// Demonstrations; number i is in scene SEED + i
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    episodes: u32,
    /// Seed of the first scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Replace every keyframe by the nearest one that an agent's discrete actions can express
    #[arg(long)]
    quantised: bool,
    /// Hold objects by friction alone instead of attaching them to the hand
    #[arg(long)]
    friction_grasps: bool,
    /// The task's variation, counted from 0
    #[arg(long, value_name = "V", default_value_t = 0)]
    variation: usize,
    /// Write each demonstration to a file in this new directory
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    task: String,
    robot: String,
    variation: usize,
    quantised: bool,
    friction_grasps: bool,
    episodes: u32,
    successes: u32,
    /// Number of failures for each reason.
    failures: BTreeMap<&'static str, u32>,
    failed: Vec<FailedEpisode>,
    /// Wall time.
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct FailedEpisode {
    scene_seed: u64,
    /// On the way to which it failed, counted from 0; none when it could not begin.
    keyframe: Option<usize>,
    reason: &'static str,
    /// Events with their bodies and forces.
    message: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let start = Instant::now();
    arguments.task.task.check_variation(arguments.variation)?;
    let mut report = match &arguments.out {
        None => demonstrate_all(arguments, None)?,
        Some(path) => {
            let mut report = None;
            files::write_directory_atomically::<Failure>(path, |directory| {
                report = Some(demonstrate_all(arguments, Some(directory))?);
                Ok(())
            })?;
            report.expect("a directory that was written has been filled")
        }
    };
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}

/// Demonstrates every episode; the files go to `directory`.
fn demonstrate_all(arguments: &Arguments, directory: Option<&Path>) -> Result<Report> {
    let Arguments {
        task: TaskArgument { task },
        robot: RobotArgument { robot },
        episodes,
        seed,
        quantised,
        ..
    } = arguments;
    let mut report = Report {
        task: task.name.clone(),
        robot: robot.name.clone(),
        variation: arguments.variation,
        quantised: *quantised,
        friction_grasps: arguments.friction_grasps,
        episodes: *episodes,
        successes: 0,
        failures: BTreeMap::new(),
        failed: Vec::new(),
        seconds: 0.0,
    };
    for seed in scene_seeds(*seed, *episodes) {
        let failed = match demonstrate_seed(arguments, seed) {
            Ok(demo) => {
                if let Some(directory) = directory {
                    let name = format!("{}-{}-{seed}.demo.json.gz", task.name, robot.name);
                    files::write_json(&directory.join(name), &DemoFile::scripted(&demo, seed))?;
                }
                FailedEpisode::of(&demo, seed)
            }
            Err(reason) => {
                Some(FailedEpisode { scene_seed: seed, keyframe: None, reason, message: None })
            }
        };
        match failed {
            None => report.successes += 1,
            Some(failed) => {
                *report.failures.entry(failed.reason).or_default() += 1;
                report.failed.push(failed);
            }
        }
    }
    Ok(report)
}

/// The demonstration in scene `seed`, or why there is none.
fn demonstrate_seed(arguments: &Arguments, seed: u64) -> Result<Demonstration, &'static str> {
    let Arguments {
        task: TaskArgument { task },
        robot: RobotArgument { robot },
        quantised,
        variation,
        ..
    } = arguments;
    let mut env = SimEnvironment::of_variation(
        task,
        *variation,
        robot,
        seed,
        &["front"],
        &SimParams::STANDARD,
    )
    .map_err(|_| "unplaceable")?;
    if arguments.friction_grasps {
        env = env.with_friction_grasps().expect("a scene that was built once");
    }
    if *quantised {
        env = quantise(&env, seed)?;
    }
    Ok(demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0)))
}

/// The same scene with a demonstrator that goes where an agent could.
fn quantise(env: &SimEnvironment, seed: u64) -> Result<SimEnvironment, &'static str> {
    let bounds = VoxelBounds::scene(env.world().robot()).expect("a simulated arm has a workspace");
    let codec = ActionCodec::new(&default_preset().q_attention, bounds)
        .expect("the preset's numbers fit together");
    let goals: Option<Vec<NextBestPose>> =
        env.plan().goals.iter().map(|goal| codec.quantise(goal)).collect();
    env.with_goals(&goals.ok_or("outside_voxels")?, &mut stream(seed, Stream::Demo, 1))
        .ok_or("unreachable")
}

impl FailedEpisode {
    /// Failure of a demonstration; none when it did the task.
    fn of(demo: &Demonstration, scene_seed: u64) -> Option<Self> {
        (!demo.success).then(|| Self {
            scene_seed,
            keyframe: demo.waypoint_frames.len().checked_sub(1),
            reason: demo.invalid.map_or("not_done", |invalid| invalid.name()),
            message: demo.invalid.map(|invalid| invalid.to_string()),
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            task,
            variation,
            robot,
            quantised,
            friction_grasps,
            episodes,
            successes,
            failures,
            failed,
            seconds,
        } = self;
        let goals = if *quantised { "quantised" } else { "scripted" };
        let held = if *friction_grasps { ", held by friction" } else { "" };
        writeln!(
            f,
            "{task} (variation {variation}), {robot}, {goals} keyframes{held}: {successes} of {episodes} in {seconds:.1} s"
        )?;
        failures.iter().try_for_each(|(reason, n)| writeln!(f, "  {n} {reason}"))?;
        for FailedEpisode { scene_seed, keyframe, reason, message } in failed {
            let at = keyframe.map_or("before the first keyframe".to_owned(), |keyframe| {
                format!("keyframe {keyframe}")
            });
            writeln!(f, "  scene {scene_seed}, {at}: {}", message.as_deref().unwrap_or(reason))?;
        }
        Ok(())
    }
}
