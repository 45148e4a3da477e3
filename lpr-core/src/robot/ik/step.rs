//! The continuous solution for a small motion of the grip.

use super::super::joint::TwistedRow;
use super::super::kinematics::Frames;
use super::super::{DOF, DhRow, Joint, JointConfig, MAX_JOINTS, Robot};
use super::closed_form::{Angles, Target, exact_pose, rounded, within_range};
use arrayvec::ArrayVec;
use glamx::{DPose3, DVec3, Pose3};

/// Largest change of a joint that still counts as continuous, radians.
pub const MAX_STEP_CHANGE: f64 = 0.5;
/// Newton iterations before the closed form takes over; three are enough for steps of centimetres.
const MAX_NEWTON: usize = 8;
/// Remaining error at which the solution is exact, metres and radians.
const CONVERGED: f64 = 1e-9;
/// Damping of the pseudo-inverse, in units of the Jacobian; small, so that convergence stays
/// superlinear.
const DAMPING: f64 = 1e-3;
/// Distance from a limit at which the null-space pull begins, radians.
const PULL_ZONE: f64 = 1.2;
/// Spacing of `q7` when the closed form searches, radians.
const SEARCH_SPACING: f64 = 0.02;

/// A velocity of the grip: metres, then radians.
pub(super) type Twist = [f64; 6];

impl Robot {
    /// The configuration that continues `near` to a grip pose a small motion away.
    ///
    /// Newton's method with a null-space pull away from the limits, in proportion to the motion;
    /// where it fails, the closed form at `q7` around the one it proposed. `None` when a joint
    /// would change by more than [`MAX_STEP_CHANGE`] or leave its limits: the branch never changes
    /// silently.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::robot::XARM7;
    ///
    /// let mut pose = XARM7.grip(&XARM7.start);
    /// pose.translation += Vec3::new(0.01, 0.0, 0.0);
    /// let next = XARM7.ik_step(&pose, &XARM7.start).unwrap();
    /// assert!(next.max_joint_distance(&XARM7.start) < 0.1, "a centimetre is a small motion");
    ///
    /// pose.translation += Vec3::new(1.0, 0.0, 0.0);
    /// assert_eq!(XARM7.ik_step(&pose, &next), None, "a metre is not");
    /// ```
    #[must_use]
    pub fn ik_step(&self, world_from_grip: &Pose3, near: &JointConfig) -> Option<JointConfig> {
        let Some(rows) = self.twisted_rows() else {
            return if self.dof() <= DOF {
                self.newton_step::<DOF>(world_from_grip, near, |q| self.frames_at(q)).ok()
            } else {
                self.newton_step::<MAX_JOINTS>(world_from_grip, near, |q| self.frames_at(q)).ok()
            };
        };
        self.newton_step(world_from_grip, near, |angles| frames_of(&rows, angles)).map_or_else(
            |first| {
                let start = near.to_array::<DOF>().map(f64::from);
                let target = Target::new(self, world_from_grip)?;
                self.search_q7(&target, first[DOF - 1], &start).map(|angles| rounded(&angles))
            },
            Some,
        )
    }

    /// The rows of an arm of seven joints by modified-DH rows.
    fn twisted_rows(&self) -> Option<[TwistedRow; DOF]> {
        if !self.followers.is_empty() {
            return None;
        }
        let rows: ArrayVec<_, MAX_JOINTS> =
            self.joints.iter().map_while(|joint| joint.dh().map(DhRow::twisted)).collect();
        rows[..].try_into().ok()
    }

    /// The continuous solution of an arm of at most `N` joints by Newton's method, else the
    /// positions after its first, linear step. `frames_at` gives the bodies' frames.
    fn newton_step<const N: usize>(
        &self,
        world_from_grip: &Pose3,
        near: &JointConfig,
        frames_at: impl Fn(&[f64; N]) -> Frames<N>,
    ) -> Result<JointConfig, [f64; N]> {
        let start = near.to_array::<N>().map(f64::from);
        let newton = self.newton(&exact_pose(world_from_grip), &start, frames_at);
        if !(newton.converged && self.continues(&newton.angles, &start)) {
            return Err(newton.first);
        }
        Ok(JointConfig::from_fn(self.dof(), |j| {
            newton.angles[j].clamp(lower(self, j), upper(self, j)) as f32
        }))
    }

    fn continues<const N: usize>(&self, angles: &[f64; N], start: &[f64; N]) -> bool {
        angles.iter().zip(start).zip(&self.joints).all(|((&q, &from), joint)| {
            (q - from).abs() <= MAX_STEP_CHANGE
                && within_range((joint.lower, joint.upper), q).is_some()
        })
    }

    fn newton<const N: usize>(
        &self,
        target: &DPose3,
        start: &[f64; N],
        frames_at: impl Fn(&[f64; N]) -> Frames<N>,
    ) -> Newton<N> {
        let mut newton = Newton { angles: *start, first: *start, converged: false };
        for iteration in 0..MAX_NEWTON {
            let frames = frames_at(&newton.angles);
            let grip = frames.tip * self.body_from_flange * self.flange_from_grip;
            let error = twist_between(&grip, target);
            if error.iter().all(|part| part.abs() < CONVERGED) {
                newton.converged = true;
                return newton;
            }
            let inverse = DampedInverse::new(self.jacobian_of(&frames), DAMPING);
            let mut change = inverse.apply(&error);
            if iteration == 0 {
                self.add_pull(&inverse, &newton.angles, &mut change);
            }
            newton.angles = core::array::from_fn(|j| newton.angles[j] + change[j]);
            if iteration == 0 {
                newton.first = newton.angles;
            }
        }
        newton
    }

    /// Adds motion within the null space, away from limits that are nearer than [`PULL_ZONE`], no
    /// faster than `change` itself.
    fn add_pull<const N: usize>(
        &self,
        inverse: &DampedInverse<N>,
        angles: &[f64; N],
        change: &mut [f64; N],
    ) {
        let speed = libm::sqrt(change.iter().map(|d| d * d).sum());
        let wish: [f64; N] = core::array::from_fn(|j| {
            self.joints.get(j).map_or(0.0, |joint| speed * repulsion(joint, angles[j]))
        });
        let felt = inverse.apply(&inverse.twist(&wish));
        for j in 0..N {
            change[j] += wish[j] - felt[j];
        }
    }

    /// The continuous solution whose `q7` is nearest `around`.
    fn search_q7(&self, target: &Target<'_>, around: f64, start: &Angles) -> Option<Angles> {
        let around = around.clamp(start[6] - MAX_STEP_CHANGE, start[6] + MAX_STEP_CHANGE);
        let n_offsets = (2.0 * MAX_STEP_CHANGE / SEARCH_SPACING) as i32;
        (0..=n_offsets)
            .flat_map(|i| [i, -i])
            .map(|i| around + f64::from(i) * SEARCH_SPACING)
            .find_map(|q7| {
                let branches = target.solve(q7, start);
                let nearest = branches
                    .angles()
                    .iter()
                    .min_by(|a, b| max_change(a, start).total_cmp(&max_change(b, start)));
                nearest.copied().filter(|angles| max_change(angles, start) <= MAX_STEP_CHANGE)
            })
    }
}

/// Result of Newton's method.
struct Newton<const N: usize> {
    angles: [f64; N],
    /// After the first, linear step.
    first: [f64; N],
    converged: bool,
}

/// `world_from_body` of what seven joints carry. Their rows are at hand: a joint that is asked for its
/// kind at every iteration costs a tenth of a curve.
fn frames_of(rows: &[TwistedRow; DOF], angles: &Angles) -> Frames<DOF> {
    let mut world_from_body = DPose3::IDENTITY;
    Frames::of_joints(core::array::from_fn(|j| {
        world_from_body *= rows[j].transform(angles[j]);
        world_from_body
    }))
}

fn lower(robot: &Robot, j: usize) -> f64 {
    f64::from(robot.joints[j].lower)
}

fn upper(robot: &Robot, j: usize) -> f64 {
    f64::from(robot.joints[j].upper)
}

fn max_change(angles: &Angles, from: &Angles) -> f64 {
    angles.iter().zip(from).fold(0.0, |most, (a, b)| (a - b).abs().max(most))
}

/// Away from the limits: 0 in the middle, ±1 at a limit.
fn repulsion(joint: &Joint, q: f64) -> f64 {
    let push = |margin: f64| {
        let depth = (1.0 - margin / PULL_ZONE).clamp(0.0, 1.0);
        depth * depth
    };
    push(q - f64::from(joint.lower)) - push(f64::from(joint.upper) - q)
}

/// The twist that takes one pose to the other in unit time.
pub(super) fn twist_between(from: &DPose3, to: &DPose3) -> Twist {
    let linear = to.translation - from.translation;
    let turn = to.rotation * from.rotation.inverse();
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let axis = DVec3::new(turn.x, turn.y, turn.z);
    let sine = axis.length();
    let angular =
        if sine > 1e-12 { axis * (2.0 * libm::atan2(sine, turn.w) / sine) } else { axis * 2.0 };
    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
}

/// `Jᵀ (J Jᵀ + λ²)⁻¹` of `N` joints with its Cholesky factor.
pub(super) struct DampedInverse<const N: usize> {
    jacobian: [[f64; N]; 6],
    factor: [[f64; 6]; 6],
}

impl<const N: usize> DampedInverse<N> {
    /// With the damping `λ`, in units of the Jacobian.
    pub(super) fn new(jacobian: [[f64; N]; 6], damping: f64) -> Self {
        let mut factor = [[0.0; 6]; 6];
        for row in 0..6 {
            for col in 0..=row {
                let gram: f64 = jacobian[row].iter().zip(&jacobian[col]).map(|(a, b)| a * b).sum();
                let known: f64 = (0..col).map(|k| factor[row][k] * factor[col][k]).sum();
                factor[row][col] = if row == col {
                    libm::sqrt((gram + damping * damping - known).max(damping * damping))
                } else {
                    (gram - known) / factor[col][col]
                };
            }
        }
        Self { jacobian, factor }
    }

    /// The twist of joint velocities.
    fn twist(&self, velocities: &[f64; N]) -> Twist {
        self.jacobian.map(|row| row.iter().zip(velocities).map(|(a, b)| a * b).sum())
    }

    /// The smallest joint velocities with that twist.
    pub(super) fn apply(&self, twist: &Twist) -> [f64; N] {
        let mut y = *twist;
        for row in 0..6 {
            let known: f64 = (0..row).map(|k| self.factor[row][k] * y[k]).sum();
            y[row] = (y[row] - known) / self.factor[row][row];
        }
        for row in (0..6).rev() {
            let known: f64 = (row + 1..6).map(|k| self.factor[k][row] * y[k]).sum();
            y[row] = (y[row] - known) / self.factor[row][row];
        }
        core::array::from_fn(|j| (0..6).map(|row| self.jacobian[row][j] * y[row]).sum())
    }
}
