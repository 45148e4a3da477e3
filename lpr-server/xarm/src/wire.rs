//! The controller's wire protocol, both directions, without a socket.
//!
//! Inside the project lengths are metres and angles radians. On the wire lengths are millimetres;
//! integers of headers are big endian and floating-point parameters little endian. A number that is
//! converted is an `f64`, so that an `f32` of the wire comes back bit for bit.

mod bytes;
mod error;
mod frame;
mod gripper;
mod moves;
mod pose;
pub mod register;
mod reply;
mod report;
mod request;
mod state;
#[cfg(test)]
mod tests;

pub use error::{Result, WireError};
pub use frame::{Frame, FrameReader, HEARTBEAT_PROTOCOL, MODBUS_PROTOCOL, PRIVATE_PROTOCOL};
pub use gripper::{Rtu, RtuBody, gripper_register};
pub use moves::{Check, JointMove, LineForm, LineMove, Pace};
pub use pose::TcpPose;
pub use reply::{Answer, Feedback, FeedbackCode, FeedbackKind, Reply, Status};
pub use report::{
    ArmReading, FAST_BYTES, FastReport, Health, NORMAL_BYTES, NormalReport, REALTIME_BYTES,
    RICH_BYTES, RealtimeReport, Report, ReportKind, ReportReader, RichReport,
};
pub use request::Request;
pub use state::{Axis, Mode, Power, State, StateCommand};

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

/// Longest body of a frame, bytes: 14 times the longest that exists.
pub const MAX_BODY: usize = 4096;
