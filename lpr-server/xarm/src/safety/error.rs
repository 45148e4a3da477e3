//! The rules that a path may break.

use thiserror::Error;

/// The rule that a path breaks first; joints and points count from 1 and 0.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SafetyError {
    /// Nothing to run.
    #[error("the path has no points")]
    Empty,
    /// A joint angle that is no number.
    #[error("point {index}: joint {joint} is not a finite number")]
    NotFinite {
        /// Point.
        index: usize,
        /// Joint.
        joint: usize,
    },
    /// Too near a joint limit.
    #[error(
        "point {index}: joint {joint} at {angle:.4} rad leaves [{lower:.4}, {upper:.4}], its limits less a margin"
    )]
    JointLimit {
        /// Point.
        index: usize,
        /// Joint.
        joint: usize,
        /// Its angle, radians.
        angle: f32,
        /// Least allowed, radians.
        lower: f32,
        /// Greatest allowed, radians.
        upper: f32,
    },
    /// The arm is elsewhere.
    #[error(
        "the path starts with joint {joint} at {start:.4} rad, the arm has it at {measured:.4} rad: more than {tolerance:.4} apart"
    )]
    Start {
        /// Joint.
        joint: usize,
        /// Of the path, radians.
        start: f32,
        /// Of the arm, radians.
        measured: f32,
        /// Allowed difference, radians.
        tolerance: f32,
    },
    /// A joint would be too fast.
    #[error(
        "point {index}: joint {joint} would move at {speed:.3} rad/s, at most {limit:.3} are allowed"
    )]
    JointSpeed {
        /// Point at which the step ends.
        index: usize,
        /// Joint.
        joint: usize,
        /// rad/s.
        speed: f64,
        /// rad/s.
        limit: f64,
    },
    /// A joint would change its speed too fast.
    #[error(
        "point {index}: joint {joint} would accelerate at {acceleration:.2} rad/s², at most {limit:.2} are allowed"
    )]
    JointAcceleration {
        /// Point in the middle.
        index: usize,
        /// Joint.
        joint: usize,
        /// rad/s².
        acceleration: f64,
        /// rad/s².
        limit: f64,
    },
    /// The tool would go too far in one tick.
    #[error(
        "point {index}: the tool would move {step:.4} m in one tick, at most {limit:.4} are allowed"
    )]
    TcpStep {
        /// Point at which the step ends.
        index: usize,
        /// Metres.
        step: f64,
        /// Metres.
        limit: f64,
    },
    /// The tool would be too fast.
    #[error("point {index}: the tool would move at {speed:.3} m/s, at most {limit:.3} are allowed")]
    TcpSpeed {
        /// Point at which the step ends.
        index: usize,
        /// m/s.
        speed: f64,
        /// m/s.
        limit: f64,
    },
    /// The grip would be too low.
    #[error(
        "point {index}: the grip would be at a height of {height:.4} m, at least {floor:.4} is allowed"
    )]
    Floor {
        /// Point.
        index: usize,
        /// Metres.
        height: f64,
        /// Metres.
        floor: f64,
    },
}
