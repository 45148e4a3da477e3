//! Contacts that end an episode: the arm inside a fixed body, or pressed against something harder
//! than a real arm would.

use super::World;
use super::fixed::FixedPart;
use crate::env::InvalidAction;
use crate::robot::N_LINKS;
use glamx::{Pose3, Vec3};
use rapier3d::parry::bounding_volume::BoundingVolume as _;
use rapier3d::parry::query::contact;
use rapier3d::parry::shape::Shape;
use rapier3d::prelude::RigidBodyHandle;

impl World {
    /// Contact force on a robot body: the magnitude of the sum over its contacts, newtons.
    ///
    /// Normal forces only: rapier's contact pairs do not report friction.
    pub(super) fn contact_force(&self, body: RigidBodyHandle) -> f32 {
        let mut impulse = Vec3::ZERO;
        for collider in self.physics.colliders_of(body) {
            for pair in self.physics.narrow_phase.contact_pairs_with(*collider) {
                let sign = if pair.collider1 == *collider { 1.0 } else { -1.0 };
                impulse += pair.total_impulse() * sign;
            }
        }
        impulse.length() / self.params.dt
    }

    /// Contact forces on the two fingers after the last step, newtons.
    #[must_use]
    pub fn finger_forces(&self) -> [f32; 2] {
        self.fingers.map(|finger| self.contact_force(finger))
    }

    /// No link may press harder than the abort force.
    pub(super) fn check_forces(&self) -> Result<(), InvalidAction> {
        for (idx, body) in self.robot_bodies() {
            let force = self.contact_force(body);
            if force > self.params.abort_force {
                return Err(InvalidAction::Force {
                    link: Self::robot_body_name(idx),
                    newtons: force,
                });
            }
        }
        Ok(())
    }

    /// No link may be inside a fixed body: rapier lets kinematic bodies pass through them.
    ///
    /// `poses` are those of links and fingers, in the order of [`World::robot_items`]: physics
    /// leaves some links where they were (see `near`).
    pub(super) fn check_penetration(
        &self,
        poses: &[Pose3; N_LINKS + 2],
    ) -> Result<(), InvalidAction> {
        for (idx, link) in self.robot_bodies() {
            for collider in self.physics.colliders_of(link) {
                let collider = &self.physics.colliders[*collider];
                let local = collider.position_wrt_parent().copied().unwrap_or_default();
                if let Some(body) = self.penetrated_by(collider.shape(), &(poses[idx] * local)) {
                    return Err(InvalidAction::Collision {
                        link: Self::robot_body_name(idx),
                        body,
                    });
                }
            }
        }
        Ok(())
    }

    /// The first fixed body that a collider of the robot is inside of.
    fn penetrated_by(&self, shape: &dyn Shape, pose: &Pose3) -> Option<usize> {
        let aabb = shape.compute_aabb(pose);
        let mut near = self.fixed.iter().filter(|part| part.aabb.intersects(&aabb));
        near.find(|part| self.penetrates(shape, pose, part)).map(|part| part.body)
    }

    fn penetrates(&self, shape: &dyn Shape, pose: &Pose3, part: &FixedPart) -> bool {
        let fixed = &self.physics.colliders[part.collider];
        let found = contact(pose, shape, fixed.position(), fixed.shape(), 0.0);
        matches!(found, Ok(Some(contact)) if contact.dist < -self.params.abort_penetration)
    }
}
