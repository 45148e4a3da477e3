//! Scratch.
use lpr_core::env::Environment;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::Robot;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let task = Task::by_name(&args[1]).unwrap();
    let robot = Robot::by_name(&args[2]).unwrap();
    let n: u64 = args[3].parse().unwrap();
    let verbose = args.len() > 4;
    let t = std::time::Instant::now();
    let mut ok = 0;
    let mut rej = 0;
    let mut reasons = std::collections::BTreeMap::new();
    for seed in 0..n {
        let mut env = match SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD) {
            Ok(e) => e,
            Err(e) => {
                *reasons.entry(e.to_string()[..40].to_string()).or_insert(0) += 1;
                continue;
            }
        };
        rej += env.rejected_placements();
        let t1 = t.elapsed();
        let mut rng = stream(seed, Stream::Demo, 0);
        let demo = demonstrate(&mut env, &mut rng);
        if demo.success {
            ok += 1;
        } else {
            let joint = if env.world().spec().joints.is_empty() { 0.0 } else { env.world().joint_position(0) };
            let r = match &demo.invalid {
                Some(i) => i.to_string(),
                None => "not done".into(),
            };
            let key = match &demo.invalid {
                Some(i) => i.name().to_string(),
                None => format!("not done {:?}", env.world().holding()),
            };
            *reasons.entry(key).or_insert(0) += 1;
            if verbose {
                println!(
                    "seed {seed}: {r} step {} frames {} joint {joint:.3} width {:.4} holding {:?}",
                    env.steps_done(),
                    demo.frames.len(),
                    env.world().gripper_width(),
                    env.world().holding()
                );
            }
        }
        if verbose && seed == 0 {
            println!("reset {:?}", t1);
            for w in &demo.waypoint_frames {
                let f = &demo.frames[*w];
                println!(
                    "wp frame {w}: width {:.4} holding {:?} joint {:?} grip {:?}",
                    f.gripper_width(),
                    f.holding(),
                    (0..f.spec().joints.len()).map(|j| f.joint_position(j)).collect::<Vec<_>>(),
                    robot.grip(f.config()).translation
                );
            }
        }
        let _ = env.observe();
    }
    println!("{} {}: {ok}/{n} rejected {rej} {reasons:?} {:?}", task.name, robot.name, t.elapsed());
}
