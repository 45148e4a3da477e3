//! Inverse kinematics of the grip: the closed form at a fixed `q7`, and what is built on scanning
//! `q7`.
//!
//! Solves in f64. A returned configuration is within the limits; its grip pose differs from the one
//! asked for by rounding to f32 only (below 1e-4 m and 1e-3 rad). Poses are `world_from_grip`. A
//! joint with limits beyond a turn takes the winding nearest the reference configuration `near`.

mod closed_form;
mod damped;
mod step;

pub use closed_form::IkBranches;
pub use step::MAX_STEP_CHANGE;

use super::{DOF, Joint, JointConfig, JointMotion, Robot};
use crate::rng::{Rng, Stream, stream};
use closed_form::{Angles, Target, rounded, widened};
use core::f64::consts::{PI, TAU};
use glamx::Pose3;
use rand::RngExt as _;

/// Spacing of `q7` in the search for the nearest solution, radians.
const SCAN_SPACING: f64 = 0.05;
/// Bisections around the best sample of `q7`: 0.05 rad down to 1e-6 rad.
const REFINEMENTS: usize = 16;
/// Samples of `q7` for distinct solutions; a power of two.
const DISTINCT_SAMPLES: usize = 64;
/// Samples of `q7` when [`DISTINCT_SAMPLES`] found nothing: intervals of a few hundredths of a
/// radian are found.
const RARE_SAMPLES: usize = 512;
/// Samples of `q7`, near others with solutions, when those found too few.
const FINEST_SAMPLES: usize = 4096;

impl Robot {
    /// True if the closed form serves the arm: seven joints by modified-DH rows.
    pub(crate) fn has_closed_form(&self) -> bool {
        closed_form::serves(self)
    }

    /// All solutions with that last joint angle: at most eight, and none of an arm without a closed
    /// form.
    ///
    /// ```
    /// use lpr_core::robot::PANDA;
    ///
    /// let world_from_grip = PANDA.grip(&PANDA.start);
    /// let branches = PANDA.ik_all_at(&world_from_grip, f64::from(PANDA.start[6]), &PANDA.start);
    /// assert!((1..=8).contains(&branches.len()));
    /// assert!(branches.iter().any(|config| config.max_joint_distance(&PANDA.start) < 1e-3), "the start is one of them");
    /// assert!(branches.iter().all(|config| PANDA.grip(&config).translation.distance(world_from_grip.translation) < 1e-4));
    /// ```
    #[must_use]
    pub fn ik_all_at(&self, world_from_grip: &Pose3, q7: f64, near: &JointConfig) -> IkBranches {
        Target::new(self, world_from_grip)
            .map_or(IkBranches::EMPTY, |target| target.solve(q7, &widened(near)))
    }

    /// The solution nearest `near` in joint space; of an arm without a closed form, the one that
    /// the search from `near` finds first.
    ///
    /// `None` when the pose is out of reach within the limits:
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Quat, Vec3};
    /// use lpr_core::robot::XARM7;
    ///
    /// let pointing_down = Quat::from_rotation_x(core::f32::consts::PI);
    /// let at = |x: f32| Pose3::from_parts(Vec3::new(x, 0.1, 0.2), pointing_down);
    /// let config = XARM7.ik_nearest(&at(0.4), &XARM7.start).unwrap();
    /// assert!(XARM7.grip(&config).translation.distance(at(0.4).translation) < 1e-4);
    /// assert_eq!(XARM7.ik_nearest(&at(2.0), &XARM7.start), None);
    /// ```
    #[must_use]
    pub fn ik_nearest(&self, world_from_grip: &Pose3, near: &JointConfig) -> Option<JointConfig> {
        let Some(target) = Target::new(self, world_from_grip) else {
            let rng = &mut stream(0, Stream::Ik, 0);
            return self.ik(world_from_grip, near, 1, 0.0, rng).into_iter().next();
        };
        let near = widened(&self.inside(near));
        let mut best = self
            .scan(&target, &near, SCAN_SPACING)
            .or_else(|| self.scan(&target, &near, 0.1 * SCAN_SPACING))?;
        let mut spacing = 0.5 * SCAN_SPACING;
        for _ in 0..REFINEMENTS {
            let q7 = best.angles[6];
            for q7 in [q7 - spacing, q7 + spacing] {
                best.improve(&target, q7, &near);
            }
            spacing *= 0.5;
        }
        Some(rounded(&best.angles))
    }

    /// The configuration with every joint within its limits: one that is beyond turns by whole turns
    /// if that leads inside, else it is moved onto the limit.
    pub(super) fn inside(&self, config: &JointConfig) -> JointConfig {
        JointConfig::from_fn(config.dof(), |j| match self.joints.get(j) {
            Some(joint) => joint.inside(config[j]),
            None => config[j],
        })
    }

    /// The best solution on a grid of `q7`, from `near` outwards until `q7` alone is further away
    /// than the best.
    fn scan(&self, target: &Target<'_>, near: &Angles, spacing: f64) -> Option<Nearest> {
        let joint = &self.joints[DOF - 1];
        let range = f64::from(joint.upper - joint.lower).min(TAU * 2.0);
        let n_steps = (range / spacing) as i32 + 1;
        let mut best = Nearest { angles: *near, squared_distance: f64::INFINITY };
        for step in 0..=n_steps {
            let offset = f64::from(step) * spacing;
            if offset * offset > best.squared_distance {
                break;
            }
            best.improve(target, near[6] + offset, near);
            best.improve(target, near[6] - offset, near);
        }
        best.squared_distance.is_finite().then_some(best)
    }

    /// Up to `n` solutions, of which any two differ by more than `min_distance` radians (modulo 2π)
    /// in some joint, spread over the redundancy; of each the winding nearest `near`.
    ///
    /// An arm without a closed form searches as in [`Robot::ik`]. Where few are found, `q7` is
    /// sampled ever more finely around those that have solutions.
    ///
    /// ```
    /// use lpr_core::rng::{Stream, stream};
    /// use lpr_core::robot::XARM7;
    ///
    /// let goal = XARM7.grip(&XARM7.start);
    /// let configs = XARM7.ik_distinct(&goal, 20, 0.2, &XARM7.start, &mut stream(0, Stream::Ik, 0));
    /// assert_eq!(configs.len(), 20);
    /// assert!(configs[0].max_joint_distance(&configs[1]) > 0.2);
    /// assert!(configs.iter().all(|config| XARM7.within_limits(config)));
    /// ```
    #[must_use]
    pub fn ik_distinct(
        &self,
        world_from_grip: &Pose3,
        n: usize,
        min_distance: f32,
        near: &JointConfig,
        rng: &mut Rng,
    ) -> Vec<JointConfig> {
        let Some(target) = Target::new(self, world_from_grip) else {
            return self.ik(world_from_grip, near, n, min_distance, rng);
        };
        let near = widened(&self.inside(near));
        let offset = rng.random::<f64>();
        let solve = |fraction: f64| target.solve(self.q7_sample(offset + fraction), &near);
        let mut distinct =
            Distinct { solutions: Vec::with_capacity(n.min(DISTINCT_SAMPLES)), n, min_distance };
        let mut has_solutions = vec![false; DISTINCT_SAMPLES];
        let mut others = Vec::new();
        for sample in (0..DISTINCT_SAMPLES).map(scattered) {
            if distinct.is_full() {
                return distinct.solutions;
            }
            let branches = solve(sample as f64 / DISTINCT_SAMPLES as f64);
            if branches.is_empty() {
                continue;
            }
            has_solutions[sample] = true;
            // Two branches of each q7 first, as far apart in their order as can be: few solutions
            // already cover many q7.
            let n_branches = branches.len();
            let first = rng.random_range(0..n_branches);
            let chosen = [first, (first + n_branches / 2) % n_branches];
            for (i, config) in branches.iter().enumerate() {
                if chosen.contains(&i) { distinct.offer(config) } else { others.push(config) }
            }
        }
        others.into_iter().for_each(|config| distinct.offer(config));
        let mut all: Vec<JointConfig> = Vec::new();
        while !distinct.is_full() && may_be_refined(&has_solutions) {
            has_solutions = refined(&has_solutions, |fraction| {
                let branches = solve(fraction);
                all.extend(branches.iter());
                branches.iter().for_each(|config| distinct.offer(config));
                !branches.is_empty()
            });
        }
        if distinct.is_full() { distinct.solutions } else { packed(all, distinct) }
    }

    /// `q7` at a fraction (its integer part is ignored) of its range, at most one turn of it.
    fn q7_sample(&self, fraction: f64) -> f64 {
        let joint = &self.joints[DOF - 1];
        let (lower, upper) = (f64::from(joint.lower), f64::from(joint.upper));
        let (first, range) = if upper - lower > TAU { (-PI, TAU) } else { (lower, upper - lower) };
        first + range * (fraction - libm::floor(fraction))
    }
}

impl Joint {
    /// The position that is as `q` and within the limits, or the limit that is nearest.
    fn inside(&self, q: f32) -> f32 {
        /// An arm may stand a little beyond its limit, radians: it is to come back, and not to turn.
        const BEYOND: f32 = 0.1;
        let onto = q.max(self.lower).min(self.upper);
        if self.motion == JointMotion::Slide || (q - onto).abs() <= BEYOND {
            return onto;
        }
        let turns = libm::ceil((f64::from(onto) - f64::from(q)).abs() / TAU);
        let turned = (f64::from(q) + (TAU * turns).copysign(f64::from(onto - q))) as f32;
        if self.lower <= turned && turned <= self.upper { turned } else { onto }
    }
}

/// The solution nearest a reference so far.
struct Nearest {
    angles: Angles,
    squared_distance: f64,
}

impl Nearest {
    fn improve(&mut self, target: &Target<'_>, q7: f64, near: &Angles) {
        for angles in target.solve(q7, near).angles() {
            let squared_distance = angles.iter().zip(near).map(|(a, b)| (a - b) * (a - b)).sum();
            if squared_distance < self.squared_distance {
                *self = Self { angles: *angles, squared_distance };
            }
        }
    }
}

/// Solutions of which any two differ.
struct Distinct {
    solutions: Vec<JointConfig>,
    n: usize,
    min_distance: f32,
}

impl Distinct {
    const fn is_full(&self) -> bool {
        self.solutions.len() >= self.n
    }

    fn offer(&mut self, config: JointConfig) {
        if !self.is_full()
            && self.solutions.iter().all(|other| differ(&config, other, self.min_distance))
        {
            self.solutions.push(config);
        }
    }
}

/// The solutions in order of `q7`, as close together as they may be, if they are more than the
/// `scattered` ones.
fn packed(mut all: Vec<JointConfig>, scattered: Distinct) -> Vec<JointConfig> {
    all.sort_by(|a, b| a[DOF - 1].total_cmp(&b[DOF - 1]));
    let mut packed = Distinct { solutions: Vec::new(), ..scattered };
    all.into_iter().for_each(|config| packed.offer(config));
    if packed.solutions.len() > scattered.solutions.len() {
        packed.solutions
    } else {
        scattered.solutions
    }
}

/// True if some joint differs by more than `min_distance` radians modulo 2π; no joint has more than
/// two turns.
fn differ(a: &JointConfig, b: &JointConfig, min_distance: f32) -> bool {
    const TURN: f32 = core::f32::consts::TAU;
    a.iter().zip(b.iter()).any(|(a, b)| {
        let difference = (a - b).abs();
        [0.0, TURN, 2.0 * TURN].iter().all(|turns| (difference - turns).abs() > min_distance)
    })
}

/// The samples in an order in which the first few already cover the range: the halves, the quarters
/// and so on.
const fn scattered(i: usize) -> usize {
    i.reverse_bits() >> (usize::BITS - DISTINCT_SAMPLES.ilog2())
}

/// True if a finer grid is worth it: one without any solution is given up earlier.
fn may_be_refined(has_solutions: &[bool]) -> bool {
    has_solutions.len() < if has_solutions.contains(&true) { FINEST_SAMPLES } else { RARE_SAMPLES }
}

/// The grid of twice as many samples: those in the middle between two of which one has solutions
/// are asked for, or all of them as long as none has.
fn refined(has_solutions: &[bool], mut solve: impl FnMut(f64) -> bool) -> Vec<bool> {
    let n = has_solutions.len();
    let is_blind = !has_solutions.contains(&true);
    let nexts = has_solutions.iter().cycle().skip(1);
    let mut finer = Vec::with_capacity(2 * n);
    for (sample, (&here, &next)) in has_solutions.iter().zip(nexts).enumerate() {
        let middle = (is_blind || here || next) && solve((sample as f64 + 0.5) / n as f64);
        finer.extend([here, middle]);
    }
    finer
}

#[cfg(test)]
mod tests;
