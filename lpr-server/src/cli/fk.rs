//! `lpr fk`: forward kinematics of the flange, of a described arm of its tip.

use super::arm::{ArmArguments, Needs};
use super::failure::Result;
use crate::formats::{self, PoseJson};
use core::fmt;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    arm: ArmArguments,
    /// Configurations: {"configs": [[q1, …], …]} in radians, one number for each joint
    #[arg(long, value_name = "FILE")]
    configs: PathBuf,
}

/// `world_from_flange` of every configuration.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    poses: Vec<PoseJson>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let arm = arguments.arm.load(Needs::Kinematics)?;
    let configs = formats::read_configs(&arguments.configs)?;
    let pose = |(idx, config): (usize, &Vec<f64>)| {
        let config = arm.config(config, &arguments.configs, &format!("configs[{idx}]"))?;
        Ok(arm.robot.flange(&config).into())
    };
    Ok(Report { poses: configs.iter().enumerate().map(pose).collect::<Result<_>>()? })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:>4}  {:>26}  rotation x y z w", "", "position x y z, m")?;
        for (idx, PoseJson { position: [x, y, z], rotation_xyzw: [qx, qy, qz, qw] }) in
            self.poses.iter().enumerate()
        {
            writeln!(f, "{idx:>4}  {x:>8.4} {y:>8.4} {z:>8.4}  {qx:.4} {qy:.4} {qz:.4} {qw:.4}")?;
        }
        Ok(())
    }
}
