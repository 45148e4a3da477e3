//! The report of 804 bytes, 250 times a second.

use super::begin;
use crate::wire::bytes::{Reader, metres, millimetres};
use crate::wire::error::Result;
use crate::wire::state::{Mode, State};
use lpr_core::robot::{DOF, JointConfig};

/// Bytes of a [`FastReport`].
pub const FAST_BYTES: usize = 804;

/// The report of port [`crate::wire::FAST_PORT`]; what this program does not know is sent as zeros and
/// not read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FastReport {
    /// Time of the controller, microseconds.
    pub micros: u64,
    /// The state.
    pub state: State,
    /// The mode.
    pub mode: Mode,
    /// Motions in the queue.
    pub queued: u16,
    /// Angles that the joints should have, radians.
    pub target: JointConfig,
    /// Angles that they have, radians.
    pub joints: JointConfig,
    /// Their speeds, rad/s.
    pub joint_speeds: [f32; DOF],
    /// Position of the tool, metres.
    pub position: [f64; 3],
    /// Rotation of the tool: axis times angle, radians.
    pub axis_angle: [f32; 3],
}

impl FastReport {
    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Option<Self>> {
        let Some((micros, (state, queued))) = reader.u64().zip(reader.u8().zip(reader.u16()))
        else {
            return Ok(None);
        };
        let (state, mode) = (State::from_number(state & 0x0f)?, Mode(state >> 4));
        let mut numbers = || {
            reader.bytes::<17>()?;
            let target = JointConfig::new(reader.f32s::<DOF>()?);
            reader.bytes::<56>()?;
            let (joints, joint_speeds) = (JointConfig::new(reader.f32s::<DOF>()?), reader.f32s()?);
            reader.bytes::<300>()?;
            let (position, axis_angle) = (reader.f32s()?.map(metres), reader.f32s()?);
            Some(Self {
                micros,
                state,
                mode,
                queued,
                target,
                joints,
                joint_speeds,
                position,
                axis_angle,
            })
        };
        Ok(numbers())
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let Self {
            micros,
            state,
            mode,
            queued,
            target,
            joints,
            joint_speeds,
            position,
            axis_angle,
        } = self;
        let mut writer = begin(FAST_BYTES);
        writer.u64(*micros).u8(*state as u8 | mode.0 << 4).u16(*queued).zeros(17);
        // Speeds and accelerations that should be; then accelerations, currents and torques that
        // are, and space.
        writer.f32s(&target[..]).zeros(56).f32s(&joints[..]).f32s(joint_speeds).zeros(252);
        // The pose that should be and its speed, then the pose that is.
        for _ in 0..2 {
            writer.f32s(&position.map(millimetres)).f32s(axis_angle).zeros(24);
        }
        let n = FAST_BYTES - writer.0.len();
        writer.zeros(n);
        writer.0
    }
}
