//! Kinematics, curves, planner and timing.

use super::{Row, environment, measure};
use crate::cli::failure::Result;
use crate::cli::settings::default_preset;
use lpr_core::env::Environment as _;
use lpr_core::glamx::{Pose3, Vec3};
use lpr_core::path::{
    BezierCurve, CandidateSettings, CandidateStreams, GripSpeedLimit, MotionLimits, PathQuery,
    SmoothPath, candidates, linear_path, time_optimal,
};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{DOF, JointConfig, PANDA, Robot, XARM7};
use lpr_core::scene::{
    ArmSpheres, Held, MotionChecker, ObstacleQuery, Primitive, Scene, obstacle_scene,
};
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::Task;
use std::hint::black_box;
use std::sync::Arc;

/// Solutions, curves and paths that are asked for.
const PATHS: usize = 20;
/// Configurations of a curve and of a path that is timed.
const CONFIGS: usize = 50;
/// Questions of a run that are too short for the clock.
const MANY: usize = 1000;
/// Least difference of two solutions in some joint, radians.
const DISTINCT: f32 = 0.2;

pub(super) fn run() -> Result<Vec<Row>> {
    let mut rows = vec![ik("ik20_xarm7", &XARM7), ik("ik20_panda", &PANDA)];
    rows.extend([fk("fk_xarm7", &XARM7), fk("fk_panda", &PANDA)]);
    rows.extend([ik_at("ik_at_q7_xarm7", &XARM7), ik_at("ik_at_q7_panda", &PANDA)]);
    rows.extend([checks(), bezier()?]);
    rows.extend(planner()?);
    rows.push(timing()?);
    Ok(rows)
}

/// 20 distinct solutions of a pose above the table.
fn ik(name: &'static str, robot: &Arc<Robot>) -> Row {
    let mut pose = robot.grip(&robot.start);
    pose.translation.z -= 0.1;
    let mut rng = stream(0, Stream::Ik, 0);
    measure(name, || robot.ik_distinct(&pose, PATHS, DISTINCT, &robot.start, &mut rng))
}

/// Configurations on the way from a robot's start to one that differs in every joint.
fn configs(robot: &Robot) -> Vec<JointConfig> {
    let end = JointConfig::from_fn(DOF, |j| robot.start[j] + 0.1 * (j + 1) as f32);
    (0..MANY).map(|i| robot.start.lerp(&end, i as f32 / MANY as f32)).collect()
}

/// Forward kinematics of the flange.
fn fk(name: &'static str, robot: &Arc<Robot>) -> Row {
    let configs = configs(robot);
    measure(name, || configs.iter().map(|config| robot.flange(config).translation.x).sum::<f64>())
        .per(MANY)
}

/// All branches of the closed form at one angle of the last joint.
fn ik_at(name: &'static str, robot: &Arc<Robot>) -> Row {
    let questions: Vec<_> = configs(robot)
        .iter()
        .map(|config| (robot.grip(config), f64::from(config[DOF - 1])))
        .collect();
    let solutions = |(pose, q7): &(Pose3, f64)| robot.ik_all_at(pose, *q7, &robot.start).len();
    measure(name, || questions.iter().map(solutions).sum::<usize>()).per(MANY)
}

/// Eight configurations of the Panda among the boards of a shelf, which the arm does not meet, and
/// itself.
fn checks() -> Row {
    let boards = (0..6_u8).map(|i| Primitive::Cuboid {
        world_from_box: Pose3::from_translation(Vec3::new(0.75, 0.0, 0.25 * f32::from(i))),
        half_extents: Vec3::new(0.15, 0.4, 0.01),
    });
    let (scene, arm) = (Scene::from_primitives(boards.collect()), ArmSpheres::new(&PANDA));
    let checker = MotionChecker::new(&scene, &arm, 8.0);
    let end = JointConfig::from_fn(DOF, |j| PANDA.start[j] + if j == 0 { 0.5 } else { 0.0 });
    assert!(checker.motion_is_free(&PANDA.start, &end), "the arm turns in front of the shelf");
    let n_checks = checker.n_checks();
    assert_eq!(n_checks, 8, "one block");
    measure("checks_8_panda", || {
        (0..MANY).filter(|_| checker.motion_is_free(&PANDA.start, black_box(&end))).count()
    })
    .per(MANY)
}

/// 20 Bézier curves of 50 configurations.
fn bezier() -> Result<Row> {
    let config = default_preset();
    let goal = environment(&config)?.plan().goals[0].pose;
    let start = XARM7.grip(&XARM7.start);
    let mut rng = stream(0, Stream::Bezier, 0);
    Ok(measure("bezier20x50", || {
        let curves = (0..PATHS)
            .map(|_| BezierCurve::sample(&start, &goal, &config.candidates.bezier, &mut rng));
        curves
            .map(|curve| curve.to_joints(&XARM7, &XARM7.start).map(|path| path.resample(CONFIGS)))
            .collect::<Vec<_>>()
    }))
}

/// A depth image made into obstacles, and 20 planner paths around them, all with collision
/// checking. Half of the straight motions to the 20 goals hit something.
fn planner() -> Result<[Row; 2]> {
    const SCENE: u64 = 1001;
    let config = default_preset();
    let mut env = SimEnvironment::new(
        &Task::by_name("open_box")?,
        &XARM7,
        SCENE,
        &["front"],
        &config.simulator,
    )?;
    let goal = env.plan().goals[0].pose;
    let (observation, start) = (env.observe(), *env.world().config());
    let points: Vec<Vec3> = observation.colored_points().map(|(point, _)| point).collect();
    let holding = Held::Nothing;
    let look = ObstacleQuery { robot: env.robot(), measured: &start, goal: Some(&goal), holding };
    let scene = obstacle_scene(&look, &points);
    let settings = CandidateSettings {
        planner_paths: PATHS,
        bezier_paths: 0,
        planner_collision_free_fraction: 1.0,
        ..config.candidates
    };
    let query = PathQuery { robot: env.robot(), start, goal, scene: &scene };
    let mut step = 0;
    let build = measure("obstacles_depth_image", || obstacle_scene(&look, &points));
    let plan = measure("planner20_depth_image", || {
        step += 1;
        candidates(&query, &settings, CandidateStreams { seed: 0, step })
    });
    Ok([build, plan])
}

/// The fastest motion through 50 configurations, with limits of velocity, acceleration, jerk and
/// the grip's speed.
fn timing() -> Result<Row> {
    /// Of the Panda, from its vendor, rad/s³.
    const JERK: [f64; DOF] = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10_000.0, 10_000.0];
    let start = PANDA.grip(&PANDA.start);
    let goal = Pose3::from_parts(start.translation + Vec3::new(0.1, -0.3, -0.2), start.rotation);
    let path = linear_path(&PANDA, &PANDA.start, &goal);
    let path = path.map_err(|reason| {
        lpr_core::Error::Environment(format!("timing_50: no line, {}", reason.name()))
    })?;
    let path = path.resample(CONFIGS);
    let limits = MotionLimits {
        velocity: core::array::from_fn(|j| f64::from(PANDA.joints[j].max_velocity)),
        acceleration: core::array::from_fn(|j| f64::from(PANDA.joints[j].max_acceleration)),
        jerk: Some(JERK),
    };
    let grip = GripSpeedLimit { robot: &PANDA, max_speed: 0.5 };
    time_optimal(&SmoothPath::through(&path), &limits, Some(&grip))?;
    Ok(measure("timing_50", || time_optimal(&SmoothPath::through(&path), &limits, Some(&grip))))
}
