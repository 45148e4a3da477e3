//! The state of the controller, and the numbers that change it.

use super::error::{Result, WireError};

/// State of the controller, as it reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// A motion runs.
    Moving = 1,
    /// Standing still, ready to move.
    Ready = 2,
    /// A motion waits to go on.
    Paused = 3,
    /// Stopped: the queue is empty and nothing moves until the state is set to run.
    Stopped = 4,
    /// The configuration changed: nothing moves until the state is set to run.
    Reconfigured = 5,
    /// Slowing down to a stop.
    Decelerating = 6,
}

impl State {
    /// The state of that number.
    ///
    /// # Errors
    ///
    /// When there is none.
    pub fn from_number(number: u8) -> Result<Self> {
        let known = [
            Self::Moving,
            Self::Ready,
            Self::Paused,
            Self::Stopped,
            Self::Reconfigured,
            Self::Decelerating,
        ];
        known.into_iter().find(|state| *state as u8 == number).ok_or(WireError::State(number))
    }
}

/// The controller's way of taking motions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mode(pub u8);

impl Mode {
    /// A queue of motions that the controller plans.
    pub const POSITION: Self = Self(0);
    /// The newest point wins.
    pub const SERVO: Self = Self(1);
}

/// Which drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axis(pub u8);

impl Axis {
    /// Every joint and the tool.
    pub const ALL: Self = Self(8);
}

/// Drives on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Power {
    /// Without torque, brakes closed.
    Off,
    /// Holding the arm.
    On,
}

/// Command to run, to pause or to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum StateCommand {
    /// Motions may run.
    Run = 0,
    /// The motion waits.
    Pause = 3,
    /// Stop and forget the queue.
    Stop = 4,
    /// Slow down, stop and forget the queue.
    SlowStop = 6,
}

impl StateCommand {
    /// The command of that number; none when there is none.
    pub(super) fn from_number(number: u8) -> Option<Self> {
        let known = [Self::Run, Self::Pause, Self::Stop, Self::SlowStop];
        known.into_iter().find(|command| *command as u8 == number)
    }
}
