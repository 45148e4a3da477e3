//! The simulated world: rapier bodies for a scene, a kinematic arm and a force-stopped gripper.
//!
//! State that knows no [`World`] is in `physics`, `gripper`, `fixed`, `near` and `params`; the
//! other modules are what a world does with it.

mod arm;
mod contact;
mod fallen;
mod fixed;
mod grasping;
mod gripper;
mod joints;
mod near;
mod params;
mod physics;
mod robot_bodies;
mod snapshot;
mod sweep;

pub(super) use arm::link_parts;
pub use gripper::Grasp;
pub use params::SimParams;
pub(super) use physics::{collider_pose, shared_shape};
pub use sweep::ArmSweep;

use super::scene::{Condition, JointSpec, SceneSpec};
use crate::digest;
use crate::env::InvalidAction;
use crate::error::{Error, Result};
use crate::robot::{DOF, Gripper, GripperSpec, JointConfig, N_LINKS, Robot};
use crate::scene::Part;
use fixed::{FixedPart, fixed_parts};
use glamx::Pose3;
use gripper::{GripperState, finger_parts, finger_poses};
use near::Balls;
use physics::Physics;
use rapier3d::prelude::{ImpulseJointHandle, RigidBodyHandle};
use std::sync::Arc;

/// A scene in motion. A clone is a snapshot: it continues bit for bit as the original would have.
#[derive(Clone)]
pub struct World {
    physics: Physics,
    params: SimParams,
    robot: Arc<Robot>,
    gripper_spec: GripperSpec,
    spec: Arc<SceneSpec>,
    bodies: Vec<RigidBodyHandle>,
    joints: Vec<ImpulseJointHandle>,
    fixed: Arc<[FixedPart]>,
    balls: Arc<Balls>,
    links: [RigidBodyHandle; N_LINKS],
    fingers: [RigidBodyHandle; 2],
    gripper: GripperState,
    config: JointConfig,
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
        let joints = insert_joints(&mut physics, &spec, &bodies, params)?;
        let fixed = fixed_parts(&spec, &physics, &bodies).into();
        // The order of insertion (scene, joints, links, fingers) is part of the result: handles
        // follow it, the solver's sums follow the handles, and the world's hash shows every bit.
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
        // Kinematic bodies are told where they are to be at the end of the step: rapier gives them
        // the velocity for it, with which they push what they meet.
        self.move_links(&last, &frames);
        let fingers = finger_poses(&grip, self.gripper.width, self.gripper.offset);
        for (finger, pose) in self.fingers.iter().zip(&fingers) {
            self.physics.bodies[*finger].set_next_kinematic_position(*pose);
        }
        // Latches are limits of joints, which act in the step; grasps follow from its forces.
        self.update_latches();
        self.physics.step();
        self.rest_fallen();
        self.update_grasp();
        self.check_penetration(&core::array::from_fn(|idx| {
            if idx < N_LINKS { frames[idx] } else { fingers[idx - N_LINKS] }
        }))?;
        self.check_forces()
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

    /// Tells if the gripper has reached what it was commanded to, or something that stops it.
    #[must_use]
    pub fn gripper_settled(&self) -> bool {
        self.gripper.settled(&self.params, &self.gripper_spec)
    }

    /// The gripper's grasp.
    #[must_use]
    pub fn grasp(&self) -> Grasp {
        self.gripper.grasp
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

    /// Tells if every success condition of the scene holds.
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
            Condition::NothingGrasped => self.gripper.grasp == Grasp::Nothing,
            Condition::Grasped { body } => match self.gripper.grasp {
                Grasp::Attached { body: held } => held == *body,
                Grasp::Pinched => self.pads_touch(*body),
                Grasp::Nothing => false,
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

    /// Digest (FNV-1a) over the bits of every pose: equal for equal worlds.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let mut hash = digest::of(&[]);
        let mut feed = |value: f32| hash = digest::extend(hash, &value.to_bits().to_le_bytes());
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
}

fn insert_joints(
    physics: &mut Physics,
    spec: &SceneSpec,
    bodies: &[RigidBodyHandle],
    params: &SimParams,
) -> Result<Vec<ImpulseJointHandle>> {
    let insert = |joint: &JointSpec| match [bodies.get(joint.parent), bodies.get(joint.child)] {
        [Some(parent), Some(child)] if parent != child => {
            Ok(physics.insert_joint(joint, [*parent, *child], params))
        }
        _ => Err(Error::Environment(format!(
            "joint '{}' of task '{}' cannot be built",
            joint.name, spec.task
        ))),
    };
    spec.joints.iter().map(insert).collect()
}

/// The gripper of a robot that can be simulated: seven joints and a hand.
fn hand_of(robot: &Robot) -> Result<GripperSpec> {
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
