//! `lpr robots`: the built-in robots, and what a description of another says.

mod describe;
mod portrait;
mod semantics;

use super::arm::{FileArguments, Needs};
use super::failure::Result;
use core::fmt;
use lpr_core::robot::ROBOTS;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Tell what a URDF file says, and what is wrong with it
    #[arg(long, value_name = "FILE.urdf")]
    describe: Option<PathBuf>,
    /// Write which links may touch, also those that always do, as SRDF
    #[arg(long, value_name = "FILE.srdf", requires = "describe")]
    write_srdf: Option<PathBuf>,
    /// Draw the arm with its spheres
    #[arg(long, value_name = "FILE.png", requires = "describe", value_parser = portrait::parse_png)]
    draw: Option<PathBuf>,
    #[command(flatten)]
    file: FileArguments,
}

#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Report {
    BuiltIn(BuiltIn),
    Described(Box<describe::Description>),
}

/// The built-in robots, the default first.
#[derive(Debug, Serialize)]
pub(super) struct BuiltIn {
    robots: Vec<RobotRow>,
}

#[derive(Debug, Serialize)]
struct RobotRow {
    name: String,
    dof: usize,
    /// Lower and upper limit of each joint from the base, radians.
    limits: Vec<[f32; 2]>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let Some(path) = &arguments.describe else { return Ok(Report::BuiltIn(built_in())) };
    let arm = arguments.file.read(path, Needs::Collisions)?;
    if let Some(out) = &arguments.write_srdf {
        semantics::write(out, &arm)?;
    }
    if let Some(out) = &arguments.draw {
        portrait::draw(out, &arm.described.robot)?;
    }
    Ok(Report::Described(Box::new(describe::describe(&arm)?)))
}

fn built_in() -> BuiltIn {
    let row = |robot: &lpr_core::robot::Robot| RobotRow {
        name: robot.name.clone(),
        dof: robot.dof(),
        limits: robot.joints.iter().map(|joint| [joint.lower, joint.upper]).collect(),
    };
    BuiltIn { robots: ROBOTS.iter().map(|robot| row(robot)).collect() }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn(robots) => robots.fmt(f),
            Self::Described(description) => description.fmt(f),
        }
    }
}

impl fmt::Display for BuiltIn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<8}{:>7}  limits of the joints from the base, rad", "robot", "joints")?;
        for RobotRow { name, dof, limits } in &self.robots {
            write!(f, "{name:<8}{dof:>7} ")?;
            limits.iter().try_for_each(|[lower, upper]| write!(f, " {lower:.2}..{upper:.2}"))?;
            writeln!(f)?;
        }
        Ok(())
    }
}
