//! Quadratic Bézier curves of the grip (section IV-A).
//!
//! # Differences from the paper
//!
//! - The orientation turns at constant speed from start to goal; the paper says nothing of it, its
//!   code mixes raw quaternion components.
//! - The spread of the middle point is a standard deviation in metres: "variance 0.2" read as
//!   metres² (0.45 m) leaves few curves within reach.

use super::follow::follow;
use crate::check::setting;
use crate::error::Result;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::{Rng, normal};
use crate::robot::{JointConfig, Robot};
use glamx::{Pose3, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// Way of the grip between two samples of a curve, metres.
const SAMPLE_SPACING: f32 = 0.01;

/// Turn of the grip between two samples of a curve, radians.
const SAMPLE_TURN: f32 = 2.5 * core::f32::consts::PI / 180.0;

/// Fewest and most samples of a curve.
const SAMPLES: (usize, usize) = (20, 60);

/// Chords by which the length of a curve is measured.
const LENGTH_CHORDS: u16 = 8;

/// Numbers of the Bézier generator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BezierSettings {
    /// Standard deviation of the middle control point per axis, metres (the paper's "variance 0.2"
    /// is 0.447).
    pub sigma: f32,
}

impl BezierSettings {
    /// Checks the range of the spread.
    ///
    /// # Errors
    ///
    /// [`Error::Config`](crate::Error::Config) when it is not a finite number from 0.
    pub fn check(&self) -> Result<()> {
        let holds = self.sigma.is_finite() && self.sigma >= 0.0;
        setting(holds, "bezier.sigma", "a finite number from 0", self.sigma)
    }
}

/// A curve of the grip from one pose to another.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::BezierCurve;
/// use lpr_core::robot::XARM7;
///
/// let start = XARM7.grip(&XARM7.start);
/// let mut goal = start;
/// goal.translation.y += 0.2;
/// // Over something in the way: the curve comes half as high as its middle control point.
/// let middle = start.translation + Vec3::new(0.0, 0.1, 0.2);
/// let curve = BezierCurve::new(&start, middle, &goal);
/// assert!((curve.pose(0.5).translation.z - start.translation.z - 0.1).abs() < 1e-6);
///
/// let path = curve.to_joints(&XARM7, &XARM7.start)?;
/// assert!(XARM7.grip(path.goal()).translation.distance(goal.translation) < 1e-3);
/// # Ok::<(), lpr_core::path::Rejection>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BezierCurve {
    /// Start, middle and end control points in the world, metres: `P_0`, `P_1`, `P_2` in the paper.
    pub points: [Vec3; 3],
    /// Orientation of the grip at the start.
    pub start_rotation: Quat,
    /// Orientation of the grip at the end, in the hemisphere of the start's.
    pub end_rotation: Quat,
}

impl BezierCurve {
    /// The curve from `start` to `goal` (`world_from_grip`) with the middle control point `middle`
    /// (world, metres).
    #[must_use]
    pub fn new(start: &Pose3, middle: Vec3, goal: &Pose3) -> Self {
        let is_short_way = start.rotation.dot(goal.rotation) >= 0.0;
        Self {
            points: [start.translation, middle, goal.translation],
            start_rotation: start.rotation,
            end_rotation: if is_short_way { goal.rotation } else { -goal.rotation },
        }
    }

    /// A curve whose middle control point is drawn from a Gaussian around the middle of start and
    /// goal.
    ///
    /// ```
    /// use lpr_core::path::{BezierCurve, BezierSettings};
    /// use lpr_core::rng::{Stream, stream};
    /// use lpr_core::robot::PANDA;
    ///
    /// let start = PANDA.grip(&PANDA.start);
    /// let curve = |sigma, draw| {
    ///     let rng = &mut stream(0, Stream::Bezier, draw);
    ///     BezierCurve::sample(&start, &start, &BezierSettings { sigma }, rng)
    /// };
    /// assert_eq!(curve(0.2, 3), curve(0.2, 3), "a draw is one of its stream's");
    /// assert_ne!(curve(0.2, 3), curve(0.2, 4));
    /// assert_eq!(curve(0.0, 3).points[1], start.translation, "without spread, the middle");
    /// ```
    #[must_use]
    pub fn sample(start: &Pose3, goal: &Pose3, settings: &BezierSettings, rng: &mut Rng) -> Self {
        let offset = Vec3::from_array(core::array::from_fn(|_| settings.sigma * normal(rng)));
        Self::new(start, 0.5 * (start.translation + goal.translation) + offset, goal)
    }

    /// `world_from_grip` at parameter `t`, 0 to 1: `(1-t)² P_0 + 2(1-t)t P_1 + t² P_2`, and the
    /// orientation at a share `t` of the turn.
    #[must_use]
    pub fn pose(&self, t: f32) -> Pose3 {
        let [start, middle, end] = self.points;
        let s = 1.0 - t;
        let position = s * s * start + 2.0 * s * t * middle + t * t * end;
        Pose3::from_parts(position, slerp(self.start_rotation, self.end_rotation, t))
    }

    /// Steps at which the curve is followed: about every centimetre or 2.5°.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        let at = |i: u16| self.pose(f32::from(i) / f32::from(LENGTH_CHORDS)).translation;
        let length: f32 = (0..LENGTH_CHORDS).map(|i| at(i).distance(at(i + 1))).sum();
        let turn = 2.0 * libm::acosf(self.start_rotation.dot(self.end_rotation).clamp(-1.0, 1.0));
        let steps = libm::ceilf((length / SAMPLE_SPACING).max(turn / SAMPLE_TURN));
        (steps as usize).clamp(SAMPLES.0, SAMPLES.1)
    }

    /// The joint path that follows the curve from `start`, whose grip is at the curve's start.
    ///
    /// # Errors
    ///
    /// When the arm cannot follow to the end: [`Rejection::CurveUnreachable`] or
    /// [`Rejection::BranchJump`].
    pub fn to_joints(&self, robot: &Robot, start: &JointConfig) -> Result<JointPath, Rejection> {
        follow(robot, start, self.n_steps(), |t| self.pose(t))
    }
}

/// Spherical interpolation of unit quaternions in one hemisphere, through `libm`.
pub(super) fn slerp(from: Quat, to: Quat, t: f32) -> Quat {
    /// Cosine above which a straight mix is exact to f32 rounding.
    const NEARLY_EQUAL: f32 = 0.9995;
    let cosine = from.dot(to);
    let mixed = if cosine > NEARLY_EQUAL {
        from * (1.0 - t) + to * t
    } else {
        let angle = libm::acosf(cosine.clamp(-1.0, 1.0));
        from * libm::sinf((1.0 - t) * angle) + to * libm::sinf(t * angle)
    };
    mixed * (1.0 / libm::sqrtf(mixed.dot(mixed)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::ROBOTS;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose3> {
        (prop::array::uniform3(-1.0_f32..1.0), prop::array::uniform3(-3.0_f32..3.0)).prop_map(
            |(at, turn)| {
                Pose3::from_parts(
                    Vec3::from_array(at),
                    Quat::from_scaled_axis(Vec3::from_array(turn)),
                )
            },
        )
    }

    proptest! {
        #[test]
        fn ends_are_exact_and_the_turn_takes_the_short_way(start in pose(), goal in pose(), middle in prop::array::uniform3(-1.0_f32..1.0)) {
            for goal in [goal, Pose3::from_parts(goal.translation, -goal.rotation)] {
                let curve = BezierCurve::new(&start, Vec3::from_array(middle), &goal);
                prop_assert_eq!(curve.pose(0.0).translation, start.translation);
                prop_assert_eq!(curve.pose(1.0).translation, goal.translation);
                let turn = start.rotation.angle_between(goal.rotation);
                for i in 0..=8_u8 {
                    let t = f32::from(i) / 8.0;
                    let rotation = curve.pose(t).rotation;
                    prop_assert!((rotation.length() - 1.0).abs() < 1e-5);
                    prop_assert!((rotation.angle_between(start.rotation) - t * turn).abs() < 2e-3);
                    prop_assert!((rotation.angle_between(goal.rotation) - (1.0 - t) * turn).abs() < 2e-3);
                }
            }
        }
    }

    /// Values of the Bernstein polynomials of degree 2 at quarters, by hand.
    #[test]
    fn positions_are_sums_of_bernstein_polynomials() {
        let expected = [
            [1.0, 0.0, 0.0],
            [0.5625, 0.375, 0.0625],
            [0.25, 0.5, 0.25],
            [0.0625, 0.375, 0.5625],
            [0.0, 0.0, 1.0],
        ];
        let at = |point| Pose3::from_parts(point, Quat::IDENTITY);
        let curve = BezierCurve::new(&at(Vec3::X), Vec3::Y, &at(Vec3::Z));
        for (quarter, weights) in (0_u8..).zip(expected) {
            assert_eq!(
                curve.pose(0.25 * f32::from(quarter)).translation,
                Vec3::from_array(weights)
            );
        }
    }

    #[test]
    fn middle_points_are_spread_by_sigma_around_the_middle() {
        let at = |x| Pose3::from_parts(Vec3::new(x, 0.0, 0.3), Quat::IDENTITY);
        let settings = BezierSettings { sigma: 0.2 };
        let mut rng = stream(5, Stream::Bezier, 0);
        let n = 10_000;
        let middle = Vec3::new(0.5, 0.0, 0.3);
        let offsets: Vec<Vec3> = (0..n)
            .map(|_| {
                BezierCurve::sample(&at(0.2), &at(0.8), &settings, &mut rng).points[1] - middle
            })
            .collect();
        let n = n as f32;
        let mean = offsets.iter().fold(Vec3::ZERO, |sum, offset| sum + *offset) / n;
        let variance = offsets.iter().fold(Vec3::ZERO, |sum, offset| sum + *offset * *offset) / n;
        for axis in 0..3 {
            assert!(mean[axis].abs() < 3.0 * 0.2 / n.sqrt());
            assert!((variance[axis] - 0.04).abs() < 3.0 * 0.04 * (2.0 / n).sqrt());
        }
    }

    #[test]
    fn joints_follow_the_curve_from_the_exact_start_to_the_goal() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let goal = Pose3::from_parts(
                start.translation + Vec3::new(-0.05, 0.2, -0.1),
                start.rotation * Quat::from_rotation_z(0.6),
            );
            let mut rng = stream(2, Stream::Bezier, 0);
            for _ in 0..20 {
                let curve =
                    BezierCurve::sample(&start, &goal, &BezierSettings { sigma: 0.05 }, &mut rng);
                let path = curve.to_joints(robot, &robot.start).unwrap();
                assert_eq!(*path.start(), robot.start);
                // No step was halved on so easy a curve, so the configurations belong to equal
                // steps of the parameter.
                assert_eq!(path.configs().len(), curve.n_steps() + 1);
                for (i, config) in path.configs().iter().enumerate() {
                    let (found, wanted) =
                        (robot.grip(config), curve.pose(i as f32 / curve.n_steps() as f32));
                    assert!(found.translation.distance(wanted.translation) < 1e-4);
                    assert!(found.rotation.angle_between(wanted.rotation) < 2e-3);
                }
                assert!(path.configs().iter().skip(1).all(|config| robot.within_limits(config)));
            }
        }
    }

    #[test]
    fn a_curve_that_leaves_the_reach_says_where() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let goal = Pose3::from_parts(start.translation - 0.3 * Vec3::Z, start.rotation);
            let curve =
                BezierCurve::new(&start, start.translation + Vec3::new(1.0, 0.0, -0.3), &goal);
            let rejection = curve.to_joints(robot, &robot.start).unwrap_err();
            let Rejection::CurveUnreachable { fraction } = rejection else {
                panic!("{}: {rejection:?}", robot.name)
            };
            assert!(fraction > 0.0 && fraction < 0.5, "{}: {fraction}", robot.name);
        }
    }
}
