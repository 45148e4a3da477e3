//! Which links physics has to know of: those near something that can move.
//!
//! A kinematic link meets nothing else in rapier (what is fixed is [`World::check_penetration`]'s
//! affair), and most links are far from all that moves most of the time; each that is left out
//! spares a step about a hundredth of its time.

use super::physics::Physics;
use super::scene_spec::{BodyKind, BodySpec, SceneSpec};
use super::world::World;
use crate::robot::{HAND, JointConfig, N_LINKS};
use glamx::{Pose3, Vec3};
use rapier3d::parry::bounding_volume::{Aabb, BoundingVolume as _};
use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};

/// How near counts, metres: farther than link and object come towards each other in a physics step.
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

    /// Whether a link whose frame is `frame` is near something that can move. The hand always
    /// counts: it may hold something.
    fn is_near(&self, physics: &Physics, link: usize, frame: &Pose3) -> bool {
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

impl World {
    /// Moves the links to `frames` during the next physics step, coming from `last`; takes in and
    /// leaves out what came near or went.
    pub(super) fn move_links(&mut self, last: &JointConfig, frames: &[Pose3; N_LINKS]) {
        for (link, frame) in frames.iter().enumerate() {
            let is_near = self.balls.is_near(&self.physics, link, frame);
            let body = &mut self.physics.bodies[self.links[link]];
            if is_near && !body.is_enabled() {
                body.set_position(self.robot.link_frames(last)[link], false);
            }
            body.set_enabled(is_near);
            if is_near {
                body.set_next_kinematic_position(*frame);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::XARM7;
    use crate::scene::{Part, Shape};
    use crate::sim::SimParams;
    use std::sync::Arc;

    /// A box on a pillar in the way of the hand when the arm turns about its base.
    fn beside_a_pillar() -> World {
        let body = |name: &str, kind, z, half_extents| BodySpec {
            name: name.to_owned(),
            kind,
            pose: Pose3::from_translation(Vec3::new(0.21, 0.21, z)),
            parts: vec![Part::new(Shape::Cuboid { half_extents }, Pose3::IDENTITY, [180; 3])],
            mass: 0.2,
            friction: 0.5,
        };
        let tall = body("box", BodyKind::Dynamic, 0.42, Vec3::new(0.03, 0.03, 0.12));
        let pillar = body("pillar", BodyKind::Fixed, 0.15, Vec3::new(0.03, 0.03, 0.15));
        let spec = SceneSpec {
            task: "pillar".to_owned(),
            bodies: vec![tall, pillar],
            joints: Vec::new(),
            success: Vec::new(),
        };
        World::new(Arc::new(spec), &XARM7, XARM7.start, &SimParams::STANDARD).unwrap()
    }

    #[test]
    fn links_are_left_out_far_from_a_box_and_there_when_the_hand_pushes_it() {
        let mut world = beside_a_pillar();
        // The most links that are simulated on the way.
        let turn = |world: &mut World, to: f32| {
            let step = |_| {
                let mut config = *world.config();
                config[0] += (to - config[0]).clamp(-0.01, 0.01);
                let _ = world.step(&config);
                world.links.iter().filter(|link| world.physics.bodies[**link].is_enabled()).count()
            };
            (0..300).map(step).max().unwrap()
        };
        turn(&mut world, -1.5);
        let far = turn(&mut world, -1.5);
        let start = world.body_pose(0).translation;
        assert!(start.z > 0.4, "the box stands on its pillar, not at {start}");
        let near = turn(&mut world, 1.5);
        assert!(far < near, "{far} links are simulated far from the box, {near} beside it");
        assert!(
            world.body_pose(0).translation.distance(start) > 0.05,
            "the box is at {}",
            world.body_pose(0).translation
        );
    }
}
