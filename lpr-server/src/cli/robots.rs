//! `lpr robots`: the built-in robots.

use core::fmt;
use lpr_core::robot::ROBOTS;
use serde::Serialize;

/// The built-in robots, the default first.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    robots: Vec<RobotRow>,
}

#[derive(Debug, Serialize)]
struct RobotRow {
    name: String,
    dof: usize,
    /// Lower and upper limit of each joint from the base, radians.
    limits: Vec<[f32; 2]>,
}

pub(super) fn run() -> Report {
    let row = |robot: &lpr_core::robot::Robot| RobotRow {
        name: robot.name.clone(),
        dof: robot.dof(),
        limits: robot.joints.iter().map(|joint| [joint.lower, joint.upper]).collect(),
    };
    Report { robots: ROBOTS.iter().map(|robot| row(robot)).collect() }
}

impl fmt::Display for Report {
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
