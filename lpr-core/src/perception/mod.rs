//! What the agent sees: cameras, observations, voxel grids.

mod camera;
mod observation;

pub use camera::{CAMERA_NAMES, Camera, IMAGE_SIZE};
pub use observation::{LOW_DIM, Observation, Proprio, View, time_feature};
