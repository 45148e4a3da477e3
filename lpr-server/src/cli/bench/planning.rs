//! Kinematics, curves, planner and timing.

use super::{Row, default_preset, environment, measure};
use crate::cli::Result;
use lpr_core::env::Environment as _;
use lpr_core::path::{BezierCurve, CandidateSettings, CandidateStreams, PathQuery, TimedPath, candidates};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{PANDA, Robot, XARM7};

/// Solutions, curves and paths that are asked for.
const PATHS: usize = 20;
/// Configurations of a curve and of a path that is timed.
const CONFIGS: usize = 50;
/// Least difference of two solutions in some joint, radians.
const DISTINCT: f32 = 0.2;

pub(super) fn run() -> Result<Vec<Row>> {
    Ok(vec![ik("ik20_xarm7", &XARM7), ik("ik20_panda", &PANDA), bezier()?, planner()?, timing()?])
}

/// 20 distinct solutions of a pose above the table.
fn ik(name: &'static str, robot: &'static Robot) -> Row {
    let mut pose = robot.grip(&robot.start);
    pose.translation.z -= 0.1;
    let mut rng = stream(0, Stream::Ik, 0);
    measure(name, || robot.ik_distinct(&pose, PATHS, DISTINCT, &robot.start, &mut rng))
}

/// 20 Bézier curves of 50 configurations.
fn bezier() -> Result<Row> {
    let config = default_preset();
    let goal = environment(&config)?.plan().goals[0].pose;
    let start = XARM7.grip(&XARM7.start);
    let mut rng = stream(0, Stream::Bezier, 0);
    Ok(measure("bezier20x50", || {
        let curves = (0..PATHS).map(|_| BezierCurve::sample(&start, &goal, &config.candidates.bezier, &mut rng));
        curves.map(|curve| curve.to_joints(&XARM7, &XARM7.start).map(|path| path.resample(CONFIGS))).collect::<Vec<_>>()
    }))
}

/// 20 planner paths around what a depth image saw, all with collision checking.
fn planner() -> Result<Row> {
    let config = default_preset();
    let mut env = environment(&config)?;
    let goal = env.plan().goals[0].pose;
    let (scene, start) = (env.obstacles(Some(&goal)), *env.world().config());
    let settings =
        CandidateSettings { planner_paths: PATHS, bezier_paths: 0, planner_collision_free_fraction: 1.0, ..config.candidates };
    let query = PathQuery { robot: env.robot(), start, goal, scene: &scene, policy_path: None };
    let mut step = 0;
    Ok(measure("planner20_depth_image", || {
        step += 1;
        candidates(&query, &settings, CandidateStreams { seed: 0, step })
    }))
}

/// Time parameterisation of a path of 50 configurations.
fn timing() -> Result<Row> {
    let config = default_preset();
    let goal = environment(&config)?.plan().goals[0].pose;
    let start = XARM7.grip(&XARM7.start);
    let middle = 0.5 * (start.translation + goal.translation);
    let curve = BezierCurve::new(&start, middle, &goal).to_joints(&XARM7, &XARM7.start);
    let path = curve.map_err(|reason| lpr_core::Error::Environment(format!("timing_50: no curve, {}", reason.name())))?;
    let path = path.resample(CONFIGS);
    Ok(measure("timing_50", || TimedPath::new(path.clone(), &XARM7, &config.timing)))
}
