//! The arm in the world: its links, hand and fingers as bodies.

use super::World;
use super::arm::link_parts;
use super::gripper::{finger_parts, finger_poses};
use crate::robot::{JointConfig, N_LINKS};
use crate::scene::Part;
use glamx::Pose3;
use rapier3d::prelude::RigidBodyHandle;

/// Index of the first link that can hit anything: the base and link 1 stand on the table by design.
const FIRST_MOVING_LINK: usize = 2;

impl World {
    /// Moves the links to `frames` during the next physics step, coming from `last`; takes in and
    /// leaves out what came near or went.
    pub(super) fn move_links(&mut self, last: &JointConfig, frames: &[Pose3; N_LINKS]) {
        for (link, frame) in frames.iter().enumerate() {
            let is_near = self.balls.is_near(&self.physics, link, frame);
            let body = &mut self.physics.bodies[self.links[link]];
            // A link that comes in starts from where the arm was: from its last simulated place it
            // would sweep through everything between.
            if is_near && !body.is_enabled() {
                body.set_position(self.robot.link_frames(last)[link], false);
            }
            body.set_enabled(is_near);
            if is_near {
                body.set_next_kinematic_position(*frame);
            }
        }
    }

    /// Poses of the robot's frames and fingers now, in the order of [`World::robot_items`].
    pub(in crate::sim) fn robot_poses(&self) -> impl Iterator<Item = Pose3> {
        self.robot_poses_at(&self.config).into_iter()
    }

    /// Poses of arm, hand and fingers if the arm stood at `config`, in the order of
    /// [`World::robot_items`].
    #[must_use]
    pub fn robot_poses_at(&self, config: &JointConfig) -> Vec<Pose3> {
        let (frames, grip) = self.robot.link_frames_and_grip(config);
        let fingers = finger_poses(&grip, self.gripper.width, self.gripper.offset);
        frames.into_iter().chain(fingers).collect()
    }

    /// Arm, hand and fingers with their poses now.
    #[must_use]
    pub fn robot_items(&self) -> Vec<(Pose3, Vec<Part>)> {
        let links = (0..N_LINKS).map(|link| link_parts(&self.robot, link));
        self.robot_poses().zip(links.chain(finger_parts(&self.gripper_spec))).collect()
    }

    /// Names the robot body `index` of [`World::robot_bodies`].
    pub(super) fn robot_body_name(index: usize) -> &'static str {
        Self::robot_body_names()[index]
    }

    /// Names of the robot's frames, then its fingers.
    pub(in crate::sim) const fn robot_body_names() -> &'static [&'static str; N_LINKS + 2] {
        &[
            "base", "link1", "link2", "link3", "link4", "link5", "link6", "link7", "hand",
            "finger", "finger",
        ]
    }

    /// Links that can hit something, hand and fingers, with their indices.
    pub(super) fn robot_bodies(&self) -> impl Iterator<Item = (usize, RigidBodyHandle)> + '_ {
        self.links.iter().chain(&self.fingers).copied().enumerate().skip(FIRST_MOVING_LINK)
    }
}

#[cfg(test)]
mod tests {
    use super::super::SimParams;
    use super::*;
    use crate::robot::XARM7;
    use crate::scene::Shape;
    use crate::sim::scene::{BodyKind, BodySpec, SceneSpec};
    use glamx::Vec3;
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
