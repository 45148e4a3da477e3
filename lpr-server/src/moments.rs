//! Which worlds of a demonstration are drawn: every so many control steps, its end, and what falls
//! after it.

use lpr_core::sim::{Demonstration, World};

/// Time in which the scene comes to rest after a demonstration, seconds: what is let go of falls.
const REST_SECS: f32 = 1.0;

/// A world that is drawn.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Index of the demonstration's frame; while the scene comes to rest, of the last one.
    pub frame: usize,
    /// The world.
    pub world: World,
}

/// Every `control_steps`-th world of a demonstration, the last among them, then those of a second
/// in which the arm stands still.
#[must_use]
pub fn of(demo: &Demonstration, control_steps: usize) -> Vec<Moment> {
    let last = demo.frames.len() - 1;
    let drawn = (last % control_steps..=last).step_by(control_steps);
    let mut moments: Vec<_> =
        drawn.map(|frame| Moment { frame, world: demo.frames[frame].clone() }).collect();
    // Of an arm that was stopped nothing is known to stand still.
    if demo.invalid.is_none() {
        let worlds = resting(&demo.frames[last], control_steps);
        moments.extend(worlds.into_iter().map(|world| Moment { frame: last, world }));
    }
    moments
}

/// Every `control_steps`-th world while the scene comes to rest.
fn resting(end: &World, control_steps: usize) -> Vec<World> {
    let mut world = end.clone();
    let (config, steps) = (*end.config(), control_steps * end.params().steps_per_control());
    let n_worlds = ((REST_SECS / end.params().control_dt).round() as usize).div_ceil(control_steps);
    let mut next = || {
        for _ in 0..steps {
            // The arm stands still: it presses with no more than what its gripper's motor gives.
            let _ = world.step(&config);
        }
        world.clone()
    };
    (0..n_worlds).map(|_| next()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_core::rng::{Stream, stream};
    use lpr_core::robot::XARM7;
    use lpr_core::sim::tasks::Task;
    use lpr_core::sim::{SimEnvironment, SimParams, demonstrate};

    fn demonstration(task: &str) -> Demonstration {
        let task = Task::by_name(task).unwrap();
        let mut env =
            SimEnvironment::new(&task, &XARM7, 0, &["front"], &SimParams::STANDARD).unwrap();
        demonstrate(&mut env, &mut stream(0, Stream::Demo, 0))
    }

    #[test]
    fn the_end_is_drawn_whatever_the_period() {
        let demo = demonstration("reach_target");
        let last = demo.frames.len() - 1;
        for control_steps in 1..8 {
            let frames: Vec<_> =
                of(&demo, control_steps).iter().map(|moment| moment.frame).collect();
            assert!(
                frames
                    .windows(2)
                    .all(|pair| pair[1] - pair[0] == control_steps || pair == [last, last]),
                "{frames:?}"
            );
            let at_rest = frames.iter().filter(|frame| **frame == last).count() - 1;
            assert_eq!(at_rest, 20_usize.div_ceil(control_steps), "a second of 50 ms steps");
        }
    }

    #[test]
    fn rubbish_has_come_to_rest_on_the_ground_of_its_bin() {
        let moments = of(&demonstration("put_rubbish_in_bin"), 4);
        let body =
            moments[0].world.spec().bodies.iter().position(|body| body.name == "rubbish").unwrap();
        let heights: Vec<_> =
            moments.iter().map(|moment| moment.world.body_pose(body).translation.z).collect();
        let [.., before, end] = heights[..] else { panic!("a demonstration has moments") };
        assert!((before - end).abs() < 1e-3, "it still falls: {before} m, then {end} m");
        assert!(end < 0.1 && heights.iter().any(|height| *height > end + 0.1), "{heights:?}");
    }
}
