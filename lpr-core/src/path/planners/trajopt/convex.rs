//! The convex problem of one step, solved in its dual.
//!
//! ```text
//! minimise  w/2 Σ |x_t+1 - x_t|²  +  μ Σ max(0, v_i - a_i · x)      with  low ≤ x ≤ high
//! ```
//!
//! With a multiplier `0 ≤ λ_i ≤ μ` for every gap and `ν` for every bound, the best path is the
//! straight one, pushed: `x = straight + K⁻¹ (Σ λ_i a_i - ν) / w`. Each multiplier in turn takes
//! its best value (coordinate ascent, as of Hildreth 1957), and the path follows. `w` is the number
//! of edges: the first sum is then the square of a straight path's length.

use crate::path::planners::course::{Touch, compliance, shift, straight_course};
use crate::path::planners::plan::{Bounds, clamped};
use crate::robot::JointConfig;

/// Radians by which no waypoint moves any more when the multipliers have converged.
const CONVERGED: f32 = 1e-4;

/// Half the weighted sum of squared differences between neighbours, radians².
pub(super) fn energy(course: &[JointConfig]) -> f32 {
    let squares =
        course.windows(2).map(|pair| pair[0].distance(&pair[1]) * pair[0].distance(&pair[1]));
    0.5 * (course.len() - 1) as f32 * squares.sum::<f32>()
}

/// A gap as a linear function of the path.
#[derive(Debug)]
struct LinearGap {
    edge: usize,
    fraction: f32,
    gradient: JointConfig,
    /// `v` above: how far the gap would be short with all joints at 0, metres.
    level: f32,
    /// Motion of every waypoint, the ends included, along the gradient for a unit of the
    /// multiplier.
    response: Vec<f32>,
    /// By how much that widens the gap, metres.
    curvature: f32,
}

/// A convex problem.
#[derive(Debug)]
pub(super) struct Convex {
    gaps: Vec<LinearGap>,
    penalty: f32,
}

impl Convex {
    /// The cost near `course`, with what is near it.
    pub(super) fn new(
        course: &[JointConfig],
        near: &[Touch],
        safe_distance: f32,
        penalty: f32,
    ) -> Self {
        let gaps = near
            .iter()
            .map(|touch| LinearGap::new(course, touch, safe_distance))
            .filter(|gap| gap.curvature > 0.0);
        Self { gaps: gaps.collect(), penalty }
    }

    /// Its value on `course`.
    pub(super) fn cost(&self, course: &[JointConfig]) -> f32 {
        energy(course)
            + self.penalty * self.gaps.iter().map(|gap| gap.shortfall(course).max(0.0)).sum::<f32>()
    }

    /// The best course within `limits` none of whose joints is further than `trust` (radians) from
    /// that of `course`; nearly so after a limited number of `sweeps`.
    pub(super) fn solve(
        &self,
        course: &[JointConfig],
        trust: f32,
        limits: &[(f32, f32)],
        sweeps: u32,
    ) -> Vec<JointConfig> {
        let n = course.len() - 2;
        let bounds: Vec<Bounds> =
            course.iter().map(|config| trusted(config, trust, limits)).collect();
        let mut x = straight_course(&course[0], &[], &course[n + 1], n);
        let mut multipliers = vec![0.0; self.gaps.len()];
        let mut holds = vec![course[0].map(|_| 0.0); n + 2];
        for _ in 0..sweeps {
            let mut moved: f32 = 0.0;
            for (gap, multiplier) in self.gaps.iter().zip(&mut multipliers) {
                moved = moved.max(gap.ascend(&mut x, multiplier, self.penalty));
            }
            for k in 1..=n {
                moved = moved.max(hold(&mut x, k, &bounds[k], &mut holds[k]));
            }
            if moved < CONVERGED {
                break;
            }
        }
        x.iter().zip(&bounds).map(|(config, bounds)| clamped(config, bounds)).collect()
    }
}

/// The part of the box around `config` that is within the limits; `config` itself, where it is not.
fn trusted(config: &JointConfig, trust: f32, limits: &[(f32, f32)]) -> Bounds {
    let range = |j: usize| {
        let (low, high) = (limits[j].0.min(config[j]), limits[j].1.max(config[j]));
        ((config[j] - trust).max(low), (config[j] + trust).min(high))
    };
    (0..limits.len()).map(range).collect()
}

impl LinearGap {
    fn new(course: &[JointConfig], touch: &Touch, safe_distance: f32) -> Self {
        let Touch { edge, fraction, proximity } = *touch;
        let n = course.len() - 2;
        let weight = 1.0 / (n + 1) as f32;
        let follow = |i: usize| {
            weight
                * ((1.0 - fraction) * compliance(n, i, edge)
                    + fraction * compliance(n, i, edge + 1))
        };
        let response: Vec<f32> = (0..n + 2).map(follow).collect();
        let slope: f32 = proximity.gradient.iter().map(|g| g * g).sum();
        let curvature = slope * ((1.0 - fraction) * response[edge] + fraction * response[edge + 1]);
        let mut gap =
            Self { edge, fraction, gradient: proximity.gradient, level: 0.0, response, curvature };
        gap.level = safe_distance - proximity.distance - gap.shortfall(course);
        gap
    }

    /// Shortfall of the gap, metres; negative when it is wider than it has to be.
    fn shortfall(&self, course: &[JointConfig]) -> f32 {
        let config = course[self.edge].lerp(&course[self.edge + 1], self.fraction);
        self.level - config.iter().zip(self.gradient.iter()).map(|(q, g)| q * g).sum::<f32>()
    }

    /// Sets the multiplier to its best value, which moves the course; returns how far, radians.
    fn ascend(&self, x: &mut [JointConfig], multiplier: &mut f32, penalty: f32) -> f32 {
        // Not `clamp`, which panics for a penalty that is no number.
        let best = (*multiplier + self.shortfall(x) / self.curvature).min(penalty).max(0.0);
        let change = best - *multiplier;
        *multiplier = best;
        let mut most: f32 = 0.0;
        if change != 0.0 {
            for (config, response) in x.iter_mut().zip(&self.response) {
                shift(config, &self.gradient, change * response);
                most = most.max((change * response).abs());
            }
        }
        most
    }
}

/// Sets the multipliers of the bounds on waypoint `k` to their best values; returns how far that
/// moves the course, radians.
fn hold(
    x: &mut [JointConfig],
    k: usize,
    bounds: &[(f32, f32)],
    multipliers: &mut JointConfig,
) -> f32 {
    let n = x.len() - 2;
    let weight = 1.0 / (n + 1) as f32;
    let curvature = weight * compliance(n, k, k);
    let unheld = JointConfig::from_fn(bounds.len(), |j| x[k][j] + multipliers[j] * curvature);
    let held = clamped(&unheld, bounds);
    let changes =
        JointConfig::from_fn(bounds.len(), |j| (unheld[j] - held[j]) / curvature - multipliers[j]);
    let most = changes.iter().fold(0.0, |most: f32, change| most.max(change.abs())) * curvature;
    if most > 0.0 {
        for (i, config) in x.iter_mut().enumerate() {
            shift(config, &changes, -weight * compliance(n, i, k));
        }
        for (multiplier, change) in multipliers.iter_mut().zip(changes.iter()) {
            *multiplier += change;
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::DOF;
    use crate::scene::Proximity;
    use proptest::prelude::*;

    const LIMITS: [(f32, f32); DOF] = [(-2.0, 2.0); DOF];
    const WAYPOINTS: usize = 6;
    /// Metres.
    const SAFE_DISTANCE: f32 = 0.02;
    /// Enough to converge.
    const SWEEPS: u32 = 5000;

    fn config() -> impl Strategy<Value = JointConfig> {
        prop::array::uniform7(-1.5_f32..1.5).prop_map(JointConfig::new)
    }

    fn touch() -> impl Strategy<Value = Touch> {
        let proximity = (-0.05_f32..0.05, prop::array::uniform7(-0.5_f32..0.5));
        (0..=WAYPOINTS, 0.1_f32..1.0, proximity).prop_map(
            |(edge, fraction, (distance, gradient))| Touch {
                edge,
                fraction,
                proximity: Proximity { distance, gradient: JointConfig::new(gradient) },
            },
        )
    }

    proptest! {
        #[test]
        fn no_course_nearby_is_better_than_the_solution(
            course in prop::collection::vec(config(), WAYPOINTS + 2),
            near in prop::collection::vec(touch(), 0..20),
            trust in 0.02_f32..0.5,
            penalty in 1.0_f32..100.0,
            seed in 0..1000_u64,
        ) {
            let convex = Convex::new(&course, &near, SAFE_DISTANCE, penalty);
            let solved = convex.solve(&course, trust, &LIMITS, SWEEPS);
            prop_assert_eq!((solved[0], solved[WAYPOINTS + 1]), (course[0], course[WAYPOINTS + 1]));
            for (config, from) in solved.iter().zip(&course) {
                prop_assert!(config.max_joint_distance(from) <= trust + 1e-5);
            }
            let rng = &mut stream(seed, Stream::Planner, 0);
            for scale in [0.3, 0.1, 0.03, 0.01] {
                let mut other = solved.clone();
                for k in 1..=WAYPOINTS {
                    let moved = JointConfig::from_fn(DOF, |j| other[k][j] + scale * rng.random_range(-1.0_f32..1.0));
                    other[k] = clamped(&moved, &trusted(&course[k], trust, &LIMITS));
                }
                let slack = 1e-3 * (1.0 + convex.cost(&solved));
                prop_assert!(convex.cost(&solved) <= convex.cost(&other) + slack);
            }
        }

        #[test]
        fn the_model_is_the_cost_itself_where_it_was_made(
            course in prop::collection::vec(config(), WAYPOINTS + 2),
            near in prop::collection::vec(touch(), 0..20),
        ) {
            // Gaps at the ends do not depend on the waypoints and are left out.
            let near: Vec<Touch> = near.into_iter().filter(|touch| touch.edge < WAYPOINTS).collect();
            let convex = Convex::new(&course, &near, SAFE_DISTANCE, 10.0);
            let shortfalls: f32 = near.iter().map(|touch| touch.shortfall(SAFE_DISTANCE)).sum();
            let expected = energy(&course) + 10.0 * shortfalls;
            prop_assert!((convex.cost(&course) - expected).abs() < 1e-3 * (1.0 + expected));
        }
    }

    #[test]
    fn without_anything_near_and_enough_trust_the_solution_is_straight() {
        let at = |q: f32| JointConfig::new([q; DOF]);
        let bowed = [0.0, 0.5, 0.9, 0.4, 0.3].map(at);
        let solved =
            Convex::new(&bowed, &[], SAFE_DISTANCE, 1.0).solve(&bowed, 1.0, &LIMITS, SWEEPS);
        for (config, q) in solved.iter().zip([0.0, 0.075, 0.15, 0.225, 0.3]) {
            assert!(config.max_joint_distance(&at(q)) < 1e-4, "{config:?}");
        }
    }

    #[test]
    fn a_gap_that_is_short_pushes_the_course_until_it_is_not() {
        let at = |q: f32| JointConfig::new([q; DOF]);
        let straight = [0.0, 0.1, 0.2, 0.3, 0.4].map(at);
        let proximity = Proximity {
            distance: -0.01,
            gradient: JointConfig::new([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        };
        let near = [Touch { edge: 1, fraction: 1.0, proximity }];
        let moved = |penalty| {
            Convex::new(&straight, &near, SAFE_DISTANCE, penalty)
                .solve(&straight, 1.0, &LIMITS, SWEEPS)
        };
        let (light, heavy) = (moved(0.1), moved(100.0));
        let widened = |course: &[JointConfig]| 0.3 * (course[2][0] - straight[2][0]);
        assert!((widened(&heavy) - 0.03).abs() < 1e-4, "{}", widened(&heavy));
        assert!(widened(&light) > 0.0 && widened(&light) < 0.029, "{}", widened(&light));
    }
}
