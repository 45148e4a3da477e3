//! `lpr scene`: the scene of a task as a file.

use super::arguments::{RobotArgument, TaskArgument};
use super::failure::Result;
use crate::scene_file::SceneFile;
use core::fmt;
use lpr_core::sim::{SimEnvironment, SimParams};
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    task: TaskArgument,
    #[command(flatten)]
    robot: RobotArgument,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The file to write, for instance NAME.scene.json; `lpr render --scene` draws it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    file: PathBuf,
    task: String,
    robot: String,
    seed: u64,
    bodies: Vec<String>,
    joints: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let Arguments { task: TaskArgument { task }, robot: RobotArgument { robot }, seed, out } =
        arguments;
    let file =
        SceneFile::of(&SimEnvironment::new(task, robot, *seed, &["front"], &SimParams::STANDARD)?);
    file.write(out)?;
    let bodies = file.scene.bodies.into_iter().map(|body| body.name).collect();
    let joints = file.scene.joints.into_iter().map(|joint| joint.name).collect();
    Ok(Report {
        file: out.clone(),
        task: task.name.clone(),
        robot: robot.name.clone(),
        seed: *seed,
        bodies,
        joints,
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, task, robot, seed, bodies, joints } = self;
        writeln!(f, "{}: {task}, scene {seed}, {robot}", file.display())?;
        writeln!(f, "  bodies: {}", bodies.join(", "))?;
        if joints.is_empty() { Ok(()) } else { writeln!(f, "  joints: {}", joints.join(", ")) }
    }
}
