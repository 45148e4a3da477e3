//! The joints of an arm.

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use glamx::{DPose3, DQuat, DVec3};

/// A joint that moves along or about the z axis of its frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name of the joint.
    pub name: String,
    /// Its frame in the body before it.
    pub origin: JointOrigin,
    /// Its motion.
    pub motion: JointMotion,
    /// Lower limit, radians or metres.
    pub lower: f32,
    /// Upper limit, radians or metres.
    pub upper: f32,
    /// Turns without end: `lower` and `upper` are then infinite, positions that differ by whole turns
    /// are one, and planners, curves and kinematics take the winding nearest the start.
    pub is_continuous: bool,
    /// Velocity limit, rad/s or m/s.
    pub max_velocity: f32,
    /// Acceleration limit, rad/s² or m/s²; infinite where a description states none.
    pub max_acceleration: f32,
}

/// Frame of a joint in the body before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointOrigin {
    /// By a modified-DH row: the built-in arms, which the closed form of inverse kinematics serves.
    ModifiedDh(DhRow),
    /// By `parent_from_joint` at position 0.
    Fixed(DPose3),
}

/// A modified-DH row: `parent_from_joint(q) = Rx(alpha) Tx(a) Rz(q) Tz(d)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DhRow {
    /// Twist before the joint, radians (a multiple of π/2 for the built-in arms).
    pub alpha: f64,
    /// Offset along the previous x, metres.
    pub a: f64,
    /// Offset along the joint's z, metres.
    pub d: f64,
}

/// Motion of a joint.
///
/// ```
/// use lpr_core::glamx::DVec3;
/// use lpr_core::robot::JointMotion;
///
/// assert_eq!(JointMotion::Slide.transform(0.3) * DVec3::X, DVec3::new(1.0, 0.0, 0.3));
/// let turned = JointMotion::Turn.transform(core::f64::consts::FRAC_PI_2) * DVec3::X;
/// assert!(turned.distance(DVec3::Y) < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointMotion {
    /// About z, by radians.
    Turn,
    /// Along z, by metres.
    Slide,
}

impl Joint {
    /// `parent_from_body` at position `q`, radians or metres.
    ///
    /// ```
    /// use core::f64::consts::FRAC_PI_2;
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::PANDA;
    ///
    /// // The fourth joint is 0.0825 m along the x axis of the third's frame, wherever it turns to.
    /// let parent_from_joint = PANDA.joints[3].transform(FRAC_PI_2);
    /// assert_eq!(parent_from_joint.translation, DVec3::new(0.0825, 0.0, 0.0));
    /// ```
    #[must_use]
    pub fn transform(&self, q: f64) -> DPose3 {
        match &self.origin {
            JointOrigin::ModifiedDh(row) => row.transform(q),
            JointOrigin::Fixed(parent_from_joint) => *parent_from_joint * self.motion.transform(q),
        }
    }

    /// The joint's frame at position 0 in the frame of the body before it.
    #[must_use]
    pub fn parent_from_joint(&self) -> DPose3 {
        match &self.origin {
            JointOrigin::ModifiedDh(row) => row.transform(0.0),
            JointOrigin::Fixed(parent_from_joint) => *parent_from_joint,
        }
    }

    /// The modified-DH row of a joint of a built-in arm.
    #[must_use]
    pub const fn dh(&self) -> Option<&DhRow> {
        match &self.origin {
            JointOrigin::ModifiedDh(row) => Some(row),
            JointOrigin::Fixed(_) => None,
        }
    }
}

impl DhRow {
    /// `parent_from_body` at angle `q`, radians.
    #[must_use]
    pub fn transform(&self, q: f64) -> DPose3 {
        self.twisted().transform(q)
    }

    /// The row with all that does not depend on the angle.
    pub(super) fn twisted(&self) -> TwistedRow {
        let [half_twist, (sin, cos)] = sincos_of_twist(self.alpha);
        TwistedRow { translation: DVec3::new(self.a, -sin * self.d, cos * self.d), half_twist }
    }
}

/// A modified-DH row as its transform needs it.
#[derive(Debug, Clone, Copy)]
pub(super) struct TwistedRow {
    translation: DVec3,
    /// Sine and cosine of half the twist.
    half_twist: (f64, f64),
}

impl TwistedRow {
    /// `parent_from_body` at angle `q`, radians.
    pub(super) fn transform(&self, q: f64) -> DPose3 {
        let (sin_x, cos_x) = self.half_twist;
        let (sin_z, cos_z) = libm::sincos(0.5 * q);
        DPose3::from_parts(
            self.translation,
            DQuat::from_xyzw(sin_x * cos_z, -sin_x * sin_z, cos_x * sin_z, cos_x * cos_z),
        )
    }
}

impl JointMotion {
    /// `joint_from_body` at position `q`, radians or metres.
    #[must_use]
    pub fn transform(self, q: f64) -> DPose3 {
        match self {
            Self::Turn => {
                let (sin, cos) = libm::sincos(0.5 * q);
                DPose3::from_rotation(DQuat::from_xyzw(0.0, 0.0, sin, cos))
            }
            Self::Slide => DPose3::from_translation(DVec3::new(0.0, 0.0, q)),
        }
    }
}

/// Sine and cosine of half the twist and of the twist.
///
/// Those of right angles, which most joints have, are written down: they would be two thirds of the
/// trigonometry of an arm.
fn sincos_of_twist(alpha: f64) -> [(f64, f64); 2] {
    /// One unit in the last place below the cosine.
    const SIN_45: f64 = 0.707_106_781_186_547_5;
    const COS_90: f64 = 6.123_233_995_736_766e-17;
    if alpha == 0.0 {
        [(0.0, 1.0); 2]
    } else if alpha.abs() == FRAC_PI_2 {
        [(SIN_45.copysign(alpha), FRAC_1_SQRT_2), (1.0_f64.copysign(alpha), COS_90)]
    } else {
        [libm::sincos(0.5 * alpha), libm::sincos(alpha)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_that_are_written_down_are_those_of_libm() {
        for alpha in [0.0, FRAC_PI_2, -FRAC_PI_2] {
            assert_eq!(sincos_of_twist(alpha), [libm::sincos(0.5 * alpha), libm::sincos(alpha)]);
        }
    }
}
