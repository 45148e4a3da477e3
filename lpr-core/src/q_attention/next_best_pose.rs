//! The outcome of Q-attention.

use crate::robot::Gripper;
use glamx::Pose3;

/// The next pose of the gripper and its command there: `g` in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextBestPose {
    /// Pose of `grip` in the world.
    pub pose: Pose3,
    /// Command given when the pose is reached.
    pub gripper: Gripper,
}
