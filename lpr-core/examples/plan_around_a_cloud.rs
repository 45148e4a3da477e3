//! A path around the points that a depth camera saw: planned, made short, and given a time.
//!
//! ```text
//! cargo run -p lpr-core --no-default-features --example plan_around_a_cloud
//! ```
#![expect(clippy::print_stdout, reason = "an example shows what it found")]

use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::path::{RrtSettings, TimedPath, TimingSettings, rrt_connect, simplify};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::XARM7;
use lpr_core::scene::{ArmSpheres, MotionChecker, POINT_RADIUS, Scene, VOXEL, downsample};

const PLANNER: RrtSettings =
    RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 5000 };
const TIMING: TimingSettings = TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 };

/// A wall ahead of the arm, half a metre high, with a point every 5 mm.
fn wall() -> Vec<Vec3> {
    let along = |n: u16| (0..n).map(|i| 0.005 * f32::from(i));
    along(80).flat_map(|x| along(100).map(move |z| Vec3::new(0.3 + x, 0.0, z))).collect()
}

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let pointing_down = Quat::from_rotation_x(core::f32::consts::PI);
    let at = |y: f32| Pose3::from_parts(Vec3::new(0.45, y, 0.15), pointing_down);
    let start = XARM7.ik_nearest(&at(-0.25), &XARM7.start).ok_or("the start is out of reach")?;
    // Any of the configurations near the start will do.
    let mut goals = XARM7.ik_distinct(&at(0.25), 20, 0.2, &start, &mut stream(0, Stream::Ik, 0));
    goals.sort_by(|a, b| a.distance(&start).total_cmp(&b.distance(&start)));
    goals.truncate(5);

    let points = wall();
    let scene = Scene::from_points(&downsample(&points, VOXEL), POINT_RADIUS);
    let arm = ArmSpheres::new(&XARM7);
    let checker = MotionChecker::new(&scene, &arm, PLANNER.checks_per_radian);
    // No path is a value with a reason, as `Rejection::IterationLimit`.
    let plan = rrt_connect(&checker, &start, &goals, &PLANNER, &mut stream(0, Stream::Planner, 0))
        .map_err(|reason| format!("no path: {}", reason.name()))?;
    let path = simplify(&plan.path, &checker);
    assert!(checker.path_is_free(path.configs()) && path.length() <= plan.path.length());
    println!(
        "{} points, {} samples drawn, {} configurations checked",
        points.len(),
        plan.iterations,
        checker.n_checks()
    );
    println!(
        "{:.2} rad as it was found, {:.2} rad when simplified",
        plan.path.length(),
        path.length()
    );

    let timed = TimedPath::new(path, &XARM7, &TIMING)?;
    println!("it takes {:.2} s", timed.duration_secs());
    for step in 0..=10 {
        let t_secs = timed.duration_secs() * f64::from(step) / 10.0;
        let grip = XARM7.grip(&timed.config_at(t_secs)).translation;
        println!("{t_secs:5.2} s   grip at {:6.3} {:6.3} {:6.3} m", grip.x, grip.y, grip.z);
    }
    Ok(())
}
