//! A scene as data: one value drives physics, pictures and drawings.

use crate::error::{Error, Result};
use crate::scene::{Part, Shape};
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
                        *center = world_from_task.transform_point(*center)
                    }
                }
            }
        }
    }
}

impl SceneSpec {
    /// Checks sizes, poses and indices: what a scene of a file must keep to, so that physics and
    /// pictures can be built from it.
    ///
    /// # Errors
    ///
    /// Naming the body, joint or condition at fault.
    pub fn check(&self) -> Result<()> {
        let broken =
            |what: String| Error::Environment(format!("scene of task '{}': {what}", self.task));
        let no_body = |body: usize| self.bodies.get(body).is_none();
        if self.bodies.len() > MAX_BODIES {
            return Err(broken(format!(
                "bodies: expected at most {MAX_BODIES}, found {}",
                self.bodies.len()
            )));
        }
        for body in &self.bodies {
            let name = &body.name;
            let weights = [body.mass, body.friction];
            if !is_pose(&body.pose)
                || !body.parts.iter().all(|part| is_pose(&part.pose) && has_volume(&part.shape))
            {
                return Err(broken(format!(
                    "body '{name}': expected unit quaternions, sizes above 0 and lengths up to {FAR} m"
                )));
            }
            if !weights.iter().all(|weight| (0.0..=HEAVY).contains(weight)) {
                return Err(broken(format!(
                    "body '{name}': expected mass and friction from 0 to {HEAVY}"
                )));
            }
        }
        for joint in &self.joints {
            let name = &joint.name;
            if joint.parent == joint.child || no_body(joint.parent) || no_body(joint.child) {
                return Err(broken(format!("joint '{name}': expected two bodies of the scene")));
            }
            if joint
                .latch
                .is_some_and(|latch| latch.joint >= self.joints.len() || latch.min.is_nan())
            {
                return Err(broken(format!(
                    "joint '{name}': its latch names a joint that is not there"
                )));
            }
            if joint.brake > 0.0 && joint.spring > 0.0 {
                return Err(broken(format!(
                    "joint '{name}': expected a brake or a spring, not both"
                )));
            }
            let numbers =
                [joint.limits[0], joint.limits[1], joint.start, joint.brake, joint.spring];
            let is_placed =
                is_near(joint.anchor) && (joint.axis.length() - 1.0).abs() < UNIT_TOLERANCE;
            if !is_placed
                || !numbers.iter().all(|number| number.is_finite())
                || joint.limits[0] > joint.limits[1]
            {
                return Err(broken(format!(
                    "joint '{name}': expected a unit axis and ascending limits"
                )));
            }
        }
        let is_absent = |condition: &Condition| match *condition {
            Condition::JointMoved { joint, .. } => self.joints.get(joint).is_none(),
            Condition::BodyInZone { body, .. }
            | Condition::BodyOutsideZone { body, .. }
            | Condition::Grasped { body } => no_body(body),
            Condition::GripInZone { .. } | Condition::NothingGrasped => false,
        };
        match self.success.iter().position(is_absent) {
            Some(idx) => {
                Err(broken(format!("success[{idx}]: names a body or joint that is not there")))
            }
            None => Ok(()),
        }
    }
}

/// How far the length of a unit axis or quaternion may be from 1.
const UNIT_TOLERANCE: f32 = 1e-3;

/// Most bodies of a scene: masks hold their indices in 16 bits, and no table has room for more.
const MAX_BODIES: usize = 1000;
/// Farthest that anything may be, and its greatest size, metres: squares and cubes of it are still
/// ordinary numbers.
const FAR: f32 = 100.0;
/// Greatest mass and friction, kg and 1.
const HEAVY: f32 = 1e5;

fn is_near(point: Vec3) -> bool {
    // False for NaN.
    point.abs().cmple(Vec3::splat(FAR)).all()
}

fn is_pose(pose: &Pose3) -> bool {
    is_near(pose.translation) && (pose.rotation.length() - 1.0).abs() < UNIT_TOLERANCE
}

fn has_volume(shape: &Shape) -> bool {
    let above_zero = |lengths: &[f32]| lengths.iter().all(|length| *length > 0.0 && *length <= FAR);
    match shape {
        Shape::Sphere { radius } => above_zero(&[*radius]),
        Shape::Cuboid { half_extents } => above_zero(&half_extents.to_array()),
        Shape::Cylinder { radius, half_length } => above_zero(&[*radius, *half_length]),
        Shape::Capsule { radius, half_length } => {
            above_zero(&[*radius]) && (0.0..=FAR).contains(half_length)
        }
        Shape::Convex { points } => points.len() >= 4 && points.iter().all(|point| is_near(*point)),
    }
}

/// A rigid body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySpec {
    /// Name, unique in the scene.
    pub name: String,
    /// How it moves.
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

/// How a body takes part in the physics.
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
    /// What drives the joint back to `start`, N·m/rad or N/m; 0 where there is a brake.
    #[serde(default)]
    pub spring: f32,
    /// What keeps the joint at `start`.
    #[serde(default)]
    pub latch: Option<Latch>,
}

/// A latch: it keeps a joint at its start until another joint has moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Latch {
    /// Joint index of what opens it.
    pub joint: usize,
    /// How far that joint has to move, radians or metres.
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
    /// Whether a point of the world lies inside.
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

#[cfg(test)]
mod tests {
    use super::super::place;
    use super::super::tasks::{TASKS, Task};
    use super::*;
    use crate::robot::XARM7;

    fn drawer() -> SceneSpec {
        let task = Task::by_name("open_drawer").expect("a task");
        place(task, 0, &XARM7, 0).expect("a scene that can be placed").scene.spec
    }

    #[test]
    fn every_placed_scene_passes() {
        for task in TASKS {
            let scene = place(task, 0, &XARM7, 1).expect("a scene that can be placed").scene;
            assert_eq!(scene.spec.check(), Ok(()));
        }
    }

    #[test]
    fn what_physics_cannot_build_is_named() {
        let refusal = |change: &dyn Fn(&mut SceneSpec)| {
            let mut scene = drawer();
            change(&mut scene);
            scene.check().expect_err("a broken scene").to_string()
        };
        let broken_size =
            |scene: &mut SceneSpec| scene.bodies[0].parts[0].shape = Shape::Sphere { radius: -1.0 };
        assert!(refusal(&broken_size).contains(&drawer().bodies[0].name));
        assert!(refusal(&|scene| scene.bodies[0].mass = f32::NAN).contains("mass"));
        assert!(refusal(&|scene| scene.bodies[0].mass = 1e30).contains("mass"));
        assert!(
            refusal(&|scene| scene.bodies[0].pose.translation.x = 1e30).contains("up to 100 m")
        );
        assert!(
            refusal(&|scene| scene.bodies = vec![scene.bodies[0].clone(); 2000])
                .contains("at most 1000, found 2000")
        );
        assert!(refusal(&|scene| scene.joints[0].child = 99).contains("expected two bodies"));
        assert!(refusal(&|scene| scene.joints[0].axis = Vec3::ZERO).contains("unit axis"));
        let braked_spring =
            |scene: &mut SceneSpec| (scene.joints[0].brake, scene.joints[0].spring) = (1.0, 1.0);
        assert!(refusal(&braked_spring).contains("a brake or a spring"));
        assert!(
            refusal(&|scene| scene.joints[0].latch = Some(Latch { joint: 99, min: 0.1 }))
                .contains("latch")
        );
        assert!(
            refusal(&|scene| scene.success = vec![Condition::Grasped { body: 99 }])
                .contains("success[0]")
        );
    }
}
