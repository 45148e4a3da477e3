//! Forward kinematics and the Jacobian: pure functions of a configuration.
//!
//! Trigonometry goes through `libm` and nothing is fused, so that native code and wasm agree bit
//! for bit.

use super::{DOF, HAND, JointConfig, JointMotion, JointOrigin, MAX_JOINTS, N_LINKS, Robot};
use glamx::{DPose3, DVec3, Pose3};

impl Robot {
    /// `world_from_joint` of a seven-joint arm in f64.
    ///
    /// Every joint turns about the z axis of its frame:
    ///
    /// ```
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::XARM7;
    ///
    /// let [shoulder, ..] = XARM7.joint_frames(&XARM7.start);
    /// assert_eq!(shoulder.translation, DVec3::new(0.0, 0.0, 0.267), "metres above the base");
    /// assert!((shoulder.rotation * DVec3::Z).distance(DVec3::Z) < 1e-12);
    /// ```
    #[must_use]
    pub fn joint_frames(&self, config: &JointConfig) -> [DPose3; DOF] {
        self.frames_at(&config.to_array::<DOF>().map(f64::from)).joints
    }

    /// `world_from_body` of the base and what every joint carries, in f64.
    ///
    /// ```
    /// use lpr_core::glamx::DPose3;
    /// use lpr_core::robot::PANDA;
    ///
    /// let world_from_body = PANDA.body_frames(&PANDA.start);
    /// assert_eq!(world_from_body[0], DPose3::IDENTITY);
    /// assert_eq!(world_from_body[7] * PANDA.body_from_flange, PANDA.flange(&PANDA.start));
    /// ```
    #[must_use]
    pub fn body_frames(&self, config: &JointConfig) -> Vec<DPose3> {
        self.bodies_at(&config.to_array::<MAX_JOINTS>().map(f64::from))
    }

    /// `world_from_body` of all bodies at f64 positions.
    fn bodies_at(&self, positions: &[f64; MAX_JOINTS]) -> Vec<DPose3> {
        let mut frames = vec![DPose3::IDENTITY; self.n_bodies()];
        for step in self.moves() {
            let parent_from_body = match step.follower {
                Some(follower) => follower.transform(positions[step.joint]),
                None => self.joints[step.joint].transform(positions[step.joint]),
            };
            frames[step.body] = frames[step.parent] * parent_from_body;
        }
        frames
    }

    /// `world_from_body` of what each of `N` joints carries, at f64 positions; an arm with fewer
    /// repeats its last.
    pub(super) fn frames_at<const N: usize>(&self, positions: &[f64; N]) -> Frames<N> {
        if !self.followers.is_empty() {
            return self.frames_with_followers(positions);
        }
        let mut world_from_body = DPose3::IDENTITY;
        Frames::of_joints(core::array::from_fn(|j| {
            if let Some(joint) = self.joints.get(j) {
                world_from_body *= joint.transform(positions[j]);
            }
            world_from_body
        }))
    }

    fn frames_with_followers<const N: usize>(&self, positions: &[f64; N]) -> Frames<N> {
        let config: [f64; MAX_JOINTS] =
            core::array::from_fn(|j| positions.get(j).copied().unwrap_or(0.0));
        let bodies = self.bodies_at(&config);
        let (joints, followers) = bodies[1..].split_at(self.dof());
        Frames {
            joints: core::array::from_fn(|j| joints[j.min(joints.len() - 1)]),
            tip: bodies[self.tip_body()],
            followers: followers.to_vec(),
        }
    }

    /// `world_from_body` of what the flange is on.
    fn last_frame(&self, config: &JointConfig) -> DPose3 {
        if !self.followers.is_empty() {
            return self.body_frames(config)[self.tip_body()];
        }
        let config = config.to_array::<MAX_JOINTS>();
        let mut world_from_body = DPose3::IDENTITY;
        for (joint, q) in self.joints.iter().zip(&config) {
            world_from_body *= match &joint.origin {
                // Asked here: through `Joint::transform` a pose takes a fifth longer.
                JointOrigin::ModifiedDh(row) => row.transform(f64::from(*q)),
                JointOrigin::Fixed(_) => joint.transform(f64::from(*q)),
            };
        }
        world_from_body
    }

    /// `world_from_frame` of base, links 1–7 and hand (the flange) of an arm like the built-in ones.
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Vec3};
    /// use lpr_core::robot::{HAND, XARM7};
    ///
    /// let world_from_link = XARM7.link_frames(&XARM7.start);
    /// assert_eq!(world_from_link[0], Pose3::IDENTITY, "the base is the world");
    /// assert_eq!(world_from_link[HAND], Pose3::from(XARM7.flange(&XARM7.start)));
    /// // A point 0.172 m ahead of the flange is between the finger pads.
    /// assert!((world_from_link[HAND] * Vec3::new(0.0, 0.0, 0.172)).distance(XARM7.grip(&XARM7.start).translation) < 1e-5);
    /// ```
    #[must_use]
    pub fn link_frames(&self, config: &JointConfig) -> [Pose3; N_LINKS] {
        self.link_frames_and_grip(config).0
    }

    /// [`Self::link_frames`] and [`Self::grip`] together: both follow from the joints' frames.
    #[must_use]
    pub fn link_frames_and_grip(&self, config: &JointConfig) -> ([Pose3; N_LINKS], Pose3) {
        let joint_frames = self.joint_frames(config);
        let flange = joint_frames[DOF - 1] * self.body_from_flange;
        let frames = core::array::from_fn(|frame| match frame {
            0 => Pose3::IDENTITY,
            HAND => Pose3::from(flange),
            link => Pose3::from(joint_frames[link - 1]),
        });
        (frames, Pose3::from(flange * self.flange_from_grip))
    }

    /// `world_from_flange` in f64.
    ///
    /// ```
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::PANDA;
    ///
    /// // The last joint turns the flange about its own z axis.
    /// let mut turned = PANDA.start;
    /// turned[6] += 0.5;
    /// let (before, after) = (PANDA.flange(&PANDA.start), PANDA.flange(&turned));
    /// assert!((before.rotation * DVec3::Z).distance(after.rotation * DVec3::Z) < 1e-12);
    /// assert!(before.translation.distance(after.translation) < 1e-12);
    /// ```
    #[must_use]
    pub fn flange(&self, config: &JointConfig) -> DPose3 {
        self.last_frame(config) * self.body_from_flange
    }

    /// `world_from_grip` in f64.
    #[must_use]
    pub fn grip_f64(&self, config: &JointConfig) -> DPose3 {
        self.flange(config) * self.flange_from_grip
    }

    /// `world_from_grip`: the frame between the finger pads, z approach, y opening.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::robot::XARM7;
    ///
    /// let world_from_grip = XARM7.grip(&XARM7.start);
    /// let ahead = world_from_grip * Vec3::new(0.0, 0.0, 0.1);
    /// assert!((world_from_grip.translation.z - ahead.z - 0.1).abs() < 1e-3, "the start looks down on the table");
    /// ```
    #[must_use]
    pub fn grip(&self, config: &JointConfig) -> Pose3 {
        Pose3::from(self.grip_f64(config))
    }

    /// Jacobian of the grip of a seven-joint arm in the world frame: rows are linear velocity (m/rad) then angular
    /// velocity (rad/rad).
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    ///
    /// let jacobian = XARM7.jacobian(&XARM7.start);
    /// let mut turned = XARM7.start;
    /// turned[0] += 1e-3;
    /// let moved = XARM7.grip_f64(&turned).translation - XARM7.grip_f64(&XARM7.start).translation;
    /// assert!((moved.y / 1e-3 - jacobian[1][0]).abs() < 1e-3, "metres per radian of the first joint");
    /// assert_eq!(jacobian[5][0], 1.0, "which turns about the vertical");
    /// ```
    #[must_use]
    pub fn jacobian(&self, config: &JointConfig) -> [[f64; DOF]; 6] {
        self.jacobian_of(&self.frames_at(&config.to_array::<DOF>().map(f64::from)))
    }

    /// The Jacobian of an arm of at most `N` joints, from their frames.
    pub(super) fn jacobian_of<const N: usize>(&self, frames: &Frames<N>) -> [[f64; N]; 6] {
        let grip = (frames.tip * self.body_from_flange * self.flange_from_grip).translation;
        let mut jacobian = [[0.0; N]; 6];
        for (j, (joint, frame)) in self.joints.iter().zip(&frames.joints).enumerate() {
            for (row, value) in velocity(joint.motion, frame, grip).enumerate() {
                jacobian[row][j] = value;
            }
        }
        for (follower, frame) in self.followers.iter().zip(&frames.followers) {
            if follower.is_in_chain {
                for (row, value) in velocity(follower.motion, frame, grip).enumerate() {
                    jacobian[row][follower.joint] += follower.multiplier * value;
                }
            }
        }
        jacobian
    }
}

/// Frames of an arm of at most `N` joints, in the world.
#[derive(Debug)]
pub(super) struct Frames<const N: usize> {
    /// Of what each joint carries; the last repeats.
    pub(super) joints: [DPose3; N],
    /// Of what the flange is on.
    pub(super) tip: DPose3,
    /// Of what each follower carries.
    followers: Vec<DPose3>,
}

impl<const N: usize> Frames<N> {
    /// Of an arm without followers.
    pub(super) const fn of_joints(joints: [DPose3; N]) -> Self {
        Self { joints, tip: joints[N - 1], followers: Vec::new() }
    }
}

/// Linear and angular velocity of `grip` where a joint moves at 1, by the frame of what it carries.
fn velocity(motion: JointMotion, frame: &DPose3, grip: DVec3) -> impl Iterator<Item = f64> {
    let axis = frame.rotation * DVec3::Z;
    let (linear, angular) = match motion {
        JointMotion::Turn => (axis.cross(grip - frame.translation), axis),
        JointMotion::Slide => (axis, DVec3::ZERO),
    };
    linear.to_array().into_iter().chain(angular.to_array())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::ROBOTS;
    use rand::RngExt as _;

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let mut rng = stream(1, Stream::Ik, 0);
        for robot in ROBOTS {
            for _ in 0..50 {
                let config = JointConfig::from_fn(DOF, |j| {
                    rng.random_range(robot.joints[j].lower..robot.joints[j].upper)
                });
                let jacobian = robot.jacobian(&config);
                for j in 0..DOF {
                    let moved = |by: f64| {
                        let mut angles = config.to_array::<DOF>().map(f64::from);
                        angles[j] += by;
                        robot.frames_at(&angles).tip
                            * robot.body_from_flange
                            * robot.flange_from_grip
                    };
                    let (before, after) = (moved(-1e-5), moved(1e-5));
                    let linear = (after.translation - before.translation) / 2e-5;
                    // For a small turn the vector part of the quaternion is half the rotation
                    // vector.
                    let turn = after.rotation * before.rotation.inverse();
                    let angular =
                        DVec3::new(turn.x, turn.y, turn.z) * (turn.w.signum() * 2.0 / 2e-5);
                    for (row, expected) in
                        linear.to_array().into_iter().chain(angular.to_array()).enumerate()
                    {
                        assert!(
                            (jacobian[row][j] - expected).abs() < 1e-8,
                            "{}: row {row}, joint {j}",
                            robot.name
                        );
                    }
                }
            }
        }
    }
}
