//! A scene as data: one value drives physics, pictures and drawings.

mod check;

use crate::scene::Part;
use glamx::{Pose3, Vec3};
use serde::{Deserialize, Serialize};

/// Everything in a scene but the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Name of the task it belongs to.
    pub task: String,
    /// Bodies; other fields refer to them by index.
    pub bodies: Vec<BodySpec>,
    /// Hinges and slides between bodies.
    pub joints: Vec<JointSpec>,
    /// The task is done when all of these hold.
    pub success: Vec<Condition>,
}

impl SceneSpec {
    /// Moves everything from the task frame to the world. Upright zones stay upright:
    /// `world_from_task` is a yaw and a shift.
    pub(super) fn place(&mut self, world_from_task: &Pose3) {
        for body in &mut self.bodies {
            body.pose = *world_from_task * body.pose;
        }
        for joint in &mut self.joints {
            joint.anchor = world_from_task.transform_point(joint.anchor);
            joint.axis = world_from_task.transform_vector(joint.axis);
        }
        for condition in &mut self.success {
            if let Condition::BodyInZone { zone, .. }
            | Condition::BodyOutsideZone { zone, .. }
            | Condition::GripInZone { zone } = condition
            {
                match zone {
                    Zone::Cuboid { pose, .. } => *pose = *world_from_task * *pose,
                    Zone::Cylinder { center, .. } => {
                        *center = world_from_task.transform_point(*center);
                    }
                }
            }
        }
    }
}

/// A rigid body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySpec {
    /// Name, unique in the scene.
    pub name: String,
    /// Its part in the physics.
    pub kind: BodyKind,
    /// `world_from_body` at the start.
    pub pose: Pose3,
    /// Its geometry.
    pub parts: Vec<Part>,
    /// Mass, kg (0 for bodies that do not move).
    pub mass: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
}

/// Part of a body in the physics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyKind {
    /// Seen, never touched.
    Visual,
    /// Never moves.
    Fixed,
    /// Moves, and is held by friction or caging only.
    Dynamic,
    /// Moves, and is attached to a hand that closes on it.
    Graspable,
}

/// A hinge or slide with one degree of freedom; its coordinate is `start` at the bodies' start
/// poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpec {
    /// Name, unique in the scene.
    pub name: String,
    /// Hinge or slide.
    pub kind: JointKind,
    /// Body index of the fixed side.
    pub parent: usize,
    /// Body index of the moving side.
    pub child: usize,
    /// A point of the axis in the world at the start, metres.
    pub anchor: Vec3,
    /// Unit axis in the world at the start.
    pub axis: Vec3,
    /// Limits of the coordinate, radians or metres.
    pub limits: [f32; 2],
    /// The coordinate at the start, radians or metres.
    pub start: f32,
    /// Dry friction of the joint, N·m or N.
    pub brake: f32,
    /// Stiffness of the spring that drives the joint back to `start`, N·m/rad or N/m; 0 where there
    /// is a brake.
    #[serde(default)]
    pub spring: f32,
    /// Latch that keeps the joint at `start`.
    #[serde(default)]
    pub latch: Option<Latch>,
}

/// A latch: it keeps a joint at its start until another joint has moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Latch {
    /// Joint index of what opens it.
    pub joint: usize,
    /// Least motion of that joint, radians or metres.
    pub min: f32,
}

/// The motion that a joint leaves free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Rotation about the axis.
    Revolute,
    /// Translation along the axis.
    Prismatic,
}

/// A region of the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Zone {
    /// A box.
    Cuboid {
        /// `world_from_zone`.
        pose: Pose3,
        /// Half the side lengths, metres.
        half_extents: Vec3,
    },
    /// An upright cylinder.
    Cylinder {
        /// Centre, metres.
        center: Vec3,
        /// Radius, metres.
        radius: f32,
        /// Half the height, metres.
        half_height: f32,
    },
}

impl Zone {
    /// Tells if a point of the world lies inside.
    #[must_use]
    pub fn contains(&self, point: Vec3) -> bool {
        match *self {
            Self::Cuboid { pose, half_extents } => {
                pose.inverse_transform_point(point).abs().cmple(half_extents).all()
            }
            Self::Cylinder { center, radius, half_height } => {
                let offset = point - center;
                offset.x * offset.x + offset.y * offset.y <= radius * radius
                    && offset.z.abs() <= half_height
            }
        }
    }
}

/// One condition for success.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Condition {
    /// A joint has moved by more than `min` from its start.
    JointMoved {
        /// Joint index.
        joint: usize,
        /// Radians or metres.
        min: f32,
    },
    /// A point of a body lies in a zone.
    BodyInZone {
        /// Body index.
        body: usize,
        /// The point in the body's frame, metres.
        point: Vec3,
        /// The zone.
        zone: Zone,
    },
    /// A point of a body lies outside a zone.
    BodyOutsideZone {
        /// Body index.
        body: usize,
        /// The point in the body's frame, metres.
        point: Vec3,
        /// The zone.
        zone: Zone,
    },
    /// The grip lies in a zone.
    GripInZone {
        /// The zone.
        zone: Zone,
    },
    /// The hand holds nothing.
    NothingGrasped,
    /// The hand holds the body.
    Grasped {
        /// Body index.
        body: usize,
    },
}
