//! What ends an episode: the arm inside a fixed body, or pressed against something harder than a real arm would.

use super::scene_spec::BodyKind;
use super::world::World;
use crate::env::InvalidAction;
use glamx::Vec3;
use rapier3d::parry::bounding_volume::BoundingVolume as _;
use rapier3d::parry::query::contact;
use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};

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
                return Err(InvalidAction::Force { link: Self::robot_body_name(idx), newtons: force });
            }
        }
        Ok(())
    }

    /// No link may be inside a fixed body: rapier lets kinematic bodies pass through them.
    pub(super) fn check_penetration(&self) -> Result<(), InvalidAction> {
        for (idx, link) in self.robot_bodies() {
            for link_collider in self.physics.colliders_of(link) {
                for (body, spec) in self.spec().bodies.iter().enumerate() {
                    if spec.kind == BodyKind::Fixed && self.penetrates(*link_collider, self.bodies[body]) {
                        return Err(InvalidAction::Collision { link: Self::robot_body_name(idx), body });
                    }
                }
            }
        }
        Ok(())
    }

    fn penetrates(&self, link_collider: ColliderHandle, body: RigidBodyHandle) -> bool {
        let link = &self.physics.colliders[link_collider];
        let link_aabb = link.compute_aabb();
        self.physics.colliders_of(body).iter().any(|handle| {
            let fixed = &self.physics.colliders[*handle];
            if !fixed.compute_aabb().intersects(&link_aabb) {
                return false;
            }
            let found = contact(link.position(), link.shape(), fixed.position(), fixed.shape(), 0.0);
            matches!(found, Ok(Some(contact)) if contact.dist < -self.params.abort_penetration)
        })
    }
}
