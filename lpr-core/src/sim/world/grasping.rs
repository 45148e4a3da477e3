//! Grasping: a closing hand attaches what it reaches, an opening one lets go.
//!
//! Articulated handles are held by friction and caging; free objects are attached to the hand when
//! both pads touch them, as `RLBench` does, with their contacts to the robot switched off.

use super::World;
use super::gripper::{FIRM, Grasp};
use super::physics::{held_groups, scene_groups};
use crate::robot::{Gripper, HAND};
use crate::sim::scene::BodyKind;
use glamx::Vec3;
use rapier3d::prelude::{FixedJointBuilder, InteractionGroups, RigidBodyHandle};

/// The pads part by this much before a released object may touch them again, metres.
const RELEASE_GAP: f32 = 0.004;
/// Below this width a closed gripper holds nothing, metres.
const EMPTY_WIDTH: f32 = 0.001;

impl World {
    /// Reads the fingers' forces, attaches what a closing hand has reached and lets go of what an
    /// opening one held.
    pub(super) fn update_grasp(&mut self) {
        self.gripper.last_forces = self.gripper.forces;
        self.gripper.forces = self.finger_forces();
        match self.gripper.command {
            Gripper::Open => self.release(),
            Gripper::Close => self.take_hold(),
        }
    }

    fn take_hold(&mut self) {
        if self.gripper.attachment.is_some() {
            return;
        }
        if let Some(body) =
            (0..self.bodies.len()).find(|&body| self.is_graspable(body) && self.pads_touch(body))
        {
            self.attach(body);
            return;
        }
        let [left, right] = self.gripper.forces;
        let pinches = left + right > 0.0 && self.gripper.width > EMPTY_WIDTH;
        let firm = left.min(right) > FIRM * self.params.grip_force;
        self.gripper.grasp = match self.gripper.grasp {
            Grasp::Pinched if pinches => Grasp::Pinched,
            _ if pinches && firm => Grasp::Pinched,
            _ => Grasp::Nothing,
        };
    }

    /// Tells if both fingers are in contact with a body of the scene.
    pub(super) fn pads_touch(&self, body: usize) -> bool {
        self.fingers.iter().all(|finger| self.touching(*finger, self.bodies[body]))
    }

    fn touching(&self, finger: RigidBodyHandle, body: RigidBodyHandle) -> bool {
        self.physics.colliders_of(finger).iter().any(|pad| {
            self.physics.narrow_phase.contact_pairs_with(*pad).any(|pair| {
                let other = if pair.collider1 == *pad { pair.collider2 } else { pair.collider1 };
                pair.total_impulse_magnitude() > 0.0
                    && self.physics.colliders[other].parent() == Some(body)
            })
        })
    }

    fn attach(&mut self, body: usize) {
        let hand = self.links[HAND];
        let object = self.bodies[body];
        let hand_from_object =
            self.physics.bodies[hand].position().inv_mul(self.physics.bodies[object].position());
        let joint = FixedJointBuilder::new().local_frame1(hand_from_object).contacts_enabled(false);
        self.gripper.attachment =
            Some(self.physics.impulse_joints.insert(hand, object, joint, true));
        self.gripper.grasp = Grasp::Attached { body };
        self.gripper.released = None;
        self.set_held(object, held_groups());
    }

    fn set_held(&mut self, object: RigidBodyHandle, groups: InteractionGroups) {
        for collider in self.physics.bodies[object].colliders().to_vec() {
            self.physics.colliders[collider].set_collision_groups(groups);
        }
    }

    fn release(&mut self) {
        if let Some(joint) = self.gripper.attachment.take() {
            self.physics.impulse_joints.remove(joint, true);
            if let Grasp::Attached { body } = self.gripper.grasp {
                let hand_velocity = self.physics.bodies[self.links[HAND]].linvel();
                let object = &mut self.physics.bodies[self.bodies[body]];
                object.set_linvel(hand_velocity, true);
                object.set_angvel(Vec3::ZERO, true);
                self.gripper.released = Some((body, self.gripper.width));
            }
        }
        self.gripper.grasp = Grasp::Nothing;
        if let Some((body, width)) = self.gripper.released
            && self.gripper.width > width + RELEASE_GAP
        {
            self.set_held(self.bodies[body], scene_groups());
            self.gripper.released = None;
        }
    }

    /// Tells if a scene body is one that the hand is attached to when it closes on it.
    fn is_graspable(&self, body: usize) -> bool {
        self.spec.bodies[body].kind == BodyKind::Graspable
    }
}
