//! The next-best poses of the golden tests of ranker and policy.

use crate::q_attention::NextBestPose;
use crate::robot::Gripper;

use glamx::{Pose3, Quat, Vec3};
use serde::Deserialize;

/// A next-best pose of `tests/peers/networks.py`.
#[derive(Debug, Deserialize)]
pub(crate) struct GoldenGoal {
    position: [f32; 3],
    quaternion: [f32; 4],
    gripper: Gripper,
}

impl GoldenGoal {
    pub(crate) fn next_best_pose(&self) -> NextBestPose {
        let pose =
            Pose3::from_parts(Vec3::from_array(self.position), Quat::from_array(self.quaternion));
        NextBestPose { pose, gripper: self.gripper }
    }
}
