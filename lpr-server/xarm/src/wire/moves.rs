//! Motions that the controller is asked for, and their parameters as bytes.

use super::bytes::{Reader, Writer, metres, millimetres};
use lpr_core::robot::DOF;

/// To move or only to say if it could: a byte that older firmware does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Check {
    /// The byte is absent: it moves.
    Absent,
    /// It moves.
    Move,
    /// It only says if it could.
    Only,
}

/// Speed of a motion; metres for lines and radians for joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Per second.
    pub speed: f64,
    /// Per second squared.
    pub acceleration: f64,
    /// Reserved; the vendor's client sends 0, seconds.
    pub duration: f64,
}

/// A motion in joint space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMove {
    /// Target, radians; none keeps the joint (infinity on the wire).
    pub target: [Option<f32>; DOF],
    /// Of the joint that goes farthest.
    pub pace: Pace,
    /// To move, or only to say if it could.
    pub check: Check,
}

/// The end of a [`LineMove`], after its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LineForm {
    /// Firmware before 1.11.100.
    Classic,
    /// Later firmware.
    Common {
        /// Radius of the blend to the next motion, metres; none stops.
        radius: Option<f64>,
        /// 0 base, 1 tool.
        frame: u8,
        /// 0 roll, pitch and yaw; 1 axis times angle.
        rotation: u8,
        /// To move, or only to say if it could: [`Check::Absent`] does not occur.
        check: Check,
        /// A byte that firmware from 2.3 has.
        kind: Option<u8>,
    },
}

/// A motion of the tool along a straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineMove {
    /// Target: x, y, z in metres, roll, pitch, yaw in radians; none keeps the component (infinity
    /// on the wire).
    pub target: [Option<f64>; 6],
    /// Of the tool.
    pub pace: Pace,
    /// The end of its frame.
    pub form: LineForm,
}

impl Pace {
    /// The pace of joints; that of a line has millimetres.
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let [speed, acceleration, duration] = reader.f32s()?.map(f64::from);
        Some(Self { speed, acceleration, duration })
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        writer.f32s(&[self.speed as f32, self.acceleration as f32, self.duration as f32]);
    }
}

impl JointMove {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let (target, pace) = (reader.f32s()?.map(given), Pace::read(reader)?);
        let check = reader.u8().map_or(Check::Absent, Check::of);
        Some(Self { target, pace, check })
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        writer.f32s(&self.target.map(kept));
        self.pace.write(writer);
        writer.bytes(self.check.byte().as_slice());
    }
}

impl LineMove {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let numbers: [f32; 6] = reader.f32s()?;
        let target = core::array::from_fn(|i| {
            let value = given(numbers[i])?;
            Some(if i < 3 { metres(value) } else { f64::from(value) })
        });
        let [speed, acceleration, duration] = reader.f32s()?;
        let pace = Pace {
            speed: metres(speed),
            acceleration: metres(acceleration),
            duration: f64::from(duration),
        };
        let form =
            if reader.is_empty() { LineForm::Classic } else { LineForm::read_common(reader)? };
        Some(Self { target, pace, form })
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        let Self { target, pace, form } = self;
        for (i, component) in target.iter().enumerate() {
            let value =
                component.map(|value| if i < 3 { millimetres(value) } else { value as f32 });
            writer.f32s(&[kept(value)]);
        }
        writer.f32s(&[
            millimetres(pace.speed),
            millimetres(pace.acceleration),
            pace.duration as f32,
        ]);
        if let LineForm::Common { radius, frame, rotation, check, kind } = form {
            writer.f32s(&[radius.map_or(-1.0, millimetres)]).u8(*frame).u8(*rotation);
            writer.u8(check.byte().unwrap_or_default()).bytes(kind.as_slice());
        }
    }
}

impl LineForm {
    fn read_common(reader: &mut Reader<'_>) -> Option<Self> {
        let radius = reader.f32()?;
        let (frame, rotation, check) = (reader.u8()?, reader.u8()?, Check::of(reader.u8()?));
        Some(Self::Common {
            radius: (radius >= 0.0).then(|| metres(radius)),
            frame,
            rotation,
            check,
            kind: reader.u8(),
        })
    }
}

impl Check {
    const fn of(byte: u8) -> Self {
        if byte == 0 { Self::Move } else { Self::Only }
    }

    const fn byte(self) -> Option<u8> {
        match self {
            Self::Absent => None,
            Self::Move => Some(0),
            Self::Only => Some(1),
        }
    }
}

/// A component as the wire has it: positive infinity keeps where it is.
pub(super) fn given(value: f32) -> Option<f32> {
    (value != f32::INFINITY).then_some(value)
}

/// The opposite of [`given`].
pub(super) fn kept(component: Option<f32>) -> f32 {
    component.unwrap_or(f32::INFINITY)
}
