//! Angles, velocities and accelerations of all joints at one moment.

use crate::robot::{DOF, JointConfig};

/// Position, velocity and acceleration of the joints at one moment.
///
/// ```
/// use lpr_core::path::JointState;
/// use lpr_core::robot::XARM7;
///
/// let state = JointState::at_rest(&XARM7.start);
/// assert_eq!((state.velocities, state.config()), ([0.0; 7], XARM7.start));
/// let mut broken = state;
/// broken.accelerations[6] = f64::NAN;
/// assert!(state.is_finite() && !broken.is_finite());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointState {
    /// Angles, rad.
    pub angles: [f64; DOF],
    /// Velocities, rad/s.
    pub velocities: [f64; DOF],
    /// Accelerations, rad/s².
    pub accelerations: [f64; DOF],
}

impl JointState {
    /// Standing still at `config`.
    #[must_use]
    pub fn at_rest(config: &JointConfig) -> Self {
        Self::standing(config.to_array::<DOF>().map(f64::from))
    }

    pub(super) const fn standing(angles: [f64; DOF]) -> Self {
        Self { angles, velocities: [0.0; DOF], accelerations: [0.0; DOF] }
    }

    /// The angles, rounded to f32.
    #[must_use]
    pub fn config(&self) -> JointConfig {
        JointConfig::new(self.angles.map(|angle| angle as f32))
    }

    /// True if all its numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        [self.angles, self.velocities, self.accelerations]
            .as_flattened()
            .iter()
            .all(|value| value.is_finite())
    }
}
