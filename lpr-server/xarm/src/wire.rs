//! The controller's wire protocol, both directions, without a socket.
//!
//! Inside the project lengths are metres and angles radians. On the wire lengths are millimetres;
//! integers of headers are big endian and floating-point parameters little endian. A number that is
//! converted is an `f64`, so that an `f32` of the wire comes back bit for bit.

mod bytes;
mod frame;
mod gripper;
mod pose;
pub mod register;
mod reply;
mod report;
mod request;
#[cfg(test)]
mod tests;

pub use frame::{
    Frame, FrameReader, HEARTBEAT_PROTOCOL, MAX_BODY, MODBUS_PROTOCOL, PRIVATE_PROTOCOL,
};
pub use gripper::{Rtu, RtuBody, gripper_register};
pub use pose::TcpPose;
pub use reply::{Answer, Feedback, FeedbackCode, FeedbackKind, Reply, Status};
pub use report::{
    FAST_BYTES, FastReport, Health, Motion, NORMAL_BYTES, NormalReport, REALTIME_BYTES, RICH_BYTES,
    RealtimeReport, Report, ReportKind, ReportReader, RichReport,
};
pub use request::{
    Axis, Check, JointMove, LineForm, LineMove, Mode, Pace, Power, Request, StateCommand,
};

use thiserror::Error;

/// Port of commands.
pub const COMMAND_PORT: u16 = 502;
/// Second port of commands, which stays free when the first is stuck.
pub const STOP_PORT: u16 = 503;
/// Reports of 804 bytes, 250 times a second.
pub const FAST_PORT: u16 = 30_000;
/// Reports of 145 bytes, 5 times a second.
pub const NORMAL_PORT: u16 = 30_001;
/// Reports of 587 bytes, 5 times a second.
pub const RICH_PORT: u16 = 30_002;
/// Reports of 135 bytes, 100 times a second.
pub const REALTIME_PORT: u16 = 30_003;

/// What the controller says of its motion.
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

/// Bytes that are not what the protocol asks for.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WireError {
    /// A frame without a body, or with one longer than any that exists.
    #[error("a frame of {0} bytes: expected 1 to {MAX_BODY}")]
    FrameLength(usize),
    /// A report that is too short or too long for its port.
    #[error("a report of {found} bytes, expected {expected}")]
    ReportLength {
        /// Bytes of a report of that port.
        expected: usize,
        /// Bytes that the report says it has.
        found: usize,
    },
    /// Parameters of the wrong length.
    #[error("register {register}: {found} bytes of parameters are not what it takes")]
    Parameters {
        /// The register.
        register: u8,
        /// Bytes found.
        found: usize,
    },
    /// A parameter outside its range.
    #[error("register {register}: {name} cannot be {value}")]
    Value {
        /// The register.
        register: u8,
        /// The parameter.
        name: &'static str,
        /// What was found.
        value: String,
    },
    /// A number that is no state of the controller.
    #[error("a controller in state {0}, which does not exist")]
    State(u8),
    /// A number that should be finite.
    #[error("{0} is not a finite number")]
    NotFinite(&'static str),
}

/// Result with a [`WireError`].
pub type Result<T, E = WireError> = core::result::Result<T, E>;
