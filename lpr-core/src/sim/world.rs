//! The simulated world: rapier bodies for a scene, a kinematic arm and a force-stopped gripper.

use super::arm::link_parts;
use super::contact::{FixedPart, fixed_parts};
use super::gripper::{GripperState, finger_parts, finger_poses};
use super::near::Balls;
use super::params::SimParams;
use super::physics::{Latched, Physics};
use super::scene_spec::{BodyKind, Condition, JointKind, JointSpec, SceneSpec};
use crate::env::InvalidAction;
use crate::error::{Error, Result};
use crate::robot::{DOF, Gripper, GripperSpec, JointConfig, N_LINKS, Robot};
use crate::scene::Part;
use glamx::{Pose3, Quat, Vec3};
use rapier3d::prelude::{ImpulseJointHandle, RigidBodyHandle};
use std::sync::Arc;

pub use super::gripper::Holding;

/// Index of the first link that can hit anything: the base and link 1 stand on the table by design.
const FIRST_MOVING_LINK: usize = 2;

/// How far a latched joint has to be from its start for its latch to miss it, radians or metres.
const LATCH_DEPTH: f32 = 0.02;

/// A scene in motion. A clone is a snapshot: it continues bit for bit as the original would have.
#[derive(Clone)]
pub struct World {
    pub(super) physics: Physics,
    pub(super) params: SimParams,
    pub(super) robot: Arc<Robot>,
    pub(super) gripper_spec: GripperSpec,
    pub(super) spec: Arc<SceneSpec>,
    pub(super) bodies: Vec<RigidBodyHandle>,
    pub(super) joints: Vec<ImpulseJointHandle>,
    pub(super) fixed: Arc<[FixedPart]>,
    pub(super) balls: Arc<Balls>,
    pub(super) links: [RigidBodyHandle; N_LINKS],
    pub(super) fingers: [RigidBodyHandle; 2],
    pub(super) gripper: GripperState,
    pub(super) config: JointConfig,
}

impl core::fmt::Debug for World {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("World")
            .field("task", &self.spec.task)
            .field("config", &self.config)
            .finish_non_exhaustive()
    }
}

impl World {
    /// Builds the scene with the arm at `config` and the gripper open.
    ///
    /// # Errors
    ///
    /// When a joint of the scene joins a body to itself or names one that is not there.
    pub fn new(
        spec: Arc<SceneSpec>,
        robot: &Arc<Robot>,
        config: JointConfig,
        params: &SimParams,
    ) -> Result<Self> {
        let gripper_spec = hand_of(robot)?;
        let mut physics = Physics::new(params);
        let bodies: Vec<_> =
            spec.bodies.iter().map(|body| physics.insert_body(body, params)).collect();
        let mut joints = Vec::with_capacity(spec.joints.len());
        for joint in &spec.joints {
            let broken = || {
                Error::Environment(format!(
                    "joint '{}' of task '{}' cannot be built",
                    joint.name, spec.task
                ))
            };
            let (parent, child) =
                bodies.get(joint.parent).zip(bodies.get(joint.child)).ok_or_else(broken)?;
            if parent == child {
                return Err(broken());
            }
            joints.push(physics.insert_joint(joint, [*parent, *child], params));
        }
        let fixed = fixed_parts(&spec, &physics, &bodies).into();
        let frames = robot.link_frames(&config);
        let links = core::array::from_fn(|link| {
            let parts = link_parts(robot, link);
            physics.insert_robot_body(frames[link], &parts, params.pad_friction)
        });
        let width = gripper_spec.max_width;
        let grip = robot.grip(&config);
        let fingers = finger_poses(&grip, width, 0.0);
        let finger_parts = finger_parts(&gripper_spec);
        let fingers = core::array::from_fn(|side| {
            physics.insert_robot_body(fingers[side], &finger_parts[side], params.pad_friction)
        });
        let balls = Balls::new(&physics, &spec, &links, &bodies).into();
        Ok(Self {
            physics,
            params: params.clone(),
            robot: Arc::clone(robot),
            gripper_spec,
            spec,
            bodies,
            joints,
            fixed,
            balls,
            links,
            fingers,
            gripper: GripperState::open(&gripper_spec),
            config,
        })
    }

    /// Advances one physics step (`SimParams::dt`) while the arm moves to `config`.
    ///
    /// # Errors
    ///
    /// The reason why the motion is no longer one that a real arm could make; the world has then
    /// taken the step.
    pub fn step(&mut self, config: &JointConfig) -> Result<(), InvalidAction> {
        self.check_speed(config)?;
        let last = core::mem::replace(&mut self.config, *config);
        self.gripper.advance(&self.params, &self.gripper_spec);
        let (frames, grip) = self.robot.link_frames_and_grip(config);
        self.move_links(&last, &frames);
        let fingers = finger_poses(&grip, self.gripper.width, self.gripper.offset);
        for (finger, pose) in self.fingers.iter().zip(&fingers) {
            self.physics.bodies[*finger].set_next_kinematic_position(*pose);
        }
        self.update_latches();
        self.physics.step();
        self.rest_fallen();
        self.update_grasp();
        self.check_penetration(&core::array::from_fn(|idx| {
            if idx < N_LINKS { frames[idx] } else { fingers[idx - N_LINKS] }
        }))?;
        self.check_forces()
    }

    /// A latch holds while its joint is at the start and what opens it has not moved far enough.
    fn update_latches(&mut self) {
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

    /// The joint step against the robot's velocity limits: a kinematic arm would otherwise
    /// teleport.
    fn check_speed(&self, config: &JointConfig) -> Result<(), InvalidAction> {
        for (j, joint) in self.robot.joints.iter().enumerate() {
            let speed = (config[j] - self.config[j]).abs() / self.params.dt;
            // 1 %: rounding of a step that runs exactly at the limit.
            if speed.is_nan() || speed > joint.max_velocity * 1.01 {
                return Err(InvalidAction::JointSpeed { joint: j });
            }
        }
        Ok(())
    }

    /// Commands the gripper; it moves over the next steps.
    pub fn command_gripper(&mut self, command: Gripper) {
        self.gripper.command = command;
    }

    /// The gripper.
    #[must_use]
    pub const fn gripper_spec(&self) -> &GripperSpec {
        &self.gripper_spec
    }

    /// Whether the gripper has reached what it was commanded to, or something that stops it.
    #[must_use]
    pub fn gripper_settled(&self) -> bool {
        self.gripper.settled(&self.params, &self.gripper_spec)
    }

    /// What the gripper holds.
    #[must_use]
    pub fn holding(&self) -> Holding {
        self.gripper.holding
    }

    /// Distance between the pads, metres.
    #[must_use]
    pub fn gripper_width(&self) -> f32 {
        self.gripper.width
    }

    /// The arm's configuration.
    #[must_use]
    pub fn config(&self) -> &JointConfig {
        &self.config
    }

    /// The robot.
    #[must_use]
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// The scene it was built from.
    #[must_use]
    pub fn spec(&self) -> &SceneSpec {
        &self.spec
    }

    /// The physics settings.
    #[must_use]
    pub fn params(&self) -> &SimParams {
        &self.params
    }

    /// `world_from_body` now.
    #[must_use]
    pub fn body_pose(&self, body: usize) -> Pose3 {
        *self.physics.bodies[self.bodies[body]].position()
    }

    /// How a body has moved since the start, in the world.
    fn motion(&self, body: usize) -> Pose3 {
        self.body_pose(body) * self.spec.bodies[body].pose.inverse()
    }

    /// How a joint's child has moved since the start, as if its parent had stayed.
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

    /// How far a joint's child is off its axis now: metres at the anchor and radians, without the
    /// free motion.
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

    /// Whether every success condition of the scene holds.
    #[must_use]
    pub fn success(&self) -> bool {
        self.spec.success.iter().all(|condition| self.holds(condition))
    }

    fn holds(&self, condition: &Condition) -> bool {
        match condition {
            Condition::JointMoved { joint, min } => {
                (self.joint_position(*joint) - self.spec.joints[*joint].start).abs() > *min
            }
            Condition::BodyInZone { body, point, zone } => {
                zone.contains(self.body_pose(*body).transform_point(*point))
            }
            Condition::BodyOutsideZone { body, point, zone } => {
                !zone.contains(self.body_pose(*body).transform_point(*point))
            }
            Condition::GripInZone { zone } => {
                zone.contains(self.robot.grip(&self.config).translation)
            }
            Condition::NothingGrasped => self.gripper.holding == Holding::Nothing,
            Condition::Grasped { body } => match self.gripper.holding {
                Holding::Attached { body: held } => held == *body,
                Holding::Pinched => self.pads_touch(*body),
                Holding::Nothing => false,
            },
        }
    }

    /// Every body of the scene with its pose now.
    pub fn scene_items(&self) -> impl Iterator<Item = (usize, Pose3, &[Part])> {
        self.spec
            .bodies
            .iter()
            .enumerate()
            .map(|(idx, body)| (idx, self.body_pose(idx), body.parts.as_slice()))
    }

    /// Poses of the robot's frames and fingers now, in the order of [`World::robot_items`].
    pub(super) fn robot_poses(&self) -> impl Iterator<Item = Pose3> {
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

    /// FNV-1a over the bits of every pose: equal for equal worlds.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut feed = |value: f32| {
            for byte in value.to_bits().to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        for handle in &self.bodies {
            let pose = self.physics.bodies[*handle].position();
            pose.translation
                .to_array()
                .into_iter()
                .chain(pose.rotation.to_array())
                .for_each(&mut feed);
        }
        (0..DOF).for_each(|j| feed(self.config[j]));
        feed(self.gripper.width);
        hash
    }

    /// Names the robot body `index` of [`World::robot_bodies`].
    pub(super) fn robot_body_name(index: usize) -> &'static str {
        Self::robot_body_names()[index]
    }

    /// Names of the robot's frames, then its fingers.
    pub(super) const fn robot_body_names() -> &'static [&'static str; N_LINKS + 2] {
        &[
            "base", "link1", "link2", "link3", "link4", "link5", "link6", "link7", "hand",
            "finger", "finger",
        ]
    }

    /// Links that can hit something, hand and fingers, with their indices.
    pub(super) fn robot_bodies(&self) -> impl Iterator<Item = (usize, RigidBodyHandle)> + '_ {
        self.links.iter().chain(&self.fingers).copied().enumerate().skip(FIRST_MOVING_LINK)
    }

    /// Whether a scene body is one that the hand is attached to when it closes on it.
    pub(super) fn is_graspable(&self, body: usize) -> bool {
        self.spec.bodies[body].kind == BodyKind::Graspable
    }
}

/// The gripper of a robot that can be simulated: seven joints and a hand.
pub(super) fn hand_of(robot: &Robot) -> Result<GripperSpec> {
    let found = (robot.dof(), robot.links.len());
    if found != (DOF, N_LINKS) {
        return Err(Error::Robot(format!(
            "{}: expected {DOF} joints and {N_LINKS} links to simulate, found {} and {}",
            robot.name, found.0, found.1
        )));
    }
    robot.gripper().copied()
}

#[cfg(test)]
mod tests;
