//! Frames that an emulator received, for who wants to hear of them.

use crate::wire::Frame;

/// Which port a command came in on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// The first.
    Command,
    /// The second.
    Stop,
}

/// A frame that the emulator received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Received {
    /// Which connection, counted from 0.
    pub connection: u64,
    /// Which port.
    pub channel: Channel,
    /// The frame.
    pub frame: Frame,
}
