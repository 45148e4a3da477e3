//! The links that physics has to know of: those near something that can move.
//!
//! A kinematic link meets nothing else in rapier (what is fixed is the affair of `contact`), and
//! most links are far from all that moves most of the time; each that is left out spares a step
//! about a hundredth of its time.

use super::physics::Physics;
use crate::robot::{HAND, N_LINKS};
use crate::sim::scene::{BodyKind, BodySpec, SceneSpec};
use glamx::{Pose3, Vec3};
use rapier3d::parry::bounding_volume::{Aabb, BoundingVolume as _};
use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};

/// Distance that counts as near, metres: farther than link and object come towards each other in a
/// physics step.
const NEAR: f32 = 0.05;

/// A ball around the colliders of a body, in the body's frame.
#[derive(Debug, Clone, Copy)]
struct Ball {
    center: Vec3,
    radius: f32,
}

impl Ball {
    fn around(physics: &Physics, body: RigidBodyHandle) -> Option<Self> {
        let aabb = |collider: ColliderHandle| {
            let collider = &physics.colliders[collider];
            Some(collider.shape().compute_aabb(collider.position_wrt_parent()?))
        };
        let aabbs = physics.colliders_of(body).iter().copied().filter_map(aabb);
        let all: Aabb = aabbs.reduce(|all, aabb| all.merged(&aabb))?;
        Some(Self { center: all.center(), radius: all.half_extents().length() })
    }
}

/// Balls around the links, and around every body that can move.
pub(super) struct Balls {
    links: [Option<Ball>; N_LINKS],
    movable: Vec<(RigidBodyHandle, Ball)>,
}

impl Balls {
    /// `bodies` are those of `spec`, in its order.
    pub(super) fn new(
        physics: &Physics,
        spec: &SceneSpec,
        links: &[RigidBodyHandle; N_LINKS],
        bodies: &[RigidBodyHandle],
    ) -> Self {
        let can_move = |(spec, _): &(&BodySpec, _)| {
            matches!(spec.kind, BodyKind::Dynamic | BodyKind::Graspable)
        };
        let movable = spec.bodies.iter().zip(bodies).filter(can_move);
        Self {
            links: links.map(|link| Ball::around(physics, link)),
            movable: movable
                .filter_map(|(_, body)| Some((*body, Ball::around(physics, *body)?)))
                .collect(),
        }
    }

    /// Tells if a link whose frame is `frame` is near something that can move. The hand always
    /// counts: it may hold something.
    pub(super) fn is_near(&self, physics: &Physics, link: usize, frame: &Pose3) -> bool {
        if link == HAND {
            return true;
        }
        let Some(ball) = self.links[link] else { return false };
        let center = frame.transform_point(ball.center);
        let meets = |(body, other): &(RigidBodyHandle, Ball)| {
            let reach = ball.radius + other.radius + NEAR;
            physics.bodies[*body].position().transform_point(other.center).distance_squared(center)
                < reach * reach
        };
        self.movable.iter().any(meets)
    }
}
