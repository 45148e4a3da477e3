//! Reasons why an execution is given up, and the state of the arm then.

use crate::client::ClientError;
use crate::safety::SafetyError;
use crate::wire::{Mode, State, Status};
use core::time::Duration;
use thiserror::Error;

/// Reason why an execution was given up.
#[derive(Debug, Error)]
pub enum Cause {
    /// The connection or a reply.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The arm is not where the path starts.
    #[error(transparent)]
    Safety(#[from] SafetyError),
    /// The controller has an error; it is not forgotten without being told to.
    #[error("the controller has error {0}: clear it where the arm can be seen")]
    ControllerError(u8),
    /// Someone else moves the arm, or has paused it.
    #[error("the arm is in the middle of a motion: someone else uses it")]
    Busy,
    /// The controller takes no points in that state.
    #[error("a servo point was refused (status {:#04x})", .0.0)]
    PointRefused(Status),
    /// The controller did not come to the state asked for.
    #[error("the controller did not become ready: it is in {state:?}, mode {}", mode.0)]
    NotReady {
        /// Its state.
        state: State,
        /// Its mode.
        mode: Mode,
    },
    /// Someone else stopped, paused or reconfigured the controller.
    #[error("someone else changed the controller: it is in {state:?}, mode {}", mode.0)]
    TakenOver {
        /// Its state.
        state: State,
        /// Its mode.
        mode: Mode,
    },
    /// No report, or an old one.
    #[error("no report for {} ms", age.as_millis())]
    ReportStalled {
        /// Age of the newest.
        age: Duration,
    },
    /// The arm does not follow.
    #[error("joint {joint} is {error:.3} rad from the point that was sent")]
    Tracking {
        /// Joint, from 1.
        joint: usize,
        /// Radians.
        error: f32,
    },
    /// The arm did not come to the end of the path.
    #[error("joint {joint} stayed {error:.5} rad from the end of the path")]
    NotArrived {
        /// Joint, from 1.
        joint: usize,
        /// Radians.
        error: f32,
    },
    /// The user.
    #[error("interrupted")]
    Interrupted,
}

/// An execution that was given up.
#[derive(Debug, Error)]
#[error("{cause}; after {points_sent} of {n_points} points {stop}")]
pub struct ExecutionError {
    /// Reason.
    #[source]
    pub cause: Cause,
    /// Points that were sent before.
    pub points_sent: usize,
    /// Points of the path.
    pub n_points: usize,
    /// Outcome of stopping.
    pub stop: StopOutcome,
}

/// Outcome of telling the arm to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopOutcome {
    /// The controller says so.
    Acknowledged,
    /// Nobody answered.
    Unanswered,
    /// Nothing had been enabled.
    Unneeded,
}

impl core::fmt::Display for StopOutcome {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Acknowledged => "the arm was told to stop",
            Self::Unanswered => "nobody answered the command to stop: use the emergency button",
            Self::Unneeded => "nothing had been enabled",
        })
    }
}
