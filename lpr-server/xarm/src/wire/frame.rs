//! Frames: transaction, protocol and length, then a body of which the first byte is a register.

use super::MAX_BODY;
use super::bytes::{Reader, Writer};
use super::error::{Result, WireError};

/// Bytes before the body.
const HEADER: usize = 6;

/// Protocol identifier of standard Modbus.
pub const MODBUS_PROTOCOL: u16 = 0;
/// Protocol identifier of a bare heart-beat, which has no reply.
pub const HEARTBEAT_PROTOCOL: u16 = 1;
/// Protocol identifier of the vendor's own registers; 3 is the same with a heart-beat.
pub const PRIVATE_PROTOCOL: u16 = 2;

/// A request or a reply on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Chosen by who asks, echoed by who answers.
    pub transaction: u16,
    /// Protocol identifier.
    pub protocol: u16,
    /// Register and parameters; in a reply the status is between them.
    pub body: Vec<u8>,
}

impl Frame {
    /// Its bytes.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        debug_assert!(
            (1..=MAX_BODY).contains(&self.body.len()),
            "a body of {} bytes",
            self.body.len()
        );
        let mut writer = Writer::default();
        writer
            .u16(self.transaction)
            .u16(self.protocol)
            .u16(self.body.len() as u16)
            .bytes(&self.body);
        writer.0
    }

    /// Register and what follows it.
    ///
    /// # Errors
    ///
    /// When the body is empty.
    pub fn register(&self) -> Result<(u8, &[u8])> {
        let (register, rest) = self.body.split_first().ok_or(WireError::FrameLength(0))?;
        Ok((*register, rest))
    }
}

/// Cuts a stream of bytes into frames, however they were cut on the way.
#[derive(Debug, Default)]
pub struct FrameReader {
    buffer: Vec<u8>,
}

impl FrameReader {
    /// Takes bytes as they arrive.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole frame; none while bytes are missing.
    ///
    /// # Errors
    ///
    /// When a length is impossible: where the next frame begins is unknown from then on, so the
    /// connection has to be closed.
    pub fn next_frame(&mut self) -> Result<Option<Frame>> {
        let mut reader = Reader(&self.buffer);
        let (Some(transaction), Some(protocol), Some(length)) =
            (reader.u16(), reader.u16(), reader.u16())
        else {
            return Ok(None);
        };
        let length = usize::from(length);
        if !(1..=MAX_BODY).contains(&length) {
            return Err(WireError::FrameLength(length));
        }
        let Some(body) = reader.0.get(..length) else { return Ok(None) };
        let frame = Frame { transaction, protocol, body: body.to_vec() };
        self.buffer.drain(..HEADER + length);
        Ok(Some(frame))
    }
}
