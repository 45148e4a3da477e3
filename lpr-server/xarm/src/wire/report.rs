//! Reports that the controller sends unasked, again and again, on ports of its own.

mod fast;

pub use fast::{FAST_BYTES, FastReport};

use super::bytes::{Reader, Writer, metres, millimetres};
use super::error::{Result, WireError};
use super::pose::TcpPose;
use super::state::{Mode, State};
use lpr_core::robot::{DOF, JointConfig};

/// Bytes of a [`RealtimeReport`].
pub const REALTIME_BYTES: usize = 135;
/// Bytes of a [`NormalReport`].
pub const NORMAL_BYTES: usize = 145;
/// Bytes of a [`RichReport`].
pub const RICH_BYTES: usize = 587;

/// Bytes of the length that a report begins with; it counts itself.
const LENGTH: usize = 4;
/// Bytes of the firmware's name in a rich report.
const FIRMWARE_BYTES: usize = 30;
/// Offset of the speeds of the moment in a rich report.
const SPEEDS: usize = 252;
/// Offset of the part that this program does not know.
const AFTER_SPEEDS: usize = 284;

/// Readings of the arm, with which every report but the fast one begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmReading {
    /// The state.
    pub state: State,
    /// The mode.
    pub mode: Mode,
    /// Motions in the queue.
    pub queued: u16,
    /// Joint angles, radians.
    pub joints: JointConfig,
    /// Pose of the tool.
    pub pose: TcpPose,
    /// Estimated torques, N m.
    pub torques: [f32; DOF],
}

/// Drives, errors and settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// One bit for each brake that is released.
    pub brakes: u8,
    /// One bit for each drive that is on.
    pub drives: u8,
    /// Error, 0 for none.
    pub error: u8,
    /// Warning, 0 for none.
    pub warning: u8,
    /// The tool in the flange's frame.
    pub tcp_offset: TcpPose,
    /// Mass of the tool, kg.
    pub load_mass: f32,
    /// Centre of mass of the tool, metres.
    pub load_center: [f64; 3],
    /// Sensitivity of collision detection, 0 (off) to 5.
    pub collision_sensitivity: u8,
    /// Sensitivity of hand guiding, 1 to 5.
    pub teach_sensitivity: u8,
    /// Direction of gravity.
    pub gravity: [f32; 3],
}

/// The report of port [`super::REALTIME_PORT`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RealtimeReport {
    /// Pose and state of the arm.
    pub arm: ArmReading,
    /// Force and torque at the sensor without the tool's weight, N and N m.
    pub external_force: [f32; 6],
    /// Force and torque at the sensor, N and N m.
    pub raw_force: [f32; 6],
}

/// The report of port [`super::NORMAL_PORT`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalReport {
    /// Pose and state of the arm.
    pub arm: ArmReading,
    /// Drives, errors and settings.
    pub health: Health,
}

/// The report of port [`super::RICH_PORT`]; what this program does not know is sent as zeros and
/// not read.
#[derive(Debug, Clone, PartialEq)]
pub struct RichReport {
    /// Pose and state of the arm.
    pub arm: ArmReading,
    /// Drives, errors and settings.
    pub health: Health,
    /// Name of the firmware, at most 30 bytes.
    pub firmware: String,
    /// Limits of the tool: jerk, least and greatest acceleration, least and greatest speed, in
    /// metres and seconds.
    pub tcp_limits: [f64; 5],
    /// Limits of the joints, as those of the tool in radians.
    pub joint_limits: [f32; 5],
    /// Speed of the tool, m/s.
    pub tcp_speed: f64,
    /// Speeds of the joints, rad/s.
    pub joint_speeds: [f32; DOF],
}

/// Which report a port sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportKind {
    /// [`FastReport`], 250 times a second.
    Fast,
    /// [`RealtimeReport`], 100 times a second.
    Realtime,
    /// [`NormalReport`], 5 times a second.
    Normal,
    /// [`RichReport`], 5 times a second.
    Rich,
}

/// A report of any kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Report {
    /// Of [`ReportKind::Fast`].
    Fast(FastReport),
    /// Of [`ReportKind::Realtime`].
    Realtime(RealtimeReport),
    /// Of [`ReportKind::Normal`].
    Normal(NormalReport),
    /// Of [`ReportKind::Rich`].
    Rich(Box<RichReport>),
}

/// Cuts a stream of bytes into reports of one kind.
#[derive(Debug)]
pub struct ReportReader {
    kind: ReportKind,
    buffer: Vec<u8>,
}

impl ReportKind {
    /// Bytes of one report, the length included.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Fast => FAST_BYTES,
            Self::Realtime => REALTIME_BYTES,
            Self::Normal => NORMAL_BYTES,
            Self::Rich => RICH_BYTES,
        }
    }
}

impl ReportReader {
    /// For the reports of one port.
    #[must_use]
    pub const fn new(kind: ReportKind) -> Self {
        Self { kind, buffer: Vec::new() }
    }

    /// Takes bytes as they arrive.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole report; none while bytes are missing.
    ///
    /// # Errors
    ///
    /// When it has another length than reports of its port, or a number in it is impossible; the
    /// connection has to be closed.
    pub fn next_report(&mut self) -> Result<Option<Report>> {
        let Some((length, rest)) = self.buffer.split_first_chunk::<LENGTH>() else {
            return Ok(None);
        };
        let (expected, found) = (self.kind.bytes(), u32::from_be_bytes(*length) as usize);
        if found != expected {
            return Err(WireError::ReportLength { expected, found });
        }
        let Some(body) = rest.get(..expected - LENGTH) else { return Ok(None) };
        let report = Report::read(self.kind, body)?;
        self.buffer.drain(..expected);
        Ok(report)
    }
}

impl Report {
    /// Pose and state of the arm; none of a fast report, which counts poses otherwise.
    #[must_use]
    pub const fn arm(&self) -> Option<&ArmReading> {
        match self {
            Self::Fast(_) => None,
            Self::Realtime(RealtimeReport { arm, .. }) | Self::Normal(NormalReport { arm, .. }) => {
                Some(arm)
            }
            Self::Rich(report) => Some(&report.arm),
        }
    }

    /// Its bytes.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        match self {
            Self::Fast(report) => report.encode(),
            Self::Realtime(report) => report.encode(),
            Self::Normal(report) => report.encode(),
            Self::Rich(report) => report.encode(),
        }
    }

    /// The report after its length; none when bytes are missing.
    fn read(kind: ReportKind, bytes: &[u8]) -> Result<Option<Self>> {
        let mut reader = Reader(bytes);
        if kind == ReportKind::Fast {
            return Ok(FastReport::read(&mut reader)?.map(Self::Fast));
        }
        let Some(arm) = ArmReading::read(&mut reader)? else { return Ok(None) };
        let report = match kind {
            ReportKind::Fast => None,
            ReportKind::Realtime => {
                let forces = reader.f32s().zip(reader.f32s());
                forces.map(|(external_force, raw_force)| {
                    Self::Realtime(RealtimeReport { arm, external_force, raw_force })
                })
            }
            ReportKind::Normal => {
                Health::read(&mut reader).map(|health| Self::Normal(NormalReport { arm, health }))
            }
            ReportKind::Rich => {
                let health = Health::read(&mut reader);
                let details = health.and_then(|health| read_details(arm, health, reader, bytes));
                details.map(|report| Self::Rich(Box::new(report)))
            }
        };
        Ok(report)
    }
}

impl RealtimeReport {
    fn encode(&self) -> Vec<u8> {
        let mut writer = begin(REALTIME_BYTES);
        self.arm.write(&mut writer);
        writer.f32s(&self.external_force).f32s(&self.raw_force);
        writer.0
    }
}

impl NormalReport {
    fn encode(&self) -> Vec<u8> {
        let mut writer = begin(NORMAL_BYTES);
        self.arm.write(&mut writer);
        self.health.write(&mut writer);
        writer.0
    }
}

impl RichReport {
    fn encode(&self) -> Vec<u8> {
        let mut writer = begin(RICH_BYTES);
        self.arm.write(&mut writer);
        self.health.write(&mut writer);
        // Type and number of axes, identifiers of master and slave, two of the motors.
        writer.bytes(&[DOF as u8, DOF as u8, 0xaa, 0x55, 0, 0]);
        let n = self.firmware.len().min(FIRMWARE_BYTES);
        writer.bytes(&self.firmware.as_bytes()[..n]).zeros(FIRMWARE_BYTES - n);
        writer.f32s(&self.tcp_limits.map(millimetres)).f32s(&self.joint_limits);
        let n = SPEEDS - writer.0.len();
        writer.zeros(n).f32s(&[millimetres(self.tcp_speed)]).f32s(&self.joint_speeds);
        debug_assert_eq!(writer.0.len(), AFTER_SPEEDS);
        writer.zeros(RICH_BYTES - AFTER_SPEEDS);
        writer.0
    }
}

/// The bytes of a report so far: its length.
fn begin(bytes: usize) -> Writer {
    let mut writer = Writer::default();
    writer.bytes(&(bytes as u32).to_be_bytes());
    writer
}

fn read_details(
    arm: ArmReading,
    health: Health,
    mut reader: Reader<'_>,
    bytes: &[u8],
) -> Option<RichReport> {
    reader.bytes::<6>()?;
    let firmware = reader.bytes::<FIRMWARE_BYTES>()?;
    let firmware = String::from_utf8_lossy(&firmware).trim_end_matches('\0').to_owned();
    let (tcp_limits, joint_limits) = (reader.f32s()?.map(metres), reader.f32s()?);
    let mut speeds = Reader(bytes.get(SPEEDS - LENGTH..)?);
    let (tcp_speed, joint_speeds) = (metres(speeds.f32()?), speeds.f32s()?);
    Some(RichReport { arm, health, firmware, tcp_limits, joint_limits, tcp_speed, joint_speeds })
}

impl ArmReading {
    fn read(reader: &mut Reader<'_>) -> Result<Option<Self>> {
        let Some((state, queued)) = reader.u8().zip(reader.u16()) else { return Ok(None) };
        let (state, mode) = (State::from_number(state & 0x0f)?, Mode(state >> 4));
        let Some(((joints, pose), torques)) =
            reader.f32s::<DOF>().zip(TcpPose::read(reader)).zip(reader.f32s())
        else {
            return Ok(None);
        };
        let joints = JointConfig::new(joints);
        if !joints.is_finite() {
            return Err(WireError::NotFinite("reported joint angle"));
        }
        Ok(Some(Self { state, mode, queued, joints, pose, torques }))
    }

    fn write(&self, writer: &mut Writer) {
        writer.u8(self.state as u8 | self.mode.0 << 4).u16(self.queued).f32s(&self.joints[..]);
        self.pose.write(writer);
        writer.f32s(&self.torques);
    }
}

impl Health {
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let [brakes, drives, error, warning] = reader.bytes()?;
        let (tcp_offset, load_mass, load_center) =
            (TcpPose::read(reader)?, reader.f32()?, reader.f32s()?.map(metres));
        let ([collision_sensitivity, teach_sensitivity], gravity) =
            (reader.bytes()?, reader.f32s()?);
        Some(Self {
            brakes,
            drives,
            error,
            warning,
            tcp_offset,
            load_mass,
            load_center,
            collision_sensitivity,
            teach_sensitivity,
            gravity,
        })
    }

    fn write(&self, writer: &mut Writer) {
        writer.bytes(&[self.brakes, self.drives, self.error, self.warning]);
        self.tcp_offset.write(writer);
        writer.f32s(&[self.load_mass]).f32s(&self.load_center.map(millimetres));
        writer.u8(self.collision_sensitivity).u8(self.teach_sensitivity).f32s(&self.gravity);
    }
}
