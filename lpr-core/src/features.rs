//! Network inputs that ranker and policy share.

#[cfg(test)]
pub(crate) mod golden;

use crate::perception::rotation_columns;
use crate::q_attention::NextBestPose;
use crate::robot::{DOF, Gripper, Joint, JointConfig, Robot};

use glamx::Pose3;

/// Numbers of a pose: position (3), first two columns of the rotation matrix (6).
pub(crate) const POSE_FEATURES: usize = 9;
/// Numbers of a next-best pose: pose, gripper command.
pub(crate) const GOAL_FEATURES: usize = POSE_FEATURES + 1;

/// Maps joint angles so that the joint limits become ±1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct JointScale {
    center: [f32; DOF],
    half_range: [f32; DOF],
}

impl JointScale {
    pub(crate) fn new(robot: &Robot) -> Self {
        Self {
            center: of_joints(robot, |joint| 0.5 * (joint.lower + joint.upper)),
            half_range: of_joints(robot, |joint| 0.5 * (joint.upper - joint.lower)),
        }
    }

    pub(crate) fn apply(&self, config: &JointConfig) -> [f32; DOF] {
        core::array::from_fn(|j| (config[j] - self.center[j]) / self.half_range[j])
    }
}

/// A number of each joint of a seven-joint arm.
fn of_joints(robot: &Robot, f: impl Fn(&Joint) -> f32) -> [f32; DOF] {
    core::array::from_fn(|j| f(&robot.joints[j]))
}

/// Position in metres, and [`rotation_columns`].
pub(crate) fn pose_features(pose: &Pose3) -> [f32; POSE_FEATURES] {
    let [x, y, z] = pose.translation.to_array();
    let [a, b, c, d, e, f] = rotation_columns(pose.rotation);
    [x, y, z, a, b, c, d, e, f]
}

/// The grip's pose, then +1 for opening and -1 for closing there.
pub(crate) fn goal_features(goal: &NextBestPose) -> [f32; GOAL_FEATURES] {
    let mut features = [0.0; GOAL_FEATURES];
    features[..POSE_FEATURES].copy_from_slice(&pose_features(&goal.pose));
    features[POSE_FEATURES] = match goal.gripper {
        Gripper::Open => 1.0,
        Gripper::Close => -1.0,
    };
    features
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::PANDA;
    use glamx::{Quat, Vec3};

    #[test]
    fn joint_limits_become_one() {
        let scale = JointScale::new(&PANDA);
        let at = |fraction: f32| {
            scale.apply(&JointConfig::from_fn(DOF, |j| {
                let joint = &PANDA.joints[j];
                joint.lower + fraction * (joint.upper - joint.lower)
            }))
        };
        for (fraction, expected) in [(0.0, -1.0), (0.5, 0.0), (0.75, 0.5), (1.0, 1.0)] {
            assert!(
                at(fraction).iter().all(|value| (value - expected).abs() < 1e-6),
                "{:?}",
                at(fraction)
            );
        }
    }

    #[test]
    fn both_signs_of_a_quaternion_are_the_same_pose() {
        let rotation = Quat::from_rotation_z(0.7) * Quat::from_rotation_x(core::f32::consts::PI);
        let goal = |rotation| NextBestPose {
            pose: Pose3::from_parts(Vec3::new(0.4, -0.1, 0.2), rotation),
            gripper: Gripper::Close,
        };
        let features = goal_features(&goal(rotation));
        assert_eq!(features, goal_features(&goal(-rotation)));
        assert_eq!(features[..3], [0.4, -0.1, 0.2]);
        assert_eq!(features[POSE_FEATURES], -1.0);
        // The third column of a rotation is the cross product of the first two.
        let column = |k: usize| Vec3::new(features[k], features[k + 1], features[k + 2]);
        assert!((column(3).cross(column(6)) - rotation * Vec3::Z).length() < 1e-6);
    }
}
