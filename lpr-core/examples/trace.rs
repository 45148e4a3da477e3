//! Scratch.
use lpr_core::env::Environment;
use lpr_core::path::*;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::*;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let task = Task::by_name(&args[1]).unwrap();
    let robot = Robot::by_name(&args[2]).unwrap();
    let seed: u64 = args[3].parse().unwrap();
    let mut env = SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD).unwrap();
    let demo = demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0));
    // replay: from the frame before grasp close
    let mut w = demo.frames[demo.waypoint_frames[1] - 1].clone();
    let c = *w.config();
    w.command_gripper(Gripper::Close);
    for i in 0..150 {
        let r = w.step(&c);
        println!(
            "close {i} width {:.5} forces {:?} joint {:.5} {r:?}",
            w.gripper_width(),
            w.finger_forces(),
            w.joint_position(0)
        );
        if w.gripper_settled() && i > 20 {
            break;
        }
    }
    let goal = env.plan().goals[2].pose;
    let path = linear_path(robot, &c, &goal);
    if let Ok(path) = path {
        let timed = TimedPath::new(path, robot, &TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 }).unwrap();
        for i in 1..60 {
            let r = w.step(&timed.config_at(i as f64 * 0.01));
            println!(
                "pull {i} width {:.5} forces {:?} joint {:.5} {r:?}",
                w.gripper_width(),
                w.finger_forces(),
                w.joint_position(0)
            );
        }
    }
}
