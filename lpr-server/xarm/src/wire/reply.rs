//! Replies of the controller, and the feedback that it sends unasked.

use super::bytes::{Reader, Writer};
use super::error::{Result, WireError};
use super::frame::Frame;
use super::pose::TcpPose;
use super::register;
use super::state::State;
use lpr_core::robot::{DOF, JointConfig};

/// Bytes of a text.
const TEXT_BYTES: usize = 40;

/// The bits that ride on every reply, also on successful ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Status(pub u8);

impl Status {
    /// The request was not understood, or did nothing.
    pub const INVALID: u8 = 0x08;
    /// The controller would not move now.
    pub const NOT_READY: u8 = 0x10;
    /// A warning waits to be read.
    pub const WARNING: u8 = 0x20;
    /// An error waits to be read.
    pub const ERROR: u8 = 0x40;

    /// True when any of `bits` is set.
    #[must_use]
    pub const fn has(self, bits: u8) -> bool {
        self.0 & bits != 0
    }
}

/// The answer to one request.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// The bits.
    pub status: Status,
    /// The parameters.
    pub answer: Answer,
}

/// Parameters of a reply.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// None.
    Done,
    /// Text, without the padding.
    Text(String),
    /// State.
    State(State),
    /// Motions in the queue.
    Count(u16),
    /// Error and warning.
    Codes(u8, u8),
    /// The motion was queued, with a byte on its check when the request had one.
    Queued(u16, Option<u8>),
    /// Joint angles, and what else was asked for, in groups of one number a joint.
    Joints(Vec<[f32; DOF]>),
    /// Pose of the tool.
    Pose(TcpPose),
    /// Yes or no.
    Flag(u8),
    /// The answer of a device: bus, then its frame.
    Rs485(Vec<u8>),
    /// A register of the tool's board.
    Value(i32),
    /// Parameters of a register that is not known here.
    Raw(Vec<u8>),
}

impl Reply {
    /// Its frame, in answer to `request`.
    #[must_use]
    pub fn to_frame(&self, request: &Frame) -> Frame {
        let mut writer = Writer::default();
        writer.u8(request.body[0]).u8(self.status.0);
        self.answer.write(&mut writer);
        Frame { transaction: request.transaction, protocol: request.protocol, body: writer.0 }
    }

    /// The reply of a frame; what its parameters are depends on the register.
    ///
    /// # Errors
    ///
    /// When they have another length than the register's.
    pub fn from_frame(frame: &Frame) -> Result<Self> {
        let (register, rest) = frame.register()?;
        let wrong = || WireError::Parameters { register, found: rest.len().saturating_sub(1) };
        let (status, params) = rest.split_first().ok_or_else(wrong)?;
        let status = Status(*status);
        // A request that was not understood has no parameters in its reply.
        if params.is_empty() {
            return Ok(Self { status, answer: Answer::Done });
        }
        let mut reader = Reader(params);
        let answer = read_answer(register, &mut reader)?;
        match answer {
            Some(answer) if reader.is_empty() => Ok(Self { status, answer }),
            _ => Err(wrong()),
        }
    }
}

impl Answer {
    fn write(&self, writer: &mut Writer) {
        match self {
            Self::Done => {}
            Self::Text(text) => {
                let n = text.len().min(TEXT_BYTES);
                writer.bytes(&text.as_bytes()[..n]).zeros(TEXT_BYTES - n);
            }
            Self::State(state) => _ = writer.u8(*state as u8),
            Self::Count(count) => _ = writer.u16(*count),
            Self::Codes(error, warning) => _ = writer.u8(*error).u8(*warning),
            Self::Queued(number, check) => _ = writer.u16(*number).bytes(check.as_slice()),
            Self::Joints(groups) => groups.iter().for_each(|group| _ = writer.f32s(group)),
            Self::Pose(pose) => pose.write(writer),
            Self::Flag(flag) => _ = writer.u8(*flag),
            Self::Rs485(bytes) | Self::Raw(bytes) => _ = writer.bytes(bytes),
            Self::Value(value) => _ = writer.i32_be(*value),
        }
    }

    /// The first group of joints.
    #[must_use]
    pub fn joints(&self) -> Option<JointConfig> {
        let Self::Joints(groups) = self else { return None };
        groups.first().copied().map(JointConfig::new)
    }
}

/// The answer of `register`; none when bytes are missing.
fn read_answer(register: u8, reader: &mut Reader<'_>) -> Result<Option<Answer>> {
    Ok(match register {
        register::GET_VERSION | register::GET_SERIAL => Some(read_text(reader)),
        register::GET_STATE => reader.u8().map(State::from_number).transpose()?.map(Answer::State),
        register::GET_COMMAND_COUNT => reader.u16().map(Answer::Count),
        register::GET_ERROR | register::GET_TOOL_ERROR => {
            reader.u8().zip(reader.u8()).map(|(error, warning)| Answer::Codes(error, warning))
        }
        register::MOVE_LINE..=register::SLEEP
        | register::SET_TCP_JERK..=register::SET_JOINT_ACCELERATION
        | register::SET_LOAD => reader.u16().map(|number| Answer::Queued(number, reader.u8())),
        register::GET_TCP_POSE | register::GET_FK => TcpPose::read(reader).map(Answer::Pose),
        register::GET_JOINTS | register::GET_IK | register::GET_JOINT_TORQUES => {
            Some(read_joints(reader))
        }
        register::IS_JOINT_LIMIT | register::IS_TCP_LIMIT => reader.u8().map(Answer::Flag),
        register::RS485 => Some(Answer::Rs485(reader.rest())),
        register::READ_TOOL_16 => reader.i32_be().map(Answer::Value),
        _ => Some(Answer::Raw(reader.rest())),
    })
}

fn read_text(reader: &mut Reader<'_>) -> Answer {
    let bytes = reader.rest();
    Answer::Text(String::from_utf8_lossy(&bytes).trim_end_matches('\0').to_owned())
}

fn read_joints(reader: &mut Reader<'_>) -> Answer {
    let mut groups = Vec::new();
    // Bytes that are no whole group stay behind and make the reply one of the wrong length.
    while reader.0.len() >= 4 * DOF
        && let Some(group) = reader.f32s()
    {
        groups.push(group);
    }
    Answer::Joints(groups)
}

/// Kind of a feedback frame; bits of [`super::Request::SetFeedback`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FeedbackKind {
    /// A motion begins.
    Start = 1,
    /// A motion is over.
    End = 2,
}

/// End of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FeedbackCode {
    /// As it should.
    Done = 0,
    /// It could not be done.
    Failed = 1,
    /// A stop removed it from the queue.
    Discarded = 2,
}

/// A frame that the controller sends unasked: a motion began or ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedback {
    /// That of the motion's request.
    pub transaction: u16,
    /// Protocol identifier of the motion's request.
    pub protocol: u16,
    /// Register of the motion.
    pub register: u8,
    /// Begin or end.
    pub kind: FeedbackKind,
    /// Its end.
    pub code: FeedbackCode,
    /// Number of the motion.
    pub task: u16,
    /// Time of the controller, microseconds.
    pub micros: u64,
}

impl Feedback {
    /// Its frame, with the bits of the moment.
    #[must_use]
    pub fn to_frame(&self, status: Status) -> Frame {
        let mut writer = Writer::default();
        writer.u8(register::FEEDBACK).u8(status.0).u8(self.kind as u8).u8(self.register);
        writer.u16(self.task).u8(self.code as u8).u64(self.micros);
        Frame { transaction: self.transaction, protocol: self.protocol, body: writer.0 }
    }
}
