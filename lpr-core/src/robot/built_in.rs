//! Notation of the built-in arms.

use super::{
    Capsule, DOF, DhRow, GripperSpec, HAND, Joint, JointConfig, JointMotion, JointOrigin, Link,
    MAX_OVERSHOOT, N_LINKS, Robot, Sphere,
};
use glamx::{DPose3, Vec2};
use std::sync::Arc;

/// One revolute joint of a built-in arm.
#[derive(Clone, Copy)]
pub(super) struct BuiltInJoint {
    pub(super) row: DhRow,
    /// Radians.
    pub(super) lower: f32,
    /// Radians.
    pub(super) upper: f32,
    /// rad/s.
    pub(super) max_velocity: f32,
    /// rad/s².
    pub(super) max_acceleration: f32,
}

/// A built-in arm, whose geometry is constant.
pub(super) struct BuiltIn {
    pub(super) name: &'static str,
    pub(super) joints: [BuiltInJoint; DOF],
    pub(super) link7_from_flange: DPose3,
    pub(super) flange_from_grip: DPose3,
    pub(super) gripper: GripperSpec,
    pub(super) start: JointConfig,
    pub(super) workspace_center: Vec2,
    /// Per frame: base, links 1–7, hand without fingers.
    pub(super) capsules: [&'static [Capsule]; N_LINKS],
    /// They cover the capsules, the hand's the open fingers too, by at most [`MAX_OVERSHOOT`].
    pub(super) spheres: [&'static [Sphere]; N_LINKS],
    pub(super) allowed_self_collisions: &'static [(usize, usize)],
}

impl BuiltIn {
    pub(super) fn shared(self) -> Arc<Robot> {
        let joint = |(j, joint): (usize, BuiltInJoint)| Joint {
            name: format!("joint{}", j + 1),
            origin: JointOrigin::ModifiedDh(joint.row),
            motion: JointMotion::Turn,
            lower: joint.lower,
            upper: joint.upper,
            is_continuous: false,
            max_velocity: joint.max_velocity,
            max_acceleration: joint.max_acceleration,
        };
        let mut allowed_self_collisions = self.allowed_self_collisions.to_vec();
        allowed_self_collisions.sort_unstable();
        Arc::new(Robot {
            name: self.name.to_owned(),
            joints: self.joints.into_iter().enumerate().map(joint).collect(),
            followers: Vec::new(),
            body_from_flange: self.link7_from_flange,
            flange_from_grip: self.flange_from_grip,
            links: (0..N_LINKS).map(|frame| self.link(frame)).collect(),
            allowed_self_collisions,
            close_pairs: Vec::new(),
            start: self.start,
            gripper: Some(self.gripper),
            workspace_center: Some(self.workspace_center),
        })
    }

    fn link(&self, frame: usize) -> Link {
        let (name, body_from_link) = match frame {
            0 => ("base".to_owned(), DPose3::IDENTITY),
            HAND => ("hand".to_owned(), self.link7_from_flange),
            link => (format!("link{link}"), DPose3::IDENTITY),
        };
        Link {
            name,
            body: frame.min(DOF),
            body_from_link,
            body_from_shapes: body_from_link,
            spheres: self.spheres[frame].to_vec(),
            capsules: self.capsules[frame].to_vec(),
            overshoot: MAX_OVERSHOOT,
            solids: Vec::new(),
            is_exact: false,
        }
    }
}
