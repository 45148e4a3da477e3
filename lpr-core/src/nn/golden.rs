//! What the golden tests of ranker and policy share.

use super::NamedTensor;
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

pub(crate) fn assert_close(what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (idx, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= tolerance, "{what}[{idx}]: {f}, expected {e}");
    }
}

pub(crate) fn assert_tensors_close(
    found: &[NamedTensor],
    expected: &[NamedTensor],
    tolerance: f32,
) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!((&found.name, &found.shape), (&expected.name, &expected.shape));
        assert_close(&found.name, &found.values, &expected.values, tolerance);
    }
}
