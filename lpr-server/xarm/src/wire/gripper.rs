//! Frames of Modbus RTU, without their checksum, that the controller passes on to the gripper.

use super::bytes::{Reader, Writer};

const READ: u8 = 0x03;
const WRITE: u8 = 0x10;

/// A frame that the controller passes on to the device `slave` at the bus `host`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rtu {
    /// Bus: 9 at the tool.
    pub host: u8,
    /// Device: 8 is the gripper.
    pub slave: u8,
    /// Its content.
    pub body: RtuBody,
}

/// Registers that are read or written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RtuBody {
    /// Asks for `count` registers from `address` on.
    Read {
        /// First register.
        address: u16,
        /// Number of registers.
        count: u16,
    },
    /// Sets registers from `address` on.
    Write {
        /// First register.
        address: u16,
        /// Their values.
        values: Vec<u16>,
    },
    /// Anything else.
    Other(Vec<u8>),
}

/// Numbers of the vendor's gripper's registers.
pub mod gripper_register {
    #![expect(missing_docs, reason = "the names say it")]

    pub const STATUS: u16 = 0x0000;
    pub const ERROR: u16 = 0x000f;
    pub const ENABLE: u16 = 0x0100;
    pub const MODE: u16 = 0x0101;
    pub const SPEED: u16 = 0x0303;
    pub const TARGET: u16 = 0x0700;
    pub const POSITION: u16 = 0x0702;
    pub const VERSION: u16 = 0x0801;
}

impl Rtu {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let (host, slave) = (reader.u8()?, reader.u8()?);
        let rest = reader.rest();
        let body = read_body(&rest).unwrap_or(RtuBody::Other(rest));
        Some(Self { host, slave, body })
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        writer.u8(self.host).u8(self.slave);
        match &self.body {
            RtuBody::Read { address, count } => _ = writer.u8(READ).u16(*address).u16(*count),
            RtuBody::Write { address, values } => {
                writer.u8(WRITE).u16(*address).u16(values.len() as u16).u8(2 * values.len() as u8);
                values.iter().for_each(|value| _ = writer.u16(*value));
            }
            RtuBody::Other(bytes) => _ = writer.bytes(bytes),
        }
    }

    /// The answer of a device to a read, with `values`: host, device, function, bytes and values.
    #[must_use]
    pub fn read_answer(&self, values: &[u16]) -> Vec<u8> {
        let mut writer = Writer::default();
        writer.u8(self.host).u8(self.slave).u8(READ).u8(2 * values.len() as u8);
        values.iter().for_each(|value| _ = writer.u16(*value));
        writer.0
    }

    /// The answer of a device to a write of `count` registers.
    #[must_use]
    pub fn write_answer(&self, address: u16, count: u16) -> Vec<u8> {
        let mut writer = Writer::default();
        writer.u8(self.host).u8(self.slave).u8(WRITE).u16(address).u16(count);
        writer.0
    }
}

/// Only what is written exactly so again: anything else stays as it is.
fn read_body(bytes: &[u8]) -> Option<RtuBody> {
    let mut reader = Reader(bytes);
    let (function, address, count) = (reader.u8()?, reader.u16()?, reader.u16()?);
    match function {
        READ if reader.is_empty() => Some(RtuBody::Read { address, count }),
        WRITE => {
            let n_bytes = reader.u8()?;
            if u16::from(n_bytes) != count.checked_mul(2)? || reader.0.len() != usize::from(n_bytes)
            {
                return None;
            }
            let values = reader
                .0
                .chunks_exact(2)
                .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
                .collect();
            Some(RtuBody::Write { address, values })
        }
        _ => None,
    }
}
