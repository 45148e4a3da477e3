//! Limits of motions that are given a time.

use crate::check::setting;
use crate::error::Result;
use crate::robot::{DOF, Robot};

/// The range of all limits, in their units of metres, radians and seconds: squares and quotients of
/// them are numbers of f64.
const RANGE: core::ops::RangeInclusive<f64> = 1e-9..=1e12;

/// Limits of each of `N` joints, the same in both directions.
///
/// They have no default: what a real arm accelerates at is its owner's to say, since not every
/// vendor does.
///
/// ```
/// use lpr_core::path::MotionLimits;
///
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: Some([20.0; 7]) };
/// assert_eq!(limits.check(), Ok(()));
/// let stuck = MotionLimits { velocity: [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0], ..limits };
/// assert_eq!(stuck.check().unwrap_err().to_string(), "configuration: limits.velocity[2]: expected 1e-9 to 1e12, found 0");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits<const N: usize = DOF> {
    /// Greatest speeds, rad/s.
    pub velocity: [f64; N],
    /// Greatest accelerations, rad/s².
    pub acceleration: [f64; N],
    /// Greatest jerks, rad/s³; without them accelerations may jump.
    pub jerk: Option<[f64; N]>,
}

impl<const N: usize> MotionLimits<N> {
    /// Checks that every limit is a positive number, from 1e-9 to 1e12.
    ///
    /// # Errors
    ///
    /// Naming the first limit that is not.
    pub fn check(&self) -> Result<()> {
        check_positive("velocity", &self.velocity)?;
        check_positive("acceleration", &self.acceleration)?;
        self.jerk.map_or(Ok(()), |jerk| check_positive("jerk", &jerk))
    }
}

/// A limit to the speed of the grip.
///
/// ```
/// use lpr_core::path::{GripSpeedLimit, JointPath, MotionLimits, SmoothPath, time_optimal};
/// use lpr_core::robot::{JointConfig, XARM7};
///
/// let goal = XARM7.start.map(|q| q + 0.3);
/// let path = SmoothPath::through(&JointPath::new(vec![XARM7.start, goal])?);
/// let limits = MotionLimits { velocity: [2.0; 7], acceleration: [10.0; 7], jerk: None };
/// let careful = GripSpeedLimit { robot: &XARM7, max_speed: 0.05 };
/// let (fast, slow) = (time_optimal(&path, &limits, None)?, time_optimal(&path, &limits, Some(&careful))?);
/// let way = (XARM7.grip(&goal).translation - XARM7.grip(&XARM7.start).translation).length();
/// assert!(slow.duration_secs() > f64::from(way) / 0.05 && slow.duration_secs() > 2.0 * fast.duration_secs());
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct GripSpeedLimit<'a> {
    /// The arm that carries the grip.
    pub robot: &'a Robot,
    /// Greatest speed of the grip's origin, m/s.
    pub max_speed: f64,
}

impl GripSpeedLimit<'_> {
    /// Checks that the limit is a positive number, from 1e-9 to 1e12.
    ///
    /// # Errors
    ///
    /// When it is not.
    pub fn check(&self) -> Result<()> {
        check_positive("grip_speed", &[self.max_speed])
    }
}

fn check_positive(name: &str, limits: &[f64]) -> Result<()> {
    limits.iter().enumerate().try_for_each(|(idx, limit)| {
        let name = format!("limits.{name}[{idx}]");
        setting(RANGE.contains(limit), &name, "1e-9 to 1e12", limit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::PANDA;

    #[test]
    fn a_limit_that_is_no_positive_number_is_named() {
        let good =
            MotionLimits { velocity: [1.0; DOF], acceleration: [2.0; DOF], jerk: Some([3.0; DOF]) };
        assert_eq!(good.check(), Ok(()));
        for bad in [0.0, -1.0, 1e-320, f64::NAN, f64::INFINITY] {
            let mut limits = good;
            limits.acceleration[3] = bad;
            assert!(limits.check().unwrap_err().to_string().contains("acceleration[3]"), "{bad}");
            let limits = MotionLimits { jerk: Some([bad; DOF]), ..good };
            assert!(limits.check().unwrap_err().to_string().contains("jerk[0]"), "{bad}");
            assert!(GripSpeedLimit { robot: &PANDA, max_speed: bad }.check().is_err());
        }
    }
}
