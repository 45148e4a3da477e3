//! Demonstrations of a run: scripted ones in scenes of their own, or those of files.

use crate::cli::failure::Result;
use crate::files::{self, FileError};
use crate::formats::{DEMO_VERSION, DemoFile, DemoSource};
use lpr_core::demo::DemoEpisode;
use lpr_core::demo::DemoSettings;
use lpr_core::env::Environment as _;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::{FollowedFrame, demo_episodes, follow, record_demo};
use lpr_core::train::{Trainer, demonstration_scene};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// End of the name of a demonstration.
const EXTENSION: &str = ".demo.json.gz";
/// Scenes that no run may learn from: those of validations and of the final evaluation.
const HELD_OUT: [Range<u64>; 2] = [1000..2000, 5000..5100];

/// A demonstration as the trainer takes it.
pub(super) struct Demonstrated {
    pub(super) scene_seed: u64,
    /// Its chains of keyframes, as demo augmentation makes them.
    chains: Vec<DemoEpisode>,
}

/// Adds demonstrations to the trainer's buffers.
pub(super) fn add(trainer: &mut Trainer<SimEnvironment>, demos: &[Demonstrated]) -> Result<()> {
    let mut chains = demos.iter().flat_map(|demo| &demo.chains);
    Ok(chains.try_for_each(|chain| trainer.add_demonstration(chain))?)
}

/// Hears how many demonstrations there are so far, and may refuse to go on.
pub(super) type OnDemo<'a> = &'a mut dyn FnMut(usize) -> Result<()>;

/// Scripted demonstrations until `wanted` have succeeded.
pub(super) fn scripted(
    environment: &SimEnvironment,
    settings: &DemoSettings,
    seed: u64,
    wanted: usize,
    on_demo: OnDemo<'_>,
) -> Result<Vec<Demonstrated>> {
    /// Demonstrations that may fail for each that is asked for.
    const TRIES: u64 = 4;
    let mut demos = Vec::new();
    for demo in 0..wanted as u64 * TRIES {
        if demos.len() == wanted {
            break;
        }
        let scene_seed = demonstration_scene(seed, demo);
        if let Some(chains) = record_demo(environment, scene_seed, settings)? {
            demos.push(Demonstrated { scene_seed, chains });
        }
        on_demo(demos.len())?;
    }
    if demos.len() < wanted {
        let reason = format!("only {} of {wanted} demonstrations succeeded", demos.len());
        return Err(lpr_core::Error::Environment(reason).into());
    }
    Ok(demos)
}

/// The demonstrations of a directory, in the order of their names.
pub(super) fn of_directory(
    environment: &SimEnvironment,
    settings: &DemoSettings,
    path: &Path,
    on_demo: OnDemo<'_>,
) -> Result<Vec<Demonstrated>> {
    let names = demo_files(path)?;
    if names.is_empty() {
        return Err(FileError::content(
            path,
            format!("holds no demonstration: expected files *{EXTENSION}"),
        )
        .into());
    }
    let mut demos = Vec::new();
    for name in &names {
        demos.push(of_file(environment, settings, name)?);
        on_demo(demos.len())?;
    }
    Ok(demos)
}

/// The demonstrations of the scripted demonstrator in `scenes`, each from its first frame on.
pub(in crate::cli) fn again(
    environment: &SimEnvironment,
    scenes: &[u64],
    settings: &DemoSettings,
) -> Result<Vec<DemoEpisode>> {
    let mut demos = Vec::new();
    for &scene in scenes {
        demos.extend(record_demo(environment, scene, settings)?.into_iter().flatten().next());
    }
    Ok(demos)
}

/// Demonstrations in a directory.
pub(super) fn n_files(directory: &Path) -> Result<usize> {
    Ok(demo_files(directory)?.len())
}

fn demo_files(directory: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(directory).map_err(FileError::io("read", directory))?;
    let mut paths = entries
        .map(|entry| Ok(entry.map_err(FileError::io("read", directory))?.path()))
        .collect::<Result<Vec<_>, FileError>>()?;
    paths.retain(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(EXTENSION))
    });
    paths.sort();
    Ok(paths)
}

/// A demonstration is followed again in its scene, where the cameras see what the file leaves out.
fn of_file(
    environment: &SimEnvironment,
    settings: &DemoSettings,
    path: &Path,
) -> Result<Demonstrated> {
    let file: DemoFile = files::read_versioned_json(path, DEMO_VERSION)?;
    let scene_seed =
        scene_of(&file, environment).map_err(|reason| FileError::content(path, reason))?;
    let mut followed = environment.clone();
    followed.reset(scene_seed)?;
    let start = followed.clone();
    let frame = |frame: &crate::formats::DemoFrameJson| FollowedFrame {
        joints: frame.q,
        gripper_width: frame.gripper_width,
    };
    let frames: Vec<_> = file.frames.iter().map(frame).collect();
    let demo = follow(&mut followed, &frames);
    if !demo.success {
        let reason =
            demo.invalid.map_or("the task is not done".to_owned(), |invalid| invalid.to_string());
        return Err(FileError::content(
            path,
            format!("does not do the task when it is followed again: {reason}"),
        )
        .into());
    }
    Ok(Demonstrated { scene_seed, chains: demo_episodes(&start, &demo, settings) })
}

/// Scene seed of a demonstration that `environment` can follow.
fn scene_of(file: &DemoFile, environment: &SimEnvironment) -> Result<u64, String> {
    let (task, robot) = (&environment.task().name, &environment.robot().name);
    let control_dt = environment.world().params().control_dt;
    let found_task = file.task.as_deref().unwrap_or("none");
    if found_task != task {
        return Err(format!("task: expected {task}, found {found_task}"));
    }
    if file.robot != *robot {
        return Err(format!("robot: expected {robot}, found {}", file.robot));
    }
    if file.source == DemoSource::Arm {
        return Err("source: a demonstration at the arm has no scene to be followed in".to_owned());
    }
    if (file.control_dt - control_dt).abs() > 1e-6 {
        return Err(format!("control_dt: expected {control_dt} s, found {}", file.control_dt));
    }
    if !file.success {
        return Err("success: a demonstration that failed teaches nothing".to_owned());
    }
    let scene_seed =
        file.scene_seed.ok_or("scene_seed: is missing, and without a scene nothing is seen")?;
    if HELD_OUT.iter().any(|seeds| seeds.contains(&scene_seed)) {
        return Err(format!("scene_seed: {scene_seed} is held out for validation or evaluation"));
    }
    Ok(scene_seed)
}
