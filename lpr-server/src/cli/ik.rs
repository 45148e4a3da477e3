//! `lpr ik`: inverse kinematics of the flange, of a described arm of its tip.

use super::arm::{Arm, ArmArguments, Needs};
use super::failure::Result;
use crate::formats::{self, PoseQuery};
use core::fmt;
use lpr_core::glamx::Pose3;
use lpr_core::rng::{self, Stream};
use lpr_core::robot::JointConfig;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Solutions are distinct when a joint differs by more, radians modulo 2π.
const MIN_DISTANCE: f32 = 0.1;

const POSES_HELP: &str = r#"Poses: {"poses": [{"position": [x, y, z], "rotation_xyzw": [x, y, z, w], "seed_config": [q1, …] (optional)}, …]}"#;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    arm: ArmArguments,
    #[arg(long, value_name = "FILE", help = POSES_HELP)]
    poses: PathBuf,
    /// Distinct solutions wanted of each pose; a single one is the nearest to its seed
    /// configuration, else to the robot's start
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    solutions: u16,
    /// Seed of the search for several solutions
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    results: Vec<PoseResult>,
}

#[derive(Debug, Serialize)]
struct PoseResult {
    solutions: Vec<Vec<f32>>,
    /// Time of the search, microseconds.
    micros: f64,
    /// Reason why there are fewer solutions than wanted.
    reason: Option<&'static str>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let arm = arguments.arm.load(Needs::Kinematics)?;
    let queries = formats::read_poses(&arguments.poses)?;
    let solve = |(idx, query): (usize, &PoseQuery)| {
        let near = match &query.seed_config {
            Some(seed) => {
                arm.config(seed, &arguments.poses, &format!("poses[{idx}].seed_config"))?
            }
            None => arm.start,
        };
        let start = Instant::now();
        let solutions =
            solutions(arguments, &arm, &Pose3::from(query.world_from_flange), &near, idx as u64);
        let micros = start.elapsed().as_secs_f64() * 1e6;
        let reason = match solutions.len() {
            0 => Some("unreachable"),
            n if n < arguments.solutions.into() => Some("too_few_distinct"),
            _ => None,
        };
        Ok(PoseResult {
            solutions: solutions.iter().map(|config| arm.joints(config)).collect(),
            micros,
            reason,
        })
    };
    Ok(Report { results: queries.iter().enumerate().map(solve).collect::<Result<_>>()? })
}

fn solutions(
    arguments: &Arguments,
    arm: &Arm,
    world_from_tip: &Pose3,
    near: &JointConfig,
    query_idx: u64,
) -> Vec<JointConfig> {
    let n = arguments.solutions.into();
    let rng = &mut rng::stream(arguments.seed, Stream::Ik, query_idx);
    match &arm.closed_form {
        Some(robot) if n == 1 => robot.ik_nearest(world_from_tip, near).into_iter().collect(),
        Some(robot) => robot.ik_distinct(world_from_tip, n, MIN_DISTANCE, near, rng),
        None => arm.robot.ik(world_from_tip, near, n, MIN_DISTANCE, rng),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:>4} {:>9} {:>8}  first solution, rad", "pose", "solutions", "µs")?;
        for (idx, PoseResult { solutions, micros, reason }) in self.results.iter().enumerate() {
            write!(f, "{idx:>4} {:>9} {micros:>8.0} ", solutions.len())?;
            match (solutions.first(), reason) {
                (Some(config), _) => config.iter().try_for_each(|q| write!(f, " {q:.4}"))?,
                (None, reason) => write!(f, " {}", reason.unwrap_or_default())?,
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
