//! Ports of a controller, or of an emulator.

use crate::wire;

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
