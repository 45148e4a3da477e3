//! `lpr ik`: inverse kinematics of the flange.

use super::{Result, RobotArgument};
use crate::formats::{self, PoseQuery};
use core::fmt;
use lpr_core::glamx::Pose3;
use lpr_core::rng::{self, Stream};
use lpr_core::robot::{JointConfig, Robot};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Solutions are distinct when a joint differs by more, radians modulo 2π.
const MIN_DISTANCE: f32 = 0.1;

const POSES_HELP: &str =
    r#"Poses: {"poses": [{"position": [x, y, z], "rotation_xyzw": [x, y, z, w], "seed_config": [q1, …, q7] (optional)}, …]}"#;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    robot: RobotArgument,
    #[arg(long, value_name = "FILE", help = POSES_HELP)]
    poses: PathBuf,
    /// Distinct solutions wanted of each pose; a single one is the nearest to its seed configuration, else to the robot's start
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
    solutions: Vec<JointConfig>,
    /// Time of the search, microseconds.
    micros: f64,
    /// Why there are fewer solutions than wanted.
    reason: Option<&'static str>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let queries = formats::read_poses(&arguments.poses)?;
    let solve = |(idx, query): (usize, &PoseQuery)| {
        let start = Instant::now();
        let solutions = solutions(arguments, query, idx as u64);
        let micros = start.elapsed().as_secs_f64() * 1e6;
        let reason = match solutions.len() {
            0 => Some("unreachable"),
            n if n < arguments.solutions.into() => Some("too_few_distinct"),
            _ => None,
        };
        PoseResult { solutions, micros, reason }
    };
    Ok(Report { results: queries.iter().enumerate().map(solve).collect() })
}

fn solutions(arguments: &Arguments, query: &PoseQuery, query_idx: u64) -> Vec<JointConfig> {
    let robot: &Robot = arguments.robot.robot;
    let near = query.seed_config.unwrap_or(robot.start);
    let world_from_grip = Pose3::from(query.world_from_flange * robot.flange_from_grip);
    if arguments.solutions == 1 {
        return robot.ik_nearest(&world_from_grip, &near).into_iter().collect();
    }
    let mut rng = rng::stream(arguments.seed, Stream::Ik, query_idx);
    robot.ik_distinct(&world_from_grip, arguments.solutions.into(), MIN_DISTANCE, &near, &mut rng)
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
