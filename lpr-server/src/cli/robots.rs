//! `lpr robots`: the built-in robots.

use core::fmt;
use lpr_core::robot::{DOF, ROBOTS};
use serde::Serialize;

/// The built-in robots, the default first.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    robots: Vec<RobotRow>,
}

#[derive(Debug, Serialize)]
struct RobotRow {
    name: &'static str,
    dof: usize,
    /// Lower and upper limit of each joint from the base, radians.
    limits: [[f32; 2]; DOF],
}

pub(super) fn run() -> Report {
    let row = |robot: &lpr_core::robot::Robot| RobotRow {
        name: robot.name,
        dof: DOF,
        limits: robot.joints.map(|joint| [joint.lower, joint.upper]),
    };
    Report { robots: ROBOTS.into_iter().map(row).collect() }
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
