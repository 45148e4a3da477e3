//! STOMP: a path improved by trying noisy copies of it and moving towards the better ones, without
//! gradients.
//!
//! "STOMP: Stochastic trajectory optimization for motion planning" (ICRA 2011). Deterministic for a
//! generator.
//!
//! # Differences from the original
//!
//! - Obstacle costs are summed over pairs of a link and an obstacle, by the nearest sphere, and not
//!   weighted with its speed. They are also seen between waypoints, and count for the nearest one.
//! - The matrix of second differences ends at the fixed ends, so that its inverse is known in
//!   closed form.
//! - It ends with the first path that is free, and begins anew through random configurations (see
//!   [`StompSettings::beginnings`]).

use super::course::{Beginnings, Optimized, compliance, optimize_beginnings, shift, touches};
use super::plan::{Plan, clamped, search_twice};
use crate::path::rejection::Rejection;
use crate::rng::{Rng, normal};
use crate::robot::{DOF, JointConfig};
use crate::scene::MotionChecker;
use serde::{Deserialize, Serialize};

/// Numbers of [`stomp`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StompSettings {
    /// Waypoints between the ends (`N` in the paper).
    pub waypoints: usize,
    /// Configurations looked at on the way from one waypoint to the next, that included.
    pub looks: usize,
    /// Noisy copies of every step (`K` in the paper).
    pub copies: usize,
    /// Best copies that also count in the step after.
    pub kept_copies: usize,
    /// Standard deviation of the noise in the middle of the path, radians.
    pub noise: f32,
    /// Sharpness of the preference for better copies (`h` in the paper).
    pub sensitivity: f32,
    /// Gap that is kept to obstacles and other links (`ε` in the paper), metres.
    pub safe_distance: f32,
    /// Steps of one beginning.
    pub steps: u32,
    /// Beginnings: the straight motion to every goal, then motions through a random configuration.
    pub beginnings: u32,
}

impl StompSettings {
    /// The numbers that the command line and candidate sets use: sensitivity from the paper, the
    /// others by trial on 210 problems of MotionBenchMaker.
    pub const STANDARD: Self = Self {
        waypoints: 30,
        looks: 2,
        copies: 12,
        kept_copies: 6,
        noise: 0.25,
        sensitivity: 10.0,
        safe_distance: 0.03,
        steps: 60,
        beginnings: 6,
    };
}

/// A free path from `start` to one of `goals`.
///
/// The path found is looked at once more, as in [`rrt_connect`](super::rrt_connect).
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{Rejection, StompSettings, stomp};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// // A post where the hand is at the start.
/// let top = XARM7.grip(&XARM7.start).translation;
/// let post = Primitive::Capsule { a: Vec3 { z: 0.0, ..top }, b: top, radius: 0.03 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let (mut start, mut goal) = (XARM7.start, XARM7.start);
/// (start[0], goal[0]) = (0.7, -0.7);
/// let plan = stomp(&checker, &start, &[goal], &StompSettings::STANDARD, &mut stream(0, Stream::Planner, 0))?;
/// let n_waypoints = StompSettings::STANDARD.waypoints;
/// assert_eq!(plan.path.configs().len(), n_waypoints + 2, "between the ends");
/// assert!(checker.path_is_free(plan.path.configs()));
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no free path from any beginning.
pub fn stomp(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &StompSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    let beginnings = Beginnings { waypoints: settings.waypoints, count: settings.beginnings };
    let smoothing = Smoothing::new(settings.waypoints);
    search_twice(checker, start, goals, |checker, goals| {
        optimize_beginnings(checker, start, goals, beginnings, rng, |course, rng| {
            optimize(checker, course, &smoothing, settings, rng)
        })
    })
}

fn optimize(
    checker: &MotionChecker<'_>,
    course: &[JointConfig],
    smoothing: &Smoothing,
    settings: &StompSettings,
    rng: &mut Rng,
) -> Optimized {
    let mut course = course.to_vec();
    let mut copies = Vec::new();
    for step in 1..=settings.steps {
        if checker.is_stopped() {
            break;
        }
        improve(checker, &mut course, &mut copies, smoothing, settings, rng);
        if checker.path_is_free(&course) {
            return Optimized { course: Some(course), steps: step };
        }
    }
    Optimized { course: None, steps: settings.steps }
}

/// A noisy copy, and what each of its waypoints costs.
struct Copy {
    course: Vec<JointConfig>,
    costs: Vec<f32>,
}

/// Moves every waypoint towards where it is cheaper, smoothly over the path. `copies` are the best
/// of the step before, and become those of this one.
fn improve(
    checker: &MotionChecker<'_>,
    course: &mut [JointConfig],
    copies: &mut Vec<Copy>,
    smoothing: &Smoothing,
    settings: &StompSettings,
    rng: &mut Rng,
) {
    for _ in 0..settings.copies {
        let mut noisy = course.to_vec();
        add(&mut noisy, &smoothing.noise(course[0].dof(), settings.noise, rng), checker);
        copies.push(Copy { costs: costs(checker, &noisy, settings), course: noisy });
    }
    let changes: Vec<JointConfig> = (1..course.len() - 1)
        .map(|at| preferred(&course[at], copies, at, settings.sensitivity))
        .collect();
    add(course, &smoothing.smooth(&changes), checker);
    // Good copies count once more in the next step, which saves their checks.
    let total = |copy: &Copy| copy.costs.iter().sum::<f32>();
    copies.sort_by(|a, b| total(a).total_cmp(&total(b)));
    copies.truncate(settings.kept_copies);
}

/// Moves the waypoints between the ends, as far as the limits allow.
fn add(course: &mut [JointConfig], changes: &[JointConfig], checker: &MotionChecker<'_>) {
    for (config, change) in course[1..].iter_mut().zip(changes) {
        shift(config, change, 1.0);
        *config = clamped(config, checker.arm().limits());
    }
}

/// Cost of every waypoint, the ends included: how far gaps nearby are short of the safe distance,
/// metres.
fn costs(
    checker: &MotionChecker<'_>,
    course: &[JointConfig],
    settings: &StompSettings,
) -> Vec<f32> {
    let mut costs = vec![0.0; course.len()];
    for touch in touches(checker, course, settings.looks, settings.safe_distance) {
        let nearest = if touch.fraction > 0.5 { touch.edge + 1 } else { touch.edge };
        costs[nearest] += touch.shortfall(settings.safe_distance);
    }
    costs
}

/// Mean of the offsets of the copies of `config`, the waypoint number `at`, weighted with
/// `exp(-h (S - min S) / (max S - min S))` of their costs `S` there.
fn preferred(config: &JointConfig, copies: &[Copy], at: usize, sensitivity: f32) -> JointConfig {
    let low = copies.iter().fold(f32::INFINITY, |low, copy| copy.costs[at].min(low));
    let high = copies.iter().fold(0.0, |high: f32, copy| copy.costs[at].max(high));
    // Where all cost the same, the mean of the noise would only shake the path.
    if high <= low {
        return config.map(|_| 0.0);
    }
    let weights: Vec<f32> = copies
        .iter()
        .map(|copy| libm::expf(-sensitivity * (copy.costs[at] - low) / (high - low)))
        .collect();
    let total: f32 = weights.iter().sum();
    let offset = |copy: &Copy, j: usize| copy.course[at][j] - config[j];
    JointConfig::from_fn(config.dof(), |j| {
        copies.iter().zip(&weights).map(|(copy, weight)| weight / total * offset(copy, j)).sum()
    })
}

/// Noise and changes whose second differences are small: covariance and matrix `R⁻¹` in the paper,
/// `R = K²` of [`compliance`].
struct Smoothing {
    waypoints: usize,
    /// Standard deviation of what unit noise makes of the waypoint that moves most.
    deviation: f32,
    /// `M` in the paper, row by row: `R⁻¹` with every column scaled to a largest element of 1 over
    /// the number of waypoints.
    rows: Vec<Vec<f32>>,
}

impl Smoothing {
    fn new(waypoints: usize) -> Self {
        let covariance = |i: usize, k: usize| -> f32 {
            (1..=waypoints).map(|m| compliance(waypoints, i, m) * compliance(waypoints, m, k)).sum()
        };
        let columns: Vec<Vec<f32>> =
            (1..=waypoints).map(|k| (1..=waypoints).map(|i| covariance(i, k)).collect()).collect();
        let largest = |column: &[f32]| column.iter().copied().fold(0.0, f32::max);
        let scales: Vec<f32> =
            columns.iter().map(|column| 1.0 / (largest(column) * waypoints as f32)).collect();
        let row = |i: usize| {
            columns.iter().zip(&scales).map(|(column, scale)| column[i] * scale).collect()
        };
        let variances: Vec<f32> = (0..waypoints).map(|i| columns[i][i]).collect();
        Self {
            waypoints,
            deviation: libm::sqrtf(largest(&variances)),
            rows: (0..waypoints).map(row).collect(),
        }
    }

    /// Noise for every waypoint: `K⁻¹ z` with `z` standard normal has the covariance `K⁻² = R⁻¹`.
    ///
    /// At least seven numbers are drawn for each, as when every configuration had seven entries.
    fn noise(&self, dof: usize, deviation: f32, rng: &mut Rng) -> Vec<JointConfig> {
        let n_drawn = dof.max(DOF);
        let forces: Vec<JointConfig> =
            (0..self.waypoints).map(|_| JointConfig::from_fn(n_drawn, |_| normal(rng))).collect();
        let scale = deviation / self.deviation;
        let follow = |i: usize, j: usize| -> f32 {
            forces
                .iter()
                .zip(1..)
                .map(|(force, k)| compliance(self.waypoints, i, k) * force[j])
                .sum()
        };
        (1..=self.waypoints).map(|i| JointConfig::from_fn(dof, |j| scale * follow(i, j))).collect()
    }

    fn smooth(&self, changes: &[JointConfig]) -> Vec<JointConfig> {
        let Some(dof) = changes.first().map(JointConfig::dof) else { return Vec::new() };
        let sum = |row: &[f32], j: usize| {
            row.iter().zip(changes).map(|(weight, change)| weight * change[j]).sum()
        };
        self.rows.iter().map(|row| JointConfig::from_fn(dof, |j| sum(row, j))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};

    const WAYPOINTS: usize = 9;

    #[test]
    fn noise_is_smooth_and_as_strong_in_the_middle_as_asked_for() {
        let (smoothing, rng) = (Smoothing::new(WAYPOINTS), &mut stream(0, Stream::Planner, 0));
        let n = 3000;
        let (mut middle, mut first) = (0.0, 0.0);
        for _ in 0..n {
            let noise = smoothing.noise(DOF, 0.5, rng);
            middle += noise[WAYPOINTS / 2][0] * noise[WAYPOINTS / 2][0];
            first += noise[0][0] * noise[0][0];
        }
        let deviation = libm::sqrtf(middle / n as f32);
        assert!((deviation - 0.5).abs() < 0.03, "{deviation}");
        // Towards the fixed ends it fades away.
        assert!(libm::sqrtf(first / n as f32) < 0.25);
    }

    #[test]
    fn smoothing_spreads_a_change_of_one_waypoint_without_growing_it() {
        let smoothing = Smoothing::new(WAYPOINTS);
        for at in 0..WAYPOINTS {
            let mut changes = vec![JointConfig::new([0.0; DOF]); WAYPOINTS];
            changes[at] = JointConfig::new([1.0; DOF]);
            let smooth = smoothing.smooth(&changes);
            let most = smooth.iter().map(|change| change[0]).fold(0.0, f32::max);
            assert!((most - 1.0 / WAYPOINTS as f32).abs() < 1e-6, "{most}");
            assert!(smooth.iter().all(|change| change[0] > 0.0));
        }
    }

    #[test]
    fn a_waypoint_goes_to_where_copies_cost_less_and_stays_where_all_cost_the_same() {
        let at = |q: f32| JointConfig::new([q; DOF]);
        let copy =
            |offset: f32, cost: f32| Copy { course: vec![at(1.0 + offset)], costs: vec![cost] };
        let copies = [copy(-0.4, 0.0), copy(0.2, 0.3), copy(0.3, 0.1)];
        let preferred_at = |sensitivity| preferred(&at(1.0), &copies, 0, sensitivity)[0];
        assert!((preferred_at(0.0) - 0.1 / 3.0).abs() < 1e-6);
        assert!(preferred_at(10.0) < -0.3 && preferred_at(100.0) < preferred_at(10.0));
        assert_eq!(preferred(&at(1.0), &[copy(0.1, 0.2), copy(0.3, 0.2)], 0, 10.0), at(0.0));
    }
}
