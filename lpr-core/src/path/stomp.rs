//! STOMP: a path improved by trying noisy copies of it and moving towards the better ones, without gradients.
//!
//! "STOMP: Stochastic trajectory optimization for motion planning" (ICRA 2011). Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - Obstacle costs are summed over pairs of a link and an obstacle, by the nearest sphere, and not weighted with its speed. They
//!   are also seen between waypoints, and count for the nearest one.
//! - The matrix of second differences ends at the fixed ends, so that its inverse is known in closed form.
//! - No copies are kept from one step to the next, and the noise shrinks.
//! - It ends with the first path that is free, and begins anew through random configurations (see
//!   [`StompSettings::beginnings`]).

use super::Rejection;
use super::course::{Beginnings, Optimized, clamped, compliance, optimize_beginnings, shift, touches};
use super::plan::{Plan, search_twice};
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
    /// Standard deviation of the noise in the middle of the path at the first step, radians.
    pub noise: f32,
    /// What the noise is multiplied with after every step.
    pub noise_decay: f32,
    /// How sharply better copies are preferred (`h` in the paper).
    pub sensitivity: f32,
    /// Gap that is kept to obstacles and other links (`ε` in the paper), metres.
    pub safe_distance: f32,
    /// Steps of one beginning.
    pub steps: u32,
    /// Beginnings: the straight motion to every goal, then motions through a random configuration.
    pub beginnings: u32,
}

impl StompSettings {
    /// The numbers that the command line and candidate sets use: sensitivity from the paper, the others by trial on 210 problems
    /// of MotionBenchMaker.
    pub const STANDARD: Self = Self {
        waypoints: 30,
        looks: 2,
        copies: 12,
        noise: 0.5,
        noise_decay: 0.98,
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
    let mut noise = settings.noise;
    for step in 1..=settings.steps {
        improve(checker, &mut course, smoothing, noise, settings, rng);
        if checker.path_is_free(&course) {
            return Optimized { course: Some(course), steps: step };
        }
        noise *= settings.noise_decay;
    }
    Optimized { course: None, steps: settings.steps }
}

/// A noisy copy: what was added to every waypoint, and what each of them costs then.
struct Copy {
    offsets: Vec<[f32; DOF]>,
    costs: Vec<f32>,
}

/// Moves every waypoint towards where it is cheaper, smoothly over the path.
fn improve(
    checker: &MotionChecker<'_>,
    course: &mut [JointConfig],
    smoothing: &Smoothing,
    noise: f32,
    settings: &StompSettings,
    rng: &mut Rng,
) {
    let copies: Vec<Copy> = (0..settings.copies)
        .map(|_| {
            let mut noisy = course.to_vec();
            for (config, offset) in noisy[1..].iter_mut().zip(smoothing.noise(noise, rng)) {
                shift(config, &offset, 1.0);
                *config = clamped(config, checker.arm().limits());
            }
            let offsets = noisy.iter().zip(course.iter()).map(|(a, b)| core::array::from_fn(|j| a[j] - b[j])).collect();
            Copy { offsets, costs: costs(checker, &noisy, settings) }
        })
        .collect();
    let update: Vec<[f32; DOF]> = (1..course.len() - 1).map(|at| preferred(&copies, at, settings.sensitivity)).collect();
    for (config, change) in course[1..].iter_mut().zip(smoothing.smooth(&update)) {
        shift(config, &change, 1.0);
        *config = clamped(config, checker.arm().limits());
    }
}

/// Cost of every waypoint, the ends included: how far gaps nearby are short of the safe distance, metres.
fn costs(checker: &MotionChecker<'_>, course: &[JointConfig], settings: &StompSettings) -> Vec<f32> {
    let mut costs = vec![0.0; course.len()];
    for touch in touches(checker, course, settings.looks, settings.safe_distance) {
        let nearest = if touch.fraction > 0.5 { touch.edge + 1 } else { touch.edge };
        costs[nearest] += touch.shortfall(settings.safe_distance);
    }
    costs
}

/// Mean of the copies' offsets at a waypoint, weighted with `exp(-h (S - min S) / (max S - min S))` of their costs `S` there.
fn preferred(copies: &[Copy], at: usize, sensitivity: f32) -> [f32; DOF] {
    let low = copies.iter().fold(f32::INFINITY, |low, copy| copy.costs[at].min(low));
    let high = copies.iter().fold(0.0, |high: f32, copy| copy.costs[at].max(high));
    // Where all cost the same, the mean of the noise would only shake the path.
    if high <= low {
        return [0.0; DOF];
    }
    let weights: Vec<f32> = copies.iter().map(|copy| libm::expf(-sensitivity * (copy.costs[at] - low) / (high - low))).collect();
    let total: f32 = weights.iter().sum();
    let mean = |j: usize| copies.iter().zip(&weights).map(|(copy, weight)| weight / total * copy.offsets[at][j]).sum();
    core::array::from_fn(mean)
}

/// Noise and changes whose second differences are small: covariance and matrix `R⁻¹` in the paper, `R = K²` of
/// [`compliance`].
struct Smoothing {
    waypoints: usize,
    /// Standard deviation of what unit noise makes of the waypoint that moves most.
    deviation: f32,
    /// `M` in the paper, row by row: `R⁻¹` with every column scaled to a largest element of 1 over the number of waypoints.
    rows: Vec<Vec<f32>>,
}

impl Smoothing {
    fn new(waypoints: usize) -> Self {
        let covariance = |i: usize, k: usize| -> f32 {
            (1..=waypoints).map(|m| compliance(waypoints, i, m) * compliance(waypoints, m, k)).sum()
        };
        let columns: Vec<Vec<f32>> = (1..=waypoints).map(|k| (1..=waypoints).map(|i| covariance(i, k)).collect()).collect();
        let largest = |column: &[f32]| column.iter().copied().fold(0.0, f32::max);
        let scales: Vec<f32> = columns.iter().map(|column| 1.0 / (largest(column) * waypoints as f32)).collect();
        let row = |i: usize| columns.iter().zip(&scales).map(|(column, scale)| column[i] * scale).collect();
        let variances: Vec<f32> = (0..waypoints).map(|i| columns[i][i]).collect();
        Self { waypoints, deviation: libm::sqrtf(largest(&variances)), rows: (0..waypoints).map(row).collect() }
    }

    /// Noise for every waypoint: `K⁻¹ z` with `z` standard normal has the covariance `K⁻² = R⁻¹`.
    fn noise(&self, deviation: f32, rng: &mut Rng) -> Vec<[f32; DOF]> {
        let forces: Vec<[f32; DOF]> = (0..self.waypoints).map(|_| core::array::from_fn(|_| normal(rng))).collect();
        let scale = deviation / self.deviation;
        let follow = |i: usize, j: usize| -> f32 {
            forces.iter().zip(1..).map(|(force, k)| compliance(self.waypoints, i, k) * force[j]).sum()
        };
        (1..=self.waypoints).map(|i| core::array::from_fn(|j| scale * follow(i, j))).collect()
    }

    fn smooth(&self, changes: &[[f32; DOF]]) -> Vec<[f32; DOF]> {
        let sum = |row: &[f32], j: usize| row.iter().zip(changes).map(|(weight, change)| weight * change[j]).sum();
        self.rows.iter().map(|row| core::array::from_fn(|j| sum(row, j))).collect()
    }
}
