//! Motions of the arm as functions of time.

use super::point_to_point::Ruckig;
use super::topp::PathMotion;
use crate::error::{Error, Result};
use crate::robot::{DOF, JointConfig};

/// Where the joints are and how they move at one moment.
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

    /// Whether all its numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        [self.angles, self.velocities, self.accelerations]
            .as_flattened()
            .iter()
            .all(|value| value.is_finite())
    }
}

/// A motion that ends at rest.
///
/// What a controller at 100 Hz is sent:
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits, point_to_point};
/// use lpr_core::robot::JointConfig;
///
/// let start = JointState::at_rest(&JointConfig::new([0.0; 7]));
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: Some([40.0; 7]) };
/// let motion = point_to_point(&start, &JointConfig::new([0.3; 7]), &limits)?;
/// let sent: Vec<_> = motion.samples(0.01)?.collect();
/// assert_eq!(sent[0], (0.0, start));
/// assert_eq!(sent[sent.len() - 1].0, motion.duration_secs());
/// assert_eq!(motion.at(99.0), JointState::at_rest(&JointConfig::new([0.3; 7])), "at the end it stays");
/// # Ok::<(), lpr_core::path::NoMotion>(())
/// ```
#[derive(Debug, Clone)]
pub struct Trajectory {
    start: JointState,
    goal: [f64; DOF],
    duration: f64,
    motion: Motion,
}

#[derive(Debug, Clone)]
pub(super) enum Motion {
    /// Nothing moves.
    Rest,
    AlongPath(PathMotion),
    PointToPoint(Box<Ruckig>),
}

impl Trajectory {
    /// The motion from `start` to rest at `goal` (rad) within `duration` seconds.
    ///
    /// # Errors
    ///
    /// When `duration` is not finite: limits so small or ways so long that numbers of f64 do not
    /// reach.
    pub(super) fn new(
        start: JointState,
        goal: [f64; DOF],
        duration: f64,
        motion: Motion,
    ) -> Result<Self> {
        if !duration.is_finite() {
            return Err(Error::Config(format!(
                "limits: no finite duration within them, got {duration} s"
            )));
        }
        Ok(Self { start, goal, duration, motion })
    }

    /// Time from start to goal, seconds.
    #[must_use]
    pub const fn duration_secs(&self) -> f64 {
        self.duration
    }

    /// The state at `t_secs`: that of the start before 0, at rest at the goal from the end on.
    #[must_use]
    pub fn at(&self, t_secs: f64) -> JointState {
        if t_secs >= self.duration {
            return JointState::standing(self.goal);
        }
        match &self.motion {
            Motion::AlongPath(motion) if t_secs > 0.0 => motion.at(t_secs),
            Motion::PointToPoint(motion) if t_secs > 0.0 => motion.at(t_secs),
            _ => self.start,
        }
    }

    /// Times (seconds) and states at 0, `period_secs`, 2 `period_secs` …, and at the end, which
    /// closes the last period early.
    ///
    /// # Errors
    ///
    /// When the period is not a positive number.
    pub fn samples(&self, period_secs: f64) -> Result<impl Iterator<Item = (f64, JointState)>> {
        if !(period_secs.is_finite() && period_secs > 0.0) {
            return Err(Error::Config(format!("period: above 0, got {period_secs} s")));
        }
        let times =
            (0_u64..).map(move |i| i as f64 * period_secs).take_while(|t| *t < self.duration);
        Ok(times.chain([self.duration]).map(|t| (t, self.at(t))))
    }
}
