//! Coarse-to-fine Q-attention: from a voxelised scene to the next-best pose.

mod action;
#[cfg(feature = "learn")]
mod agent;
#[cfg(feature = "learn")]
mod batch;
mod grasp;
#[cfg(feature = "learn")]
mod loss;
#[cfg(feature = "learn")]
mod network;
mod next_best_pose;
mod observation;
#[cfg(feature = "learn")]
mod position;
mod settings;

pub use action::{ActionCodec, DiscreteAction, RotationCodec, canonical};
#[cfg(feature = "learn")]
pub use agent::{
    ActingNetwork, DepthDecision, DepthState, QAttention, QAttentionState, QDecision, UpdateReport,
};
#[cfg(feature = "learn")]
pub use batch::{AugmentedLabel, QSample};
pub use grasp::{HalfTurn, Hand, canonical_grasp, half_turned};
#[cfg(feature = "learn")]
pub use network::{NetworkCost, NetworkInput, PoseValues, QNetwork, QValues, UNet};
pub use next_best_pose::NextBestPose;
pub use observation::{QObservation, StoredPoint};
pub use settings::{
    HandJitter, Imitation, Jitter, NetworkSettings, Places, Position, QAttentionSettings,
};

#[cfg(all(test, feature = "learn"))]
mod tests;
