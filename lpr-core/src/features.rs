//! Network inputs that ranker and policy share.

#[cfg(test)]
pub(crate) mod golden;

use crate::perception::rotation_columns;
use crate::q_attention::{NextBestPose, half_turned};
use crate::robot::{DOF, Gripper, Joint, JointConfig, Robot};

use glamx::{Pose3, Vec3};

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
    features[POSE_FEATURES] = command_feature(goal.gripper);
    features
}

/// +1 for opening, -1 for closing.
pub(crate) const fn command_feature(command: Gripper) -> f32 {
    match command {
        Gripper::Open => 1.0,
        Gripper::Close => -1.0,
    }
}

/// Length that a position feature of 1 stands for in the frame of a goal, metres: the scale of the
/// motions that hinges and slides ask for.
pub(crate) const GRIP_SCALE: f32 = 0.2;

/// A grip pose in the frame of a goal.
pub(crate) fn grip_features(in_goal: &Pose3) -> [f32; POSE_FEATURES] {
    pose_features(&Pose3::from_parts(in_goal.translation / GRIP_SCALE, in_goal.rotation))
}

/// The frame of a goal, in which the same motion towards it is the same wherever it happens, also
/// with the hand the other way round, half turned about the approach: the start lies on one side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GoalFrame {
    goal_from_world: Pose3,
    is_turned: bool,
}

impl GoalFrame {
    /// The frame of `goal` for a motion from `start`, both `world_from_grip`.
    pub(crate) fn new(start: &Pose3, goal: &Pose3) -> Self {
        let start = (goal.inverse() * *start).translation;
        // Motions go along an axis of the hand or across one, seldom along the line between sides.
        let is_turned = side(start) < 0.0;
        let rotation = if is_turned { half_turned(goal.rotation) } else { goal.rotation };
        let goal_from_world = Pose3::from_parts(goal.translation, rotation).inverse();
        Self { goal_from_world, is_turned }
    }

    /// A grip of the world, seen from the goal.
    pub(crate) fn seen(&self, world_from_grip: &Pose3) -> Pose3 {
        self.turned(&(self.goal_from_world * *world_from_grip))
    }

    /// The inverse of [`Self::seen`].
    pub(crate) fn placed(&self, seen: &Pose3) -> Pose3 {
        self.goal_from_world.inverse() * self.turned(seen)
    }

    fn turned(&self, pose: &Pose3) -> Pose3 {
        let rotation = if self.is_turned { half_turned(pose.rotation) } else { pose.rotation };
        Pose3::from_parts(pose.translation, rotation)
    }
}

/// Which side of the hand a point in its frame is on: the sign; the line between the sides is 30°
/// off an axis.
fn side(point: Vec3) -> f32 {
    0.866_025_4 * point.x + 0.5 * point.y
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::PANDA;
    use glamx::Quat;
    use proptest::prelude::{any, prop_assert, prop_assume, proptest};

    fn angle(a: Quat, b: Quat) -> f32 {
        2.0 * (a.inverse() * b).xyz().length().min(1.0).asin()
    }

    proptest! {
        #[test]
        fn a_motion_towards_a_goal_is_the_same_wherever_it_happens_and_with_the_hand_half_turned(
            yaw in -3.0_f32..3.0, turn in proptest::array::uniform3(-1.5_f32..1.5), half in any::<bool>(),
        ) {
            let [start, goal] = [Vec3::new(0.3, 0.2, 0.4), Vec3::new(0.5, -0.1, 0.2)].map(|at| {
                Pose3::from_parts(at, Quat::from_scaled_axis(at.x * Vec3::from_array(turn)) * Quat::from_rotation_x(2.0))
            });
            let elsewhere = Pose3::from_parts(Vec3::new(-0.2, 0.1, 0.0), Quat::from_rotation_z(yaw));
            let hand = |pose: Pose3| {
                let rotation = if half { half_turned(pose.rotation) } else { pose.rotation };
                elsewhere * Pose3::from_parts(pose.translation, rotation)
            };
            prop_assume!(side((goal.inverse() * start).translation).abs() > 1e-4);
            let frame = GoalFrame::new(&start, &goal);
            let moved = GoalFrame::new(&hand(start), &hand(goal));
            let (here, there) = (frame.seen(&start), moved.seen(&hand(start)));
            prop_assert!(here.translation.distance(there.translation) < 1e-5);
            prop_assert!(angle(here.rotation, there.rotation) < 1e-4);
            let placed = moved.placed(&there);
            prop_assert!(placed.translation.distance(hand(start).translation) < 1e-5);
            prop_assert!(angle(placed.rotation, hand(start).rotation) < 1e-4);
        }
    }

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
