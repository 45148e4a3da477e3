//! Quadratic Bézier curves of the grip (section IV-A).
//!
//! # Differences from the paper
//!
//! - The orientation turns at constant speed from start to goal; the paper says nothing of it, its code mixes raw quaternion
//!   components.
//! - The spread of the middle point is a standard deviation in metres: "variance 0.2" read as metres² (0.45 m) leaves few
//!   curves within reach.

use super::follow::follow;
use super::{JointPath, Rejection};
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
    /// Standard deviation of the middle control point per axis, metres (the paper's "variance 0.2" is 0.447).
    pub sigma: f32,
}

/// A curve of the grip from one pose to another.
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
    /// The curve from `start` to `goal` (`world_from_grip`) with the middle control point `middle` (world, metres).
    #[must_use]
    pub fn new(start: &Pose3, middle: Vec3, goal: &Pose3) -> Self {
        let is_short_way = start.rotation.dot(goal.rotation) >= 0.0;
        Self {
            points: [start.translation, middle, goal.translation],
            start_rotation: start.rotation,
            end_rotation: if is_short_way { goal.rotation } else { -goal.rotation },
        }
    }

    /// A curve whose middle control point is drawn from a Gaussian around the middle of start and goal.
    #[must_use]
    pub fn sample(start: &Pose3, goal: &Pose3, settings: &BezierSettings, rng: &mut Rng) -> Self {
        let offset = Vec3::from_array(core::array::from_fn(|_| settings.sigma * normal(rng)));
        Self::new(start, 0.5 * (start.translation + goal.translation) + offset, goal)
    }

    /// `world_from_grip` at parameter `t`, 0 to 1: `(1-t)² P_0 + 2(1-t)t P_1 + t² P_2`, and the orientation at a share `t` of the
    /// turn.
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
    /// When the arm cannot follow to the end: [`Rejection::CurveUnreachable`] or [`Rejection::BranchJump`].
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
