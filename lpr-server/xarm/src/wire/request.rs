//! Requests of a client to the controller, as values.

use super::bytes::{Reader, Writer, metres, millimetres};
use super::error::{Result, WireError};
use super::frame::Frame;
use super::gripper::Rtu;
use super::moves::{JointMove, LineMove, Pace, given, kept};
use super::pose::TcpPose;
use super::register;
use super::state::{Axis, Mode, Power, StateCommand};
use lpr_core::robot::{DOF, JointConfig};

/// A request, of the registers that this program knows.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// Axes, type, serial numbers and firmware as text.
    GetVersion,
    /// Serial numbers as text.
    GetSerial,
    /// Turns drives on or off.
    EnableMotion(Axis, Power),
    /// Runs, pauses or stops.
    SetState(StateCommand),
    /// The state.
    GetState,
    /// Asks for the number of queued motions.
    GetCommandCount,
    /// Error and warning.
    GetError,
    /// Forgets the error.
    CleanError,
    /// Forgets the warning.
    CleanWarning,
    /// Changes the mode; the second is a byte of firmware from 1.10.
    SetMode(Mode, Option<u8>),
    /// Moves the tool along a line.
    MoveLine(LineMove),
    /// Moves the joints.
    MoveJoints(JointMove),
    /// Moves the joints and blends with the next motion within the radius, metres.
    MoveJointsBlended {
        /// Target, radians; none keeps the joint.
        target: [Option<f32>; DOF],
        /// Of the joint that goes farthest; its duration is not sent.
        speed: f64,
        /// Of the joint that goes farthest, rad/s².
        acceleration: f64,
        /// Radius of the blend, metres.
        radius: f64,
    },
    /// Moves all joints to 0.
    MoveHome(Pace),
    /// Waits between motions, seconds.
    Sleep(f32),
    /// The next point of a stream in servo mode; the controller ignores the pace.
    ServoJoints(JointConfig, Pace),
    /// The pose of the tool.
    GetTcpPose,
    /// Joint angles; with a number, also velocities (2) and torques (3).
    GetJoints(Option<u8>),
    /// A configuration with that pose of the tool.
    GetIk(TcpPose),
    /// The pose of the tool in a configuration.
    GetFk(JointConfig),
    /// Asks if a configuration is outside the limits.
    IsJointLimit(JointConfig),
    /// Torques of the joints.
    GetJointTorques,
    /// Passes a frame on to a device at the tool.
    Rs485(Rtu),
    /// Writes a register of the tool's own board.
    WriteTool {
        /// Bus.
        host: u8,
        /// Its register.
        address: u16,
        /// Its new value.
        value: f32,
    },
    /// Reads a register of the tool's own board.
    ReadTool {
        /// Bus.
        host: u8,
        /// Its register.
        address: u16,
    },
    /// A motion that does nothing, to be told when the queue got there.
    FeedbackCheck,
    /// Which feedback frames motions received from now on send.
    SetFeedback(u8),
    /// Pose of the tool in the flange's frame.
    SetTcpOffset(TcpPose),
    /// Any other register.
    Other {
        /// Its number.
        register: u8,
        /// Its parameters.
        params: Vec<u8>,
    },
}

impl Request {
    /// Its register.
    #[must_use]
    pub const fn register(&self) -> u8 {
        match self {
            Self::GetVersion => register::GET_VERSION,
            Self::GetSerial => register::GET_SERIAL,
            Self::EnableMotion(..) => register::ENABLE_MOTION,
            Self::SetState(_) => register::SET_STATE,
            Self::GetState => register::GET_STATE,
            Self::GetCommandCount => register::GET_COMMAND_COUNT,
            Self::GetError => register::GET_ERROR,
            Self::CleanError => register::CLEAN_ERROR,
            Self::CleanWarning => register::CLEAN_WARNING,
            Self::SetMode(..) => register::SET_MODE,
            Self::MoveLine(_) => register::MOVE_LINE,
            Self::MoveJoints(_) => register::MOVE_JOINTS,
            Self::MoveJointsBlended { .. } => register::MOVE_JOINTS_BLENDED,
            Self::MoveHome(_) => register::MOVE_HOME,
            Self::Sleep(_) => register::SLEEP,
            Self::ServoJoints(..) => register::SERVO_JOINTS,
            Self::GetTcpPose => register::GET_TCP_POSE,
            Self::GetJoints(_) => register::GET_JOINTS,
            Self::GetIk(_) => register::GET_IK,
            Self::GetFk(_) => register::GET_FK,
            Self::IsJointLimit(_) => register::IS_JOINT_LIMIT,
            Self::GetJointTorques => register::GET_JOINT_TORQUES,
            Self::Rs485(_) => register::RS485,
            Self::WriteTool { .. } => register::WRITE_TOOL_16,
            Self::ReadTool { .. } => register::READ_TOOL_16,
            Self::FeedbackCheck => register::FEEDBACK_CHECK,
            Self::SetFeedback(_) => register::SET_FEEDBACK,
            Self::SetTcpOffset(_) => register::SET_TCP_OFFSET,
            Self::Other { register, .. } => *register,
        }
    }

    /// Its frame.
    #[must_use]
    pub fn to_frame(&self, transaction: u16, protocol: u16) -> Frame {
        let mut writer = Writer::default();
        writer.u8(self.register());
        self.write_params(&mut writer);
        Frame { transaction, protocol, body: writer.0 }
    }

    /// The request of a frame; a register that is not known here is [`Request::Other`].
    ///
    /// # Errors
    ///
    /// When the parameters of a known register have the wrong length or a value outside their
    /// range.
    pub fn from_frame(frame: &Frame) -> Result<Self> {
        let (register, params) = frame.register()?;
        let mut reader = Reader(params);
        let request = read_params(register, &mut reader)?;
        match request {
            Some(request) if reader.is_empty() => Ok(request),
            _ => Err(WireError::Parameters { register, found: params.len() }),
        }
    }

    fn write_params(&self, writer: &mut Writer) {
        match self {
            Self::EnableMotion(axis, power) => {
                _ = writer.u8(axis.0).u8(u8::from(*power == Power::On));
            }
            Self::SetState(command) => _ = writer.u8(*command as u8),
            Self::SetMode(mode, detection) => _ = writer.u8(mode.0).bytes(detection.as_slice()),
            Self::MoveLine(line) => line.write(writer),
            Self::MoveJoints(motion) => motion.write(writer),
            Self::MoveJointsBlended { target, speed, acceleration, radius } => {
                writer.f32s(&target.map(kept)).f32s(&[
                    *speed as f32,
                    *acceleration as f32,
                    millimetres(*radius),
                ]);
            }
            Self::MoveHome(pace) => pace.write(writer),
            Self::Sleep(seconds) => _ = writer.f32s(&[*seconds]),
            Self::ServoJoints(joints, pace) => pace.write(writer.f32s(&joints[..])),
            Self::GetJoints(n) => _ = writer.bytes(n.as_slice()),
            Self::GetIk(pose) | Self::SetTcpOffset(pose) => pose.write(writer),
            Self::GetFk(joints) | Self::IsJointLimit(joints) => _ = writer.f32s(&joints[..]),
            Self::Rs485(rtu) => rtu.write(writer),
            Self::WriteTool { host, address, value } => {
                _ = writer.u8(*host).u16(*address).f32s(&[*value]);
            }
            Self::ReadTool { host, address } => _ = writer.u8(*host).u16(*address),
            Self::SetFeedback(mask) => _ = writer.u8(*mask),
            Self::Other { params, .. } => _ = writer.bytes(params),
            Self::GetVersion
            | Self::GetSerial
            | Self::GetState
            | Self::GetCommandCount
            | Self::GetError
            | Self::CleanError
            | Self::CleanWarning
            | Self::GetTcpPose
            | Self::GetJointTorques
            | Self::FeedbackCheck => {}
        }
    }
}

/// The request to `register`; none when bytes are missing.
fn read_params(register: u8, reader: &mut Reader<'_>) -> Result<Option<Request>> {
    let out_of_range =
        |name, value: u8| WireError::Value { register, name, value: value.to_string() };
    Ok(match register {
        register::GET_VERSION => Some(Request::GetVersion),
        register::GET_SERIAL => Some(Request::GetSerial),
        register::ENABLE_MOTION => reader.u8().zip(reader.u8()).map(|(axis, on)| {
            Request::EnableMotion(Axis(axis), if on == 0 { Power::Off } else { Power::On })
        }),
        register::SET_STATE => match reader.u8() {
            Some(number) => Some(Request::SetState(
                StateCommand::from_number(number).ok_or_else(|| out_of_range("state", number))?,
            )),
            None => None,
        },
        register::GET_STATE => Some(Request::GetState),
        register::GET_COMMAND_COUNT => Some(Request::GetCommandCount),
        register::GET_ERROR => Some(Request::GetError),
        register::CLEAN_ERROR => Some(Request::CleanError),
        register::CLEAN_WARNING => Some(Request::CleanWarning),
        register::SET_MODE => reader.u8().map(|mode| Request::SetMode(Mode(mode), reader.u8())),
        register::MOVE_LINE => LineMove::read(reader).map(Request::MoveLine),
        register::MOVE_JOINTS => JointMove::read(reader).map(Request::MoveJoints),
        register::MOVE_JOINTS_BLENDED => read_blended(reader),
        register::MOVE_HOME => Pace::read(reader).map(Request::MoveHome),
        register::SLEEP => reader.f32().map(Request::Sleep),
        register::SERVO_JOINTS => reader
            .f32s::<DOF>()
            .zip(Pace::read(reader))
            .map(|(joints, pace)| Request::ServoJoints(JointConfig::new(joints), pace)),
        register::GET_TCP_POSE => Some(Request::GetTcpPose),
        register::GET_JOINTS => Some(Request::GetJoints(reader.u8())),
        register::GET_IK => read_ik(reader),
        register::GET_FK => {
            reader.f32s::<DOF>().map(|joints| Request::GetFk(JointConfig::new(joints)))
        }
        register::IS_JOINT_LIMIT => {
            reader.f32s::<DOF>().map(|joints| Request::IsJointLimit(JointConfig::new(joints)))
        }
        register::GET_JOINT_TORQUES => Some(Request::GetJointTorques),
        register::RS485 => Rtu::read(reader).map(Request::Rs485),
        register::WRITE_TOOL_16 => read_tool_write(reader),
        register::READ_TOOL_16 => {
            reader.u8().zip(reader.u16()).map(|(host, address)| Request::ReadTool { host, address })
        }
        register::FEEDBACK_CHECK => Some(Request::FeedbackCheck),
        register::SET_FEEDBACK => reader.u8().map(Request::SetFeedback),
        register::SET_TCP_OFFSET => TcpPose::read(reader).map(Request::SetTcpOffset),
        register => Some(Request::Other { register, params: reader.rest() }),
    })
}

fn read_blended(reader: &mut Reader<'_>) -> Option<Request> {
    let (target, [speed, acceleration, radius]) = (reader.f32s()?.map(given), reader.f32s()?);
    let (speed, acceleration) = (f64::from(speed), f64::from(acceleration));
    Some(Request::MoveJointsBlended { target, speed, acceleration, radius: metres(radius) })
}

/// The reference configuration that newer firmware takes is not used: nearest to where the arm is.
fn read_ik(reader: &mut Reader<'_>) -> Option<Request> {
    let pose = TcpPose::read(reader)?;
    let _ = reader.rest();
    Some(Request::GetIk(pose))
}

fn read_tool_write(reader: &mut Reader<'_>) -> Option<Request> {
    let (host, address, value) = (reader.u8()?, reader.u16()?, reader.f32()?);
    // A trailing byte says when outputs switch, which has no meaning for a board without outputs.
    let _ = reader.rest();
    Some(Request::WriteTool { host, address, value })
}
