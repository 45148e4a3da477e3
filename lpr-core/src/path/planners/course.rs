//! Parts that optimising planners share: a path with a fixed number of waypoints between fixed ends,
//! and the obstacles near it.
//!
//! Deformation is that of a string: the sum of squared differences between neighbours is `ξᵀ K ξ`
//! plus terms of the ends, and the inverse of `K` (2 on the diagonal, -1 beside it) is known in
//! closed form.

use super::plan::{Bounds, Plan, sample_within, sampling_bounds};
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::JointConfig;
use crate::scene::{MotionChecker, Proximity};

/// Element of the inverse of `K` for `n` waypoints between fixed ends: how far waypoint `i` follows
/// a unit force on `k`.
///
/// Waypoints count from 1; the ends, 0 and `n + 1`, do not move.
pub(super) fn compliance(n: usize, i: usize, k: usize) -> f32 {
    (i.min(k) * (n + 1 - i.max(k))) as f32 / (n + 1) as f32
}

/// `n` waypoints between `start` and `goal` on straight motions through `via`.
pub(super) fn straight_course(
    start: &JointConfig,
    via: &[JointConfig],
    goal: &JointConfig,
    n: usize,
) -> Vec<JointConfig> {
    let corners = [&[*start], via, &[*goal]].concat();
    JointPath(corners).resample(n + 2).0
}

/// Something that the arm is near to on its way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touch {
    /// Waypoint at or before it.
    pub(super) edge: usize,
    /// Fraction of the way to the next waypoint, above 0, at most 1.
    pub(super) fraction: f32,
    pub(super) proximity: Proximity,
}

impl Touch {
    /// Shortfall of the gap against `distance`, metres; 0 if there is none.
    pub(super) fn shortfall(&self, distance: f32) -> f32 {
        (distance - self.proximity.distance).max(0.0)
    }
}

/// All that the arm comes nearer to than `reach` (metres), seen at `looks` equal steps of every
/// edge; the ends are not looked at.
pub(super) fn touches(
    checker: &MotionChecker<'_>,
    course: &[JointConfig],
    looks: usize,
    reach: f32,
) -> Vec<Touch> {
    let last = (course.len() - 1) * looks;
    let at_step = |step: usize| {
        let (edge, look) = ((step - 1) / looks, (step - 1) % looks + 1);
        let fraction = look as f32 / looks as f32;
        let config = course[edge].lerp(&course[edge + 1], fraction);
        checker.proximities(&config, reach).into_iter().map(move |proximity| Touch {
            edge,
            fraction,
            proximity,
        })
    };
    (1..last).flat_map(at_step).collect()
}

/// The paths that an optimisation begins with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beginnings {
    /// Waypoints between the ends.
    pub(super) waypoints: usize,
    /// Number of beginnings that are tried.
    pub(super) count: u32,
}

/// Outcome of an optimisation from one beginning, and its number of steps.
pub(super) struct Optimized {
    /// A course that is free, if it came to one.
    pub(super) course: Option<Vec<JointConfig>>,
    pub(super) steps: u32,
}

/// Optimises beginnings until one is free: the straight motion to every goal in turn, thereafter
/// motions through a random free configuration.
pub(super) fn optimize_beginnings(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    beginnings: Beginnings,
    rng: &mut Rng,
    mut optimize: impl FnMut(&[JointConfig], &mut Rng) -> Optimized,
) -> Result<Plan, Rejection> {
    let bounds = sampling_bounds(checker.arm().limits(), start, goals);
    let mut iterations = 0;
    for beginning in 0..beginnings.count as usize {
        let goal = &goals[beginning % goals.len()];
        let via = if beginning < goals.len() { None } else { free_sample(checker, &bounds, rng) };
        let Optimized { course, steps } =
            optimize(&straight_course(start, via.as_slice(), goal, beginnings.waypoints), rng);
        iterations += steps;
        if let Some(course) = course {
            return Ok(Plan { path: JointPath(course), iterations });
        }
        if checker.is_stopped() {
            return Err(Rejection::Stopped);
        }
    }
    Err(Rejection::OptimizationFailed)
}

/// A free configuration, if some draws give one.
fn free_sample(checker: &MotionChecker<'_>, bounds: &Bounds, rng: &mut Rng) -> Option<JointConfig> {
    /// Draws of a configuration; if none of them is free, the straight motion is tried again.
    const DRAWS: usize = 50;
    (0..DRAWS).map(|_| sample_within(bounds, rng)).find(|sample| checker.is_free(sample))
}

/// Adds `factor` times `direction` to a configuration.
pub(super) fn shift(config: &mut JointConfig, direction: &[f32], factor: f32) {
    for (q, d) in config.iter_mut().zip(direction) {
        *q += factor * d;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::stick_arm::stick_arm;
    use crate::scene::{ArmSpheres, Primitive, Scene};
    use glamx::Vec3;

    #[test]
    fn compliance_is_the_inverse_of_the_string() {
        for n in 1..12 {
            for i in 1..=n {
                for k in 1..=n {
                    let product = 2.0 * compliance(n, i, k)
                        - compliance(n, i - 1, k)
                        - compliance(n, i + 1, k);
                    assert!(
                        (product - f32::from(u8::from(i == k))).abs() < 1e-5,
                        "{n} {i} {k}: {product}"
                    );
                }
            }
        }
    }

    #[test]
    fn touches_lie_where_the_arm_passes_a_ball_and_tell_its_distance() {
        /// Metres.
        const REACH: f32 = 0.05;
        let robot = stick_arm();
        let (arm, ball) = (ArmSpheres::new(&robot), robot.grip(&robot.start).translation);
        let scene = Scene::from_primitives(vec![Primitive::Sphere {
            center: ball + Vec3::new(0.0, 0.0, -0.08),
            radius: 0.05,
        }]);
        let checker = MotionChecker::new(&scene, &arm, 32.0);
        let turned =
            |turn: f32| JointConfig::from_fn(7, |j| if j == 0 { turn } else { robot.start[j] });
        let course = straight_course(&turned(-1.0), &[], &turned(1.0), 19);
        let near = touches(&checker, &course, 4, REACH);
        assert!(!near.is_empty());
        for touch in near {
            let config = course[touch.edge].lerp(&course[touch.edge + 1], touch.fraction);
            assert!(config[0].abs() < 0.3, "{}", config[0]);
            assert!(checker.proximities(&config, REACH).contains(&touch.proximity));
        }
        assert!(
            touches(&checker, &straight_course(&turned(0.5), &[], &turned(1.0), 19), 4, REACH)
                .is_empty()
        );
    }
}
