//! Speed of the grip along the curve.
//!
//! Its velocity by the chord length, `p' = J(q) q'`, is interpolated on every interval by the
//! parabola through three of its values. What the parabola misses is at most `h³ / (72 √3)` times a
//! bound to `p''''`, and that follows from the arm's reach `L`: no partial derivative of the grip's
//! position by angles, of any order, is longer than `L`, and none by the way of a sliding joint
//! longer than 1, so that with the larger of the two as `L` by Faà di Bruno's formula
//! `|p''''| ≤ L (w₁⁴ + 6 w₁² w₂ + 3 w₂² + 4 w₁ w₃)`, where `w_k` is the sum of the joints' `k`-th
//! derivatives.

use super::grid::Interval;
use super::grip_bound::GripBound;
use super::spline::{Piece, SmoothPath};
use crate::path::timing::motion_limits::GripSpeedLimit;
use crate::robot::{DhRow, Joint, JointMotion, JointOrigin, MAX_JOINTS, Move, Robot};
use arrayvec::ArrayVec;
use glamx::{DPose3, DVec3};

/// Largest error of a parabola through both ends and the middle of an interval, per third
/// derivative and cubed width: `1 / (72 √3)`.
const PARABOLA_ERROR: f64 = 0.008_018_753_738_744_8;

/// Error of a parabola, as a share of the speed, that costs next to nothing.
const ENOUGH: f64 = 0.01;

/// Times that an interval is halved at most until its parabolas are as good as that.
const HALVINGS: usize = 3;

/// Sets the bounds of all `intervals` of `path`.
pub(super) fn limit_grip<const N: usize>(
    path: &SmoothPath<N>,
    intervals: &mut [Interval],
    limit: &GripSpeedLimit<'_>,
) {
    let arm = Arm::of(limit.robot);
    let scale = 1.0 / (limit.max_speed * limit.max_speed);
    // The velocity at the end of one interval is that at the start of the next: the curve's first
    // derivative is continuous.
    let mut start = arm.velocity_on(&path.piece(0), 0.0);
    for interval in intervals {
        let piece = path.piece(interval.piece);
        let end = arm.velocity_on(&piece, interval.end());
        let squares = arm.squares(
            &piece,
            &Stretch { offset: interval.offset, width: interval.width, start, end },
            HALVINGS,
        );
        interval.grip = GripBound(squares.map(|square| square * scale));
        start = end;
    }
}

/// A part of a piece, and the grip's velocities by the chord length at its ends, m/rad.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    offset: f64,
    width: f64,
    start: DVec3,
    end: DVec3,
}

/// The parts of a robot that decide how its grip moves.
#[derive(Debug)]
pub(super) struct Arm {
    /// Rows with sine and cosine of their twists, of an arm that has nothing else.
    rows: ArrayVec<(DhRow, (f64, f64)), MAX_JOINTS>,
    /// From the base to the grip, each with the index of the joint that moves it.
    joints: ArrayVec<(usize, ArmJoint), { 2 * MAX_JOINTS }>,
    /// The grip in the frame of the last body, metres.
    grip: DVec3,
    /// Bound to the partial derivatives of the grip's position, within the limits of the joints.
    reach: f64,
}

/// A joint, and how it is placed on the body before it.
#[derive(Debug)]
enum ArmJoint {
    /// By a row, with sine and cosine of its twist.
    Row(DhRow, (f64, f64)),
    Fixed(DPose3, JointMotion),
    /// A joint that follows the other, with multiplier and offset.
    Follower(DPose3, JointMotion, f64, f64),
}

impl Arm {
    pub(super) fn of(robot: &Robot) -> Self {
        let joint = |step: &Move<'_>| match (step.follower, &robot.joints[step.joint]) {
            (Some(it), _) => {
                ArmJoint::Follower(it.parent_from_joint, it.motion, it.multiplier, it.offset)
            }
            (None, Joint { origin: JointOrigin::ModifiedDh(row), .. }) => {
                ArmJoint::Row(*row, libm::sincos(row.alpha))
            }
            (None, Joint { origin: JointOrigin::Fixed(parent_from_joint), motion, .. }) => {
                ArmJoint::Fixed(*parent_from_joint, *motion)
            }
        };
        let moves = robot.moves();
        let in_chain = moves.iter().filter(|step| step.is_in_chain);
        let joints: ArrayVec<_, { 2 * MAX_JOINTS }> =
            in_chain.map(|step| (step.joint, joint(step))).collect();
        let row = |(_, joint): &(usize, ArmJoint)| match joint {
            ArmJoint::Row(row, twist) => Some((*row, *twist)),
            ArmJoint::Fixed(..) | ArmJoint::Follower(..) => None,
        };
        let rows: Option<ArrayVec<_, MAX_JOINTS>> = joints.iter().map(row).collect();
        Self {
            rows: rows.unwrap_or_default(),
            joints,
            grip: robot.body_from_flange.transform_point(robot.flange_from_grip.translation),
            reach: reach(robot),
        }
    }

    /// Velocity of the grip, m/s, at angles (rad) that change at `rates` (rad/s): its position and
    /// velocity in the frame of one joint after the other, down to the base.
    pub(super) fn velocity<const N: usize>(&self, angles: &[f64; N], rates: &[f64; N]) -> DVec3 {
        if !self.rows.is_empty() {
            return self.velocity_by_rows(angles, rates);
        }
        let (mut at, mut velocity) = (self.grip, DVec3::ZERO);
        for (j, joint) in self.joints.iter().rev() {
            let (q, rate) = (angles[*j], rates[*j]);
            match joint {
                ArmJoint::Row(row, twist) => {
                    let turn = libm::sincos(q);
                    at = turned_about_z(DVec3::new(at.x, at.y, at.z + row.d), turn);
                    velocity = turned_about_z(velocity, turn) + rate * across(at);
                    at = turned_about_x(DVec3::new(at.x + row.a, at.y, at.z), *twist);
                    velocity = turned_about_x(velocity, *twist);
                }
                ArmJoint::Fixed(parent_from_joint, motion) => {
                    moved(&mut at, &mut velocity, *motion, (q, rate));
                    at = parent_from_joint.transform_point(at);
                    velocity = parent_from_joint.rotation * velocity;
                }
                ArmJoint::Follower(parent_from_joint, motion, multiplier, offset) => {
                    let position = (multiplier * q + offset, multiplier * rate);
                    moved(&mut at, &mut velocity, *motion, position);
                    at = parent_from_joint.transform_point(at);
                    velocity = parent_from_joint.rotation * velocity;
                }
            }
        }
        velocity
    }

    /// The same for an arm of rows alone: without a look at the kind of each joint.
    fn velocity_by_rows<const N: usize>(&self, angles: &[f64; N], rates: &[f64; N]) -> DVec3 {
        let (mut at, mut velocity) = (self.grip, DVec3::ZERO);
        for (j, (row, twist)) in self.rows.iter().enumerate().rev() {
            let turn = libm::sincos(angles[j]);
            at = turned_about_z(DVec3::new(at.x, at.y, at.z + row.d), turn);
            velocity = turned_about_z(velocity, turn) + rates[j] * across(at);
            at = turned_about_x(DVec3::new(at.x + row.a, at.y, at.z), *twist);
            velocity = turned_about_x(velocity, *twist);
        }
        velocity
    }

    /// Velocity of the grip by the chord length at `offset` of a piece, m/rad.
    fn velocity_on<const N: usize>(&self, piece: &Piece<N>, offset: f64) -> DVec3 {
        self.velocity(&piece.angles(offset), &piece.first(offset))
    }

    /// Bernstein coefficients (degree 4) of a bound to the square of the grip's speed by the chord
    /// length. Where a parabola says too little, one for both halves.
    fn squares<const N: usize>(
        &self,
        piece: &Piece<N>,
        stretch: &Stretch,
        halvings: usize,
    ) -> [f64; 5] {
        let Stretch { offset, width, start, end } = *stretch;
        let half = 0.5 * width;
        let middle = self.velocity_on(piece, offset + half);
        let points = [start, 2.0 * middle - 0.5 * (start + end), end];
        let longest =
            libm::sqrt(points.into_iter().map(|point| point.dot(point)).fold(0.0, f64::max));
        let error = PARABOLA_ERROR * width * width * width * self.reach * growth(piece, stretch);
        if halvings == 0 || error <= ENOUGH * longest {
            return squared(points, (2.0 * longest + error) * error);
        }
        let first =
            self.squares(piece, &Stretch { width: half, end: middle, ..*stretch }, halvings - 1);
        let second = self.squares(
            piece,
            &Stretch { offset: offset + half, width: half, start: middle, end },
            halvings - 1,
        );
        [first.into_iter().chain(second).fold(0.0, f64::max); 5]
    }
}

/// A point and its velocity as the frame sees them in which a joint moves, at position `q` and rate
/// `rate`.
fn moved(at: &mut DVec3, velocity: &mut DVec3, motion: JointMotion, (q, rate): (f64, f64)) {
    match motion {
        JointMotion::Turn => {
            let turn = libm::sincos(q);
            *at = turned_about_z(*at, turn);
            *velocity = turned_about_z(*velocity, turn) + rate * across(*at);
        }
        JointMotion::Slide => {
            at.z += q;
            velocity.z += rate;
        }
    }
}

/// Velocity of a point that turns about z at 1 rad/s.
const fn across(at: DVec3) -> DVec3 {
    DVec3::new(-at.y, at.x, 0.0)
}

fn turned_about_z(v: DVec3, (sin, cos): (f64, f64)) -> DVec3 {
    DVec3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
}

fn turned_about_x(v: DVec3, (sin, cos): (f64, f64)) -> DVec3 {
    DVec3::new(v.x, cos * v.y - sin * v.z, sin * v.y + cos * v.z)
}

/// Bernstein coefficients of the square of a parabola with control points `points`, and `more`.
fn squared([a, b, c]: [DVec3; 3], more: f64) -> [f64; 5] {
    [a.dot(a), a.dot(b), (2.0 * b.dot(b) + a.dot(c)) / 3.0, b.dot(c), c.dot(c)]
        .map(|square| square + more)
}

/// The factor of the reach in the bound to `p''''`, 1/rad⁴.
fn growth<const N: usize>(piece: &Piece<N>, stretch: &Stretch) -> f64 {
    let sum = |a: &[f64; N], b: &[f64; N]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.abs().max(b.abs())).sum()
    };
    let (second, second_at_end) =
        (piece.second(stretch.offset), piece.second(stretch.offset + stretch.width));
    let bends = sum(&second, &second_at_end);
    // A derivative moves over an interval by no more than its own derivative allows.
    let slopes = sum(&piece.first(stretch.offset), &[0.0; N]) + stretch.width * bends;
    let thirds = sum(piece.third(), piece.third());
    let slopes_squared = slopes * slopes;
    slopes_squared * slopes_squared
        + 6.0 * slopes_squared * bends
        + 3.0 * bends * bends
        + 4.0 * slopes * thirds
}

/// Links stretched out, metres; at least 1 if a joint slides. Where joints follow others, a joint moves
/// the grip by several ways at once, and each of four derivatives counts all of them.
fn reach(robot: &Robot) -> f64 {
    let length = |v: DVec3| libm::sqrt(v.dot(v));
    let slides = |joint: &Joint| joint.motion == JointMotion::Slide;
    let way = |q: (f32, f32)| f64::from(q.0.abs().max(q.1.abs()));
    let link = |joint: &Joint| match &joint.origin {
        JointOrigin::ModifiedDh(row) => libm::hypot(row.a, row.d),
        JointOrigin::Fixed(parent_from_joint) if slides(joint) => {
            length(parent_from_joint.translation) + way((joint.lower, joint.upper))
        }
        JointOrigin::Fixed(parent_from_joint) => length(parent_from_joint.translation),
    };
    let mut ways = [1.0; MAX_JOINTS];
    let mut followed = 0.0;
    for it in robot.followers.iter().filter(|it| it.is_in_chain) {
        let driver = &robot.joints[it.joint];
        ways[it.joint] += it.multiplier.abs();
        followed += length(it.parent_from_joint.translation);
        if it.motion == JointMotion::Slide {
            followed += it.multiplier.abs() * way((driver.lower, driver.upper)) + it.offset.abs();
        }
    }
    let most_ways = ways.into_iter().fold(1.0, f64::max);
    let links: f64 = robot.joints.iter().map(link).sum::<f64>() + followed;
    let flange = length(robot.body_from_flange.translation);
    let stretched = links + flange + length(robot.flange_from_grip.translation);
    let any_slides = robot.joints.iter().any(slides)
        || robot.followers.iter().any(|it| it.motion == JointMotion::Slide);
    let reach = if any_slides { stretched.max(1.0) } else { stretched };
    if robot.followers.is_empty() { reach } else { reach * libm::pow(most_ways, 4.0) }
}

#[cfg(test)]
mod tests {
    use super::super::grid::grid;
    use super::*;
    use crate::path::joint_path::JointPath;
    use crate::robot::{JointConfig, ROBOTS};
    use proptest::prelude::*;

    #[test]
    fn the_error_of_a_parabola_is_that_of_the_cubic() {
        assert!((PARABOLA_ERROR - 1.0 / (72.0 * 3.0_f64.sqrt())).abs() < 1e-16);
    }

    fn bernstein(coefficients: &[f64; 5], t: f64) -> f64 {
        let s = 1.0 - t;
        let weights =
            [s.powi(4), 4.0 * s.powi(3) * t, 6.0 * s * s * t * t, 4.0 * s * t.powi(3), t.powi(4)];
        coefficients.iter().zip(weights).map(|(c, w)| c * w).sum()
    }

    proptest! {
        #[test]
        fn the_grips_velocity_is_that_of_the_jacobian(
            angles in prop::array::uniform7(-3.0_f32..3.0), rates in prop::array::uniform7(-2.0..2.0_f64),
        ) {
            for robot in ROBOTS {
                let jacobian = robot.jacobian(&JointConfig::new(angles));
                let velocity = Arm::of(robot).velocity(&angles.map(f64::from), &rates);
                for (row, found) in jacobian.iter().zip(velocity.to_array()) {
                    let expected: f64 = row.iter().zip(rates).map(|(per_rate, rate)| per_rate * rate).sum();
                    prop_assert!((found - expected).abs() < 1e-12);
                }
            }
        }

        #[test]
        fn the_bound_is_above_the_grips_speed_and_near_it(
            angles in prop::collection::vec(prop::array::uniform7(-1.0_f32..1.0).prop_map(JointConfig::new), 2..6),
        ) {
            let path = <SmoothPath>::through(&JointPath::new(angles).unwrap());
            prop_assume!(path.n_pieces() > 0);
            for robot in ROBOTS {
                let arm = Arm::of(robot);
                let mut intervals = grid(&path);
                limit_grip(&path, &mut intervals, &GripSpeedLimit { robot, max_speed: 2.0 });
                for interval in &intervals {
                    let piece = path.piece(interval.piece);
                    let mut fastest = 0.0_f64;
                    for i in 0..=8 {
                        let t = f64::from(i) / 8.0;
                        let speed = arm.velocity_on(&piece, interval.offset + t * interval.width).length();
                        let bound = libm::sqrt(bernstein(&interval.grip.0, t)) * 2.0;
                        prop_assert!(speed <= bound * (1.0 + 1e-12), "{speed} of {bound}");
                        fastest = fastest.max(speed);
                    }
                    let bound = libm::sqrt(interval.grip.max()) * 2.0;
                    prop_assert!(bound <= 1.05 * fastest + 0.05, "{fastest} of {bound}");
                }
            }
        }
    }
}
