//! Scratch.
use lpr_core::path::*;
use lpr_core::robot::Robot;
use lpr_core::sim::feasibility::*;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let task = Task::by_name(&a[1]).unwrap();
    let robot = Robot::by_name(&a[2]).unwrap();
    let n: u64 = a[3].parse().unwrap();
    let sigma: f32 = a[4].parse().unwrap();
    let frac: f32 = a[5].parse().unwrap();
    let abort: f32 = a[6].parse().unwrap();
    let settings = CandidateSettings {
        path_len: 30,
        planner_paths: 20,
        bezier_paths: 20,
        planner_collision_free_fraction: frac,
        draws_per_path: 5,
        min_goal_distance: 0.2,
        rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
        bezier: BezierSettings { sigma },
    };
    let params = SimParams { abort_force: abort, ..SimParams::STANDARD };
    let t = std::time::Instant::now();
    let k = task.keyframes;
    let mut rows = vec![[0.0f64; 8]; k];
    let mut cnt = vec![0.0f64; k];
    let mut reasons = std::collections::BTreeMap::new();
    for seed in 0..n {
        let Ok(env) = SimEnvironment::new(task, robot, seed, &["front"], &params) else { continue };
        let Some(snaps) = keyframe_snapshots(&env, seed) else { continue };
        for (i, s) in snaps.iter().enumerate() {
            let tr = s.execute_all(&settings, CandidateStreams { seed, step: i as u64 });
            let share = |src: Option<Source>| {
                let v: Vec<_> = tr.trials.iter().filter(|t| src.is_none_or(|s| t.source == s)).collect();
                if v.is_empty() { 0.0 } else { v.iter().filter(|t| t.success).count() as f64 / v.len() as f64 }
            };
            let sf = tr
                .set
                .shortest_free()
                .map(|c| tr.set.candidates.iter().position(|d| d == c).unwrap())
                .is_some_and(|j| tr.trials[j].success);
            let r = &mut rows[i];
            cnt[i] += 1.0;
            r[0] += tr.linear.as_ref().is_some_and(|t| t.success) as u8 as f64;
            r[1] += sf as u8 as f64;
            r[2] += share(Some(Source::Planner));
            r[3] += share(Some(Source::Bezier));
            r[4] += share(None);
            r[5] += tr.trials.iter().any(|t| t.success) as u8 as f64;
            r[6] += tr.trials.len() as f64;
            for t in &tr.trials {
                let key = (
                    i,
                    t.source,
                    if t.success {
                        "ok".to_string()
                    } else {
                        t.result.invalid.map_or("not done".into(), |x| x.name().to_string())
                    },
                );
                *reasons.entry(key).or_insert(0) += 1;
            }
        }
    }
    println!("{} {} sigma {sigma} frac {frac} abort {abort} n {}", task.name, robot.name, cnt[0]);
    for i in 0..k {
        let c = cnt[i].max(1.0);
        println!(
            "  kf{i}: linear {:.0}% shortest-free {:.0}% planner {:.0}% curve {:.0}% random {:.0}% best {:.0}%  admitted {:.1}",
            100.0 * rows[i][0] / c,
            100.0 * rows[i][1] / c,
            100.0 * rows[i][2] / c,
            100.0 * rows[i][3] / c,
            100.0 * rows[i][4] / c,
            100.0 * rows[i][5] / c,
            rows[i][6] / c
        );
    }
    println!("  {reasons:?} {:?}", t.elapsed());
}
