//! JSON of poses and configurations, as every command reads and prints them.

use crate::files::{self, FileError, Result};
use lpr_core::glamx::{DPose3, DQuat, DVec3};
use lpr_core::robot::JointConfig;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How far the norm of a quaternion in a file may be from 1: it covers numbers with three decimals.
const NORM_TOLERANCE: f64 = 2e-3;

/// A pose in the world, which is the base of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseJson {
    /// Metres.
    pub position: [f64; 3],
    /// Unit quaternion with w ≥ 0.
    pub rotation_xyzw: [f64; 4],
}

impl From<DPose3> for PoseJson {
    fn from(pose: DPose3) -> Self {
        let rotation = if pose.rotation.w < 0.0 { -pose.rotation } else { pose.rotation };
        Self { position: pose.translation.to_array(), rotation_xyzw: rotation.to_array() }
    }
}

/// A pose for inverse kinematics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseQuery {
    /// `world_from_flange`.
    pub world_from_flange: DPose3,
    /// Where to look for a solution first.
    pub seed_config: Option<JointConfig>,
}

/// Reads `{"configs": [[q…]…]}`, radians.
///
/// # Errors
///
/// When the file is missing or malformed, naming the configuration at fault.
pub fn read_configs(path: &Path) -> Result<Vec<JointConfig>> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct ConfigsFile {
        configs: Vec<JointConfig>,
    }
    files::read_json(path).map(|ConfigsFile { configs }| configs)
}

/// Reads `{"poses": [{"position": [3], "rotation_xyzw": [4], "seed_config": [q…]?}]}`.
///
/// # Errors
///
/// When the file is missing or malformed, naming the pose at fault.
pub fn read_poses(path: &Path) -> Result<Vec<PoseQuery>> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct PosesFile {
        poses: Vec<PoseEntry>,
    }
    let PosesFile { poses } = files::read_json(path)?;
    poses.into_iter().enumerate().map(|(idx, entry)| entry.checked(path, idx)).collect()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseEntry {
    position: [f64; 3],
    rotation_xyzw: [f64; 4],
    seed_config: Option<JointConfig>,
}

impl PoseEntry {
    fn checked(self, path: &Path, idx: usize) -> Result<PoseQuery> {
        let rotation = DQuat::from_array(self.rotation_xyzw);
        let norm = rotation.length();
        if (norm - 1.0).abs() > NORM_TOLERANCE {
            let reason = format!("poses[{idx}].rotation_xyzw: has norm {norm}, expected a unit quaternion");
            return Err(FileError::content(path, reason));
        }
        let world_from_flange = DPose3::from_parts(DVec3::from_array(self.position), rotation.normalize());
        Ok(PoseQuery { world_from_flange, seed_config: self.seed_config })
    }
}
