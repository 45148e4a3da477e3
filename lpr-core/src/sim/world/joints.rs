//! Hinges and slides of the scene: where they are, how far off their axes, and their latches.

use super::World;
use super::physics::Latched;
use crate::sim::scene::{BodyKind, JointKind, JointSpec};
use glamx::{Pose3, Quat, Vec3};
use std::sync::Arc;

/// Least distance of a latched joint from its start at which its latch misses it, radians or
/// metres.
const LATCH_DEPTH: f32 = 0.02;

impl World {
    /// Motion of a body since the start, in the world.
    fn motion(&self, body: usize) -> Pose3 {
        self.body_pose(body) * self.spec.bodies[body].pose.inverse()
    }

    /// Motion of a joint's child since the start, as if its parent had stayed.
    fn joint_motion(&self, spec: &JointSpec) -> Pose3 {
        match self.spec.bodies[spec.parent].kind {
            BodyKind::Visual | BodyKind::Fixed => self.motion(spec.child),
            BodyKind::Dynamic | BodyKind::Graspable => {
                self.motion(spec.parent).inverse() * self.motion(spec.child)
            }
        }
    }

    /// Coordinate of a joint now, radians or metres.
    #[must_use]
    pub fn joint_position(&self, joint: usize) -> f32 {
        let spec = &self.spec.joints[joint];
        let moved = self.joint_motion(spec);
        match spec.kind {
            JointKind::Prismatic => {
                spec.start + (moved.transform_point(spec.anchor) - spec.anchor).dot(spec.axis)
            }
            JointKind::Revolute => {
                // The twist about the axis: of the quaternion's vector part only what lies along it
                // counts, so that a hinge that gives way sideways is still read right.
                let rotation = moved.rotation;
                let along = Vec3::new(rotation.x, rotation.y, rotation.z).dot(spec.axis);
                let angle = 2.0 * libm::atan2f(along, rotation.w);
                // Within half a turn of the middle of the range.
                let middle = 0.5 * (spec.limits[0] + spec.limits[1]) - spec.start;
                let turns = libm::roundf((angle - middle) / core::f32::consts::TAU);
                spec.start + angle - turns * core::f32::consts::TAU
            }
        }
    }

    /// Coordinates of all joints now, radians or metres.
    #[must_use]
    pub fn joint_positions(&self) -> Vec<f32> {
        (0..self.joints.len()).map(|joint| self.joint_position(joint)).collect()
    }

    /// Deviation of a joint's child from its axis now: metres at the anchor and radians, without
    /// the free motion.
    #[must_use]
    pub fn joint_deviation(&self, joint: usize) -> (f32, f32) {
        let spec = &self.spec.joints[joint];
        let moved = self.joint_motion(spec);
        let travel = self.joint_position(joint) - spec.start;
        let expected = match spec.kind {
            JointKind::Prismatic => Pose3::from_translation(spec.axis * travel),
            JointKind::Revolute => {
                let turn = Pose3::from_rotation(Quat::from_axis_angle(spec.axis, travel));
                Pose3::from_translation(spec.anchor) * turn * Pose3::from_translation(-spec.anchor)
            }
        };
        let shift =
            moved.transform_point(spec.anchor).distance(expected.transform_point(spec.anchor));
        (shift, moved.rotation.angle_between(expected.rotation))
    }

    /// A latch holds while its joint is at the start and what opens it has not moved far enough.
    pub(super) fn update_latches(&mut self) {
        let spec = Arc::clone(&self.spec);
        let moved = |world: &Self, joint: usize| {
            (world.joint_position(joint) - spec.joints[joint].start).abs()
        };
        for (idx, joint) in spec.joints.iter().enumerate() {
            let Some(latch) = joint.latch else { continue };
            let is_open = moved(self, idx) > LATCH_DEPTH || moved(self, latch.joint) > latch.min;
            self.physics.set_latched(
                self.joints[idx],
                joint,
                if is_open { Latched::No } else { Latched::Yes },
            );
        }
    }
}
