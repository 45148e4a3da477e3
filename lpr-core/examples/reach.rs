//! Scratch.
use lpr_core::glamx::*;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::Robot;
use lpr_core::sim::demonstrator::plan_waypoints;
use lpr_core::sim::tasks::Task;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let task = Task::by_name(&args[1]).unwrap();
    let robot = Robot::by_name(&args[2]).unwrap();
    println!("{} {}: rows x 0.15..0.70, columns y -0.5..0.5; share of 5 yaws", task.name, robot.name);
    for xi in 0..12 {
        let x = 0.15 + 0.05 * xi as f32;
        print!("x {x:.2}: ");
        for yi in 0..11 {
            let y = -0.5 + 0.1 * yi as f32;
            let mut n = 0;
            for k in 0..5 {
                let yaw = task.placement.max_yaw * (k as f32 / 2.0 - 1.0);
                let mut rng = stream(1, Stream::Placement, k);
                let s = (task.build)(&mut rng).placed(&Pose3::from_parts(Vec3::new(x, y, 0.0), Quat::from_rotation_z(yaw)));
                if plan_waypoints(robot, &robot.start, &s.waypoints, &mut stream(1, Stream::Ik, k)).is_some() {
                    n += 1;
                }
            }
            print!("{n} ");
        }
        println!();
    }
}
