//! The motion of the arm as a function of time.

use super::motion::PathMotion;
use crate::error::{Error, Result};
use crate::path::timing::joint_state::JointState;
use crate::robot::DOF;

/// A motion that ends at rest.
///
/// States for a controller at 100 Hz:
///
/// ```
/// use lpr_core::path::{JointPath, JointState, MotionLimits, SmoothPath, time_optimal};
/// use lpr_core::robot::JointConfig;
///
/// let (start, goal) = (JointConfig::new([0.0; 7]), JointConfig::new([0.3; 7]));
/// let path = SmoothPath::through(&JointPath::new(vec![start, goal])?);
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: Some([40.0; 7]) };
/// let motion = time_optimal(&path, &limits, None)?;
/// let sent: Vec<_> = motion.samples(0.01)?.collect();
/// assert_eq!(sent[0], (0.0, JointState::at_rest(&start)));
/// assert_eq!(sent[sent.len() - 1].0, motion.duration_secs());
/// assert_eq!(motion.at(99.0), JointState::at_rest(&goal), "at the end it stays");
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Trajectory<const N: usize = DOF> {
    start: JointState<N>,
    goal: [f64; N],
    duration: f64,
    /// None when start and goal are one: nothing moves.
    motion: Option<PathMotion<N>>,
}

impl<const N: usize> Trajectory<N> {
    /// From rest at `start` to rest at `goal` (rad) by `motion`; without one it takes no time.
    ///
    /// # Errors
    ///
    /// When the duration is not finite: limits so small or ways so long that numbers of f64 do not
    /// reach.
    pub(super) fn new(
        start: [f64; N],
        goal: [f64; N],
        motion: Option<PathMotion<N>>,
    ) -> Result<Self> {
        let duration = motion.as_ref().map_or(0.0, PathMotion::duration);
        if !duration.is_finite() {
            return Err(Error::Config(format!(
                "limits: expected limits of a finite duration, found {duration} s"
            )));
        }
        Ok(Self { start: JointState::standing(start), goal, duration, motion })
    }

    /// Time from start to goal, seconds.
    #[must_use]
    pub const fn duration_secs(&self) -> f64 {
        self.duration
    }

    /// The state at `t_secs`: that of the start before 0, at rest at the goal from the end on.
    #[must_use]
    pub fn at(&self, t_secs: f64) -> JointState<N> {
        if t_secs >= self.duration {
            return JointState::standing(self.goal);
        }
        match &self.motion {
            Some(motion) if t_secs > 0.0 => motion.at(t_secs),
            _ => self.start,
        }
    }

    /// Times (seconds) and states at 0, `period_secs`, 2 `period_secs` …, and at the end, which
    /// closes the last period early.
    ///
    /// # Errors
    ///
    /// When the period is not a positive number.
    pub fn samples(&self, period_secs: f64) -> Result<impl Iterator<Item = (f64, JointState<N>)>> {
        if !(period_secs.is_finite() && period_secs > 0.0) {
            return Err(Error::Config(format!(
                "period: expected a time above 0, found {period_secs} s"
            )));
        }
        let times =
            (0_u64..).map(move |i| i as f64 * period_secs).take_while(|t| *t < self.duration);
        Ok(times.chain([self.duration]).map(|t| (t, self.at(t))))
    }
}
