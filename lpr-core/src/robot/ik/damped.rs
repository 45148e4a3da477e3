//! Inverse kinematics of any serial arm: damped least squares from many starts.
//!
//! Levenberg and Marquardt's method on the twist that is left, in metres and radians:
//! `dq = Jᵀ (J Jᵀ + λ²)⁻¹ e`, where `λ` shrinks with every step that helps and grows with every one
//! that does not. A joint at a limit that a step would cross is held there for that step. Where the
//! error stops shrinking, the next start is drawn.

use super::super::kinematics::Frames;
use super::super::{DOF, Joint, JointConfig, JointMotion, MAX_JOINTS, Robot};
use super::Distinct;
use super::closed_form::exact_pose;
use super::step::{DampedInverse, Twist, twist_between};
use crate::rng::Rng;
use core::f64::consts::TAU;
use glamx::{DPose3, DVec3, Pose3};
use rand::RngExt as _;

/// Largest distance of a solution's grip from the pose asked for, metres.
const MAX_DISTANCE: f64 = 1e-4;
/// Largest angle between both, radians.
const MAX_ANGLE: f64 = 1e-3;
/// Remaining error at which an attempt ends, metres and radians: well below what rounding to f32
/// adds.
const CONVERGED: f64 = 1e-9;
/// Steps of one attempt.
const MAX_STEPS: usize = 120;
/// Steps in which the squared error must halve.
const PATIENCE: usize = 10;
/// Attempts before a pose counts as out of reach.
const MIN_ATTEMPTS: usize = 60;
/// Further attempts for each solution that is asked for.
const ATTEMPTS_EACH: usize = 8;
/// Damping of the first step, and its bounds, in units of the Jacobian.
const FIRST_DAMPING: f64 = 0.1;
const MIN_DAMPING: f64 = 1e-6;
const MAX_DAMPING: f64 = 1e3;
/// Factors of the damping after a step that helped, and after one that did not.
const EASED: f64 = 0.3;
const STIFFENED: f64 = 3.0;

impl Robot {
    /// Up to `n_solutions` configurations within the limits whose grip is at `world_from_grip`, to
    /// 1e-4 m and 1e-3 rad.
    ///
    /// Any two differ by more than `min_distance` in some joint (radians modulo 2π, metres). The
    /// first attempt starts from `seed`, the others from draws; each solution takes the winding
    /// nearest `seed`. Empty when nothing was found, which is no proof that there is nothing: an
    /// arm of fewer than six joints reaches few poses.
    ///
    /// ```
    /// use lpr_core::rng::{Stream, stream};
    /// use lpr_core::robot::PANDA;
    ///
    /// let arm = PANDA.described();
    /// let world_from_grip = arm.grip(&PANDA.start);
    /// let found = arm.ik(&world_from_grip, &PANDA.start, 3, 0.2, &mut stream(0, Stream::Ik, 0));
    /// assert_eq!(found.len(), 3);
    /// assert!(found.iter().all(|config| arm.grip(config).translation.distance(world_from_grip.translation) < 1e-4));
    /// ```
    #[must_use]
    pub fn ik(
        &self,
        world_from_grip: &Pose3,
        seed: &JointConfig,
        n_solutions: usize,
        min_distance: f32,
        rng: &mut Rng,
    ) -> Vec<JointConfig> {
        let wanted = Distinct { solutions: Vec::new(), n: n_solutions, min_distance };
        // Sums over the joints are short where there are few.
        if self.dof() <= DOF {
            self.solve::<DOF>(world_from_grip, seed, wanted, rng)
        } else {
            self.solve::<MAX_JOINTS>(world_from_grip, seed, wanted, rng)
        }
    }

    /// The solutions of an arm of at most `N` joints.
    fn solve<const N: usize>(
        &self,
        world_from_grip: &Pose3,
        seed: &JointConfig,
        mut distinct: Distinct,
        rng: &mut Rng,
    ) -> Vec<JointConfig> {
        let n_solutions = distinct.n;
        let target = exact_pose(world_from_grip);
        if !(target.is_finite() && seed.is_finite()) {
            return distinct.solutions;
        }
        let seed = self.within(&widened::<N>(&self.inside(seed)));
        let mut start = seed;
        for attempt in 0..MIN_ATTEMPTS.saturating_add(ATTEMPTS_EACH.saturating_mul(n_solutions)) {
            let is_hopeless = attempt >= MIN_ATTEMPTS && distinct.solutions.is_empty();
            if distinct.solutions.len() >= n_solutions || is_hopeless {
                break;
            }
            if let Some(config) =
                self.descend(&target, start).and_then(|found| self.accepted(&found, &seed, &target))
            {
                distinct.offer(config);
            }
            start = self.drawn(rng);
        }
        distinct.solutions
    }

    /// The place where the error vanishes below `start`, if it does.
    fn descend<const N: usize>(&self, target: &DPose3, start: [f64; N]) -> Option<[f64; N]> {
        let mut at = Residual::new(self, target, start);
        let (mut damping, mut earlier) = (FIRST_DAMPING, f64::INFINITY);
        for step in 1..=MAX_STEPS {
            if at.error.iter().all(|part| part.abs() < CONVERGED) {
                break;
            }
            if step % PATIENCE == 0
                && core::mem::replace(&mut earlier, at.squared) < 2.0 * at.squared
            {
                break;
            }
            let next = Residual::new(self, target, self.step(&at, damping));
            if next.squared < at.squared {
                at = next;
                damping = (EASED * damping).max(MIN_DAMPING);
            } else {
                damping *= STIFFENED;
            }
            if damping > MAX_DAMPING {
                break;
            }
        }
        at.is_solved().then_some(at.positions)
    }

    /// The damped step from `at`, in which joints stay within their limits.
    fn step<const N: usize>(&self, at: &Residual<N>, damping: f64) -> [f64; N] {
        let mut jacobian = self.jacobian_of(&at.frames);
        // Each round holds at least one more joint.
        for _ in 0..=N {
            let change = DampedInverse::new(jacobian, damping).apply(&at.error);
            let proposed: [f64; N] = core::array::from_fn(|j| at.positions[j] + change[j]);
            let kept = self.within(&proposed);
            let is_stuck = |j: &usize| {
                change[*j] != 0.0 && proposed[*j] != kept[*j] && at.positions[*j] == kept[*j]
            };
            let stuck: Vec<usize> = (0..N).filter(is_stuck).collect();
            if stuck.is_empty() {
                return kept;
            }
            jacobian.iter_mut().for_each(|row| stuck.iter().for_each(|&j| row[j] = 0.0));
        }
        at.positions
    }

    /// The positions moved into the limits; 0 where there is no joint.
    fn within<const N: usize>(&self, positions: &[f64; N]) -> [f64; N] {
        let kept =
            |(joint, q): (&Joint, &f64)| q.clamp(f64::from(joint.lower), f64::from(joint.upper));
        let mut within = [0.0; N];
        let all = self.joints.iter().zip(positions).map(kept);
        within.iter_mut().zip(all).for_each(|(q, kept)| *q = kept);
        within
    }

    /// A start within the limits, of joints that turn at most one turn of them.
    fn drawn<const N: usize>(&self, rng: &mut Rng) -> [f64; N] {
        core::array::from_fn(|j| self.joints.get(j).map_or(0.0, |joint| joint.drawn(rng)))
    }

    /// The solution in f32 with the windings nearest `seed`, if its grip is where it should be.
    fn accepted<const N: usize>(
        &self,
        found: &[f64; N],
        seed: &[f64; N],
        target: &DPose3,
    ) -> Option<JointConfig> {
        let config =
            JointConfig::from_fn(self.dof(), |j| self.joints[j].wound(found[j], seed[j]) as f32);
        Residual::new(self, target, widened::<N>(&config)).is_solved().then_some(config)
    }
}

impl Joint {
    fn drawn(&self, rng: &mut Rng) -> f64 {
        let (lower, upper) = (f64::from(self.lower), f64::from(self.upper));
        let fraction = rng.random::<f64>();
        if self.motion == JointMotion::Turn && upper - lower > TAU {
            return (TAU * (fraction - 0.5)).clamp(lower, upper);
        }
        lower + fraction * (upper - lower)
    }

    /// The position that differs from `q` by whole turns and is nearest `near` within the limits.
    fn wound(&self, q: f64, near: f64) -> f64 {
        let (lower, upper) = (f64::from(self.lower), f64::from(self.upper));
        if self.motion == JointMotion::Slide {
            return q;
        }
        let turns = libm::round((near - q) / TAU);
        let (fewest, most) = (libm::ceil((lower - q) / TAU), libm::floor((upper - q) / TAU));
        // `q` is within the limits: no turn is between both.
        q + TAU * turns.clamp(fewest.min(0.0), most.max(0.0))
    }
}

/// The difference that is left between the grip and the target, of an arm of at most `N` joints.
struct Residual<const N: usize> {
    positions: [f64; N],
    frames: Frames<N>,
    error: Twist,
    squared: f64,
}

impl<const N: usize> Residual<N> {
    fn new(robot: &Robot, target: &DPose3, positions: [f64; N]) -> Self {
        let frames = robot.frames_at(&positions);
        let error =
            twist_between(&(frames.tip * robot.body_from_flange * robot.flange_from_grip), target);
        Self { positions, frames, squared: error.iter().map(|part| part * part).sum(), error }
    }

    fn is_solved(&self) -> bool {
        let [x, y, z, around_x, around_y, around_z] = self.error;
        let is_below = |v: DVec3, most: f64| v.dot(v) < most * most;
        is_below(DVec3::new(x, y, z), MAX_DISTANCE)
            && is_below(DVec3::new(around_x, around_y, around_z), MAX_ANGLE)
    }
}

/// Positions of the first `N` joints in f64; 0 where there is no joint.
fn widened<const N: usize>(config: &JointConfig) -> [f64; N] {
    config.to_array::<N>().map(f64::from)
}

#[cfg(test)]
mod tests;
