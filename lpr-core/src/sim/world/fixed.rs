//! Colliders that never move, with their bounding boxes.

use super::physics::Physics;
use crate::sim::scene::{BodyKind, SceneSpec};
use rapier3d::parry::bounding_volume::Aabb;
use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};

/// A collider of a fixed body.
#[derive(Clone, Copy)]
pub(super) struct FixedPart {
    /// Its body in the scene.
    pub(super) body: usize,
    pub(super) collider: ColliderHandle,
    /// In the world. Kept, since it never changes, and since that of a cylinder or a hull costs
    /// more than all else here.
    pub(super) aabb: Aabb,
}

/// Colliders of the fixed bodies of a scene, in their order.
pub(super) fn fixed_parts(
    spec: &SceneSpec,
    physics: &Physics,
    bodies: &[RigidBodyHandle],
) -> Vec<FixedPart> {
    let fixed =
        bodies.iter().enumerate().filter(|(body, _)| spec.bodies[*body].kind == BodyKind::Fixed);
    let parts = |(body, handle): (usize, &RigidBodyHandle)| {
        let part = move |collider| FixedPart {
            body,
            collider,
            aabb: physics.colliders[collider].compute_aabb(),
        };
        physics.colliders_of(*handle).iter().copied().map(part)
    };
    fixed.flat_map(parts).collect()
}
