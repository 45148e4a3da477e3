//! The UFACTORY xArm7: its wire protocol, a bridge that moves it, and an emulator of its
//! controller.
//!
//! [`wire`] is the only place with millimetres, degrees and byte layouts; both sides use it, and it
//! has no socket. [`client`] talks to a controller, [`schedule`] times a path for a real arm,
//! [`safety`] checks the whole timed path before the first frame, and [`executor`] streams it.
//! [`emulator`] is the controller on the loopback interface, for tests and for the vendor's own
//! SDK.
//!
//! Stopping the arm by a command is no safety-rated stop: the emergency button is.

pub mod client;
pub mod emulator;
pub mod executor;
pub mod safety;
pub mod schedule;
pub mod wire;

/// The ports of a controller, or of an emulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ports {
    /// Commands: [`wire::COMMAND_PORT`] on a controller.
    pub command: u16,
    /// The second port of commands: [`wire::STOP_PORT`] on a controller.
    pub stop: u16,
    /// Fast reports: [`wire::FAST_PORT`] on a controller.
    pub fast: u16,
    /// Normal reports: [`wire::NORMAL_PORT`] on a controller.
    pub normal: u16,
    /// Rich reports: [`wire::RICH_PORT`] on a controller.
    pub rich: u16,
    /// Real-time reports: [`wire::REALTIME_PORT`] on a controller.
    pub realtime: u16,
}

impl Ports {
    /// Those of a controller.
    pub const CONTROLLER: Self = Self {
        command: wire::COMMAND_PORT,
        stop: wire::STOP_PORT,
        fast: wire::FAST_PORT,
        normal: wire::NORMAL_PORT,
        rich: wire::RICH_PORT,
        realtime: wire::REALTIME_PORT,
    };
}
