//! Frames of what moves, in f32: in the body that it stands on, in the world, and in the world for
//! each lane.

use crate::lanes::Vec3s;
use crate::robot::{JointMotion, Move, Robot, Sphere};
use fearless_simd::{Simd, SimdBase as _};
use glamx::{DVec3, Mat3, Pose3, Quat, Vec3};

/// Lanes of the widest vectors.
pub(super) const MAX_WIDTH: usize = 16;

/// An element of a rotation this close to 0 or ±1 is that: descriptions round π/2, and quarter
/// turns cost nothing.
const QUARTER_TURN_SLACK: f64 = 1e-5;

/// A joint's frame in the body that it stands on, in f32; the joint moves about or along its z.
#[derive(Debug, Clone, Copy)]
pub(super) struct MovingFrame {
    /// Body that it stands on.
    pub(super) parent: usize,
    /// Body that it carries.
    pub(super) body: usize,
    /// Joint whose position counts.
    pub(super) joint: usize,
    /// Multiplier and offset of a joint that follows that one.
    pub(super) follows: Option<(f32, f32)>,
    pub(super) rotation: Rotation,
    pub(super) translation: Vec3,
    pub(super) motion: JointMotion,
}

/// A rotation from the body before a joint.
#[derive(Debug, Clone, Copy)]
pub(super) enum Rotation {
    /// Every axis is one of the axes before, or against it: index and sign.
    QuarterTurns([(usize, f32); 3]),
    /// Any other.
    General(Mat3),
}

/// A frame in the world: its axes and origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    axes: [Vec3; 3],
    origin: Vec3,
}

impl MovingFrame {
    pub(super) fn new(robot: &Robot, step: &Move<'_>) -> Self {
        let Move { parent, body, joint, follower, .. } = *step;
        let (pose, motion) = match follower {
            Some(follower) => (follower.parent_from_joint, follower.motion),
            None => (robot.joints[joint].parent_from_joint(), robot.joints[joint].motion),
        };
        let follows = follower.map(|it| (it.multiplier as f32, it.offset as f32));
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * axis);
        let quarter = |column: DVec3| {
            let axis = column
                .to_array()
                .iter()
                .position(|e| (e.abs() - 1.0).abs() < QUARTER_TURN_SLACK)?;
            Some((axis, if column[axis] > 0.0 { 1.0 } else { -1.0 }))
        };
        let rotation = match columns.map(quarter) {
            [Some(x), Some(y), Some(z)] => Rotation::QuarterTurns([x, y, z]),
            _ => Rotation::General(Mat3::from_cols(
                columns[0].as_vec3(),
                columns[1].as_vec3(),
                columns[2].as_vec3(),
            )),
        };
        let translation = pose.translation.as_vec3();
        Self { parent, body, joint, follows, rotation, translation, motion }
    }

    /// Radians (or metres) that it moves for each of its joint.
    pub(super) fn multiplier(&self) -> f32 {
        self.follows.map_or(1.0, |(multiplier, _)| multiplier)
    }

    /// Its position where its joint is at `q`.
    pub(super) fn position(&self, q: f32) -> f32 {
        self.follows.map_or(q, |(multiplier, offset)| multiplier * q + offset)
    }
}

impl Frame {
    pub(super) const IDENTITY: Self = Self { axes: Vec3::AXES, origin: Vec3::ZERO };

    fn vector(&self, v: Vec3) -> Vec3 {
        self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z
    }

    /// The axis about or along which the joint moves that carries this frame.
    pub(super) const fn axis(&self) -> Vec3 {
        self.axes[2]
    }

    pub(super) const fn origin(&self) -> Vec3 {
        self.origin
    }

    /// The frame as a pose.
    pub(super) fn pose(&self) -> Pose3 {
        let [x, y, z] = self.axes;
        Pose3::from_parts(self.origin, Quat::from_mat3(&Mat3::from_cols(x, y, z)).normalize())
    }

    /// A point of this frame in the world.
    pub(super) fn point(&self, point: Vec3) -> Vec3 {
        self.vector(point) + self.origin
    }

    /// A sphere of this frame in the world.
    pub(super) fn sphere(&self, sphere: &Sphere) -> Sphere {
        Sphere { center: self.point(sphere.center), radius: sphere.radius }
    }

    /// The frame of the joint that follows, turned by `q`.
    pub(super) fn after(&self, joint: &MovingFrame, q: f32) -> Self {
        let [x, y, z] = match joint.rotation {
            Rotation::QuarterTurns(turns) => turns.map(|(axis, sign)| self.axes[axis] * sign),
            Rotation::General(rotation) => {
                [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| self.vector(axis))
            }
        };
        let origin = self.point(joint.translation);
        match joint.motion {
            JointMotion::Slide => Self { axes: [x, y, z], origin: origin + z * q },
            JointMotion::Turn => {
                let (sin, cos) = libm::sincosf(q);
                Self { axes: [x * cos + y * sin, y * cos - x * sin, z], origin }
            }
        }
    }
}

/// What carries a body; none of the base.
pub(super) fn carrier(moves: &[MovingFrame], body: usize) -> Option<&MovingFrame> {
    // Of a serial arm at its own place.
    let likely = body.checked_sub(1).and_then(|at| moves.get(at));
    likely.filter(|step| step.body == body).or_else(|| moves.iter().find(|step| step.body == body))
}

/// A frame in the world, for each lane.
#[derive(Clone, Copy)]
pub(super) struct Frames<S: Simd> {
    pub(super) axes: [Vec3s<S>; 3],
    pub(super) origin: Vec3s<S>,
}

impl<S: Simd> Frames<S> {
    #[inline(always)]
    pub(super) fn identity(simd: S) -> Self {
        let axes =
            [Vec3s::splat(simd, Vec3::X), Vec3s::splat(simd, Vec3::Y), Vec3s::splat(simd, Vec3::Z)];
        Self { axes, origin: Vec3s::splat(simd, Vec3::ZERO) }
    }

    /// The frame of one lane.
    pub(super) fn lane(&self, lane: usize) -> Frame {
        let vector = |v: &Vec3s<S>| {
            Vec3::new(v.x.as_slice()[lane], v.y.as_slice()[lane], v.z.as_slice()[lane])
        };
        Frame { axes: self.axes.each_ref().map(vector), origin: vector(&self.origin) }
    }

    /// One of the axes or its opposite.
    #[inline(always)]
    pub(super) fn along(&self, (axis, sign): (usize, f32)) -> Vec3s<S> {
        let axis = self.axes[axis];
        if sign < 0.0 { Vec3s { x: -axis.x, y: -axis.y, z: -axis.z } } else { axis }
    }

    #[inline(always)]
    pub(super) fn vector(&self, v: Vec3) -> Vec3s<S> {
        self.axes[0].times(v.x).add(self.axes[1].times(v.y)).add(self.axes[2].times(v.z))
    }

    /// A point of this frame in the world.
    #[inline(always)]
    pub(super) fn point(&self, v: Vec3) -> Vec3s<S> {
        self.vector(v).add(self.origin)
    }

    /// A point most of whose coordinates are 0.
    #[inline(always)]
    pub(super) fn offset(&self, v: Vec3) -> Vec3s<S> {
        let mut point = self.origin;
        for (axis, along) in [(0, v.x), (1, v.y), (2, v.z)] {
            if along != 0.0 {
                point = point.add(self.axes[axis].times(along));
            }
        }
        point
    }
}
