//! Coarse-to-fine Q-attention: from a voxelised scene to the next-best pose.

mod action;
#[cfg(feature = "learn")]
mod agent;
#[cfg(feature = "learn")]
mod batch;
#[cfg(feature = "learn")]
mod loss;
#[cfg(feature = "learn")]
mod network;
mod observation;
mod settings;

pub use action::{
    ActionCodec, DiscreteAction, RotationCodec, canonical, canonical_grasp, nearest_grasp,
};
#[cfg(feature = "learn")]
pub use agent::{
    DepthDecision, DepthState, QAttention, QAttentionState, QDecision, UpdateReport, Weights,
};
#[cfg(feature = "learn")]
pub use batch::QSample;

#[cfg(feature = "learn")]
pub use network::{Heads, NetworkCost, NetworkInput, PoseValues, QNetwork, QValues};
pub use observation::{QObservation, StoredPoint};
pub use settings::{Imitation, NetworkSettings, QAttentionSettings};

use crate::robot::Gripper;
use glamx::Pose3;

/// Where the gripper goes next and what it does there: `g` in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextBestPose {
    /// Pose of `grip` in the world.
    pub pose: Pose3,
    /// Command given when the pose is reached.
    pub gripper: Gripper,
}

#[cfg(all(test, feature = "learn"))]
mod tests;
