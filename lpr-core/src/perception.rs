//! Input of the agent: cameras, observations, voxel grids.

mod augment;
mod camera;
mod compact;
mod depth_noise;
mod observation;
mod voxel;

pub use augment::PointTransform;
pub use camera::{CAMERA_NAMES, Camera, IMAGE_SIZE};
pub use compact::{CompactGrid, CompactVoxel};
pub use depth_noise::DepthNoise;
#[cfg(feature = "learn")]
pub(crate) use observation::rotation_columns;
pub use observation::{LOW_DIM, Observation, Proprio, View, time_feature};
#[cfg(feature = "learn")]
pub(crate) use voxel::INDEX;
pub use voxel::{VOXEL_CHANNELS, VoxelBounds, VoxelGrid, VoxelIndex, VoxelSpace};
