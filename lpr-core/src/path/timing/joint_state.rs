//! Angles, velocities and accelerations of all joints at one moment.

use crate::robot::{DOF, JointConfig};

/// Position, velocity and acceleration of `N` joints at one moment; an arm with fewer leaves the
/// last of them at 0.
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
pub struct JointState<const N: usize = DOF> {
    /// Positions, rad or m.
    pub angles: [f64; N],
    /// Velocities, rad/s or m/s.
    pub velocities: [f64; N],
    /// Accelerations, rad/s² or m/s².
    pub accelerations: [f64; N],
}

impl<const N: usize> JointState<N> {
    /// Standing still at `config`.
    ///
    /// # Panics
    ///
    /// When the arm has more than `N` joints.
    #[must_use]
    pub fn at_rest(config: &JointConfig) -> Self {
        assert!(config.dof() <= N, "{} joints do not fit into {N}", config.dof());
        Self::standing(config.to_array::<N>().map(f64::from))
    }

    pub(super) const fn standing(angles: [f64; N]) -> Self {
        Self { angles, velocities: [0.0; N], accelerations: [0.0; N] }
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
