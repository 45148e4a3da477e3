//! What the network of a depth reads.

use super::QNetwork;
use crate::nn::tensor;
use crate::perception::{LOW_DIM, Proprio, VOXEL_CHANNELS, VoxelGrid, rotation_columns};
use crate::q_attention::grasp::HalfTurn;

use burn::tensor::{Device, Tensor};
use glamx::Vec3;

/// Input of the network of one depth.
#[derive(Debug, Clone)]
pub struct NetworkInput {
    /// `[B, D H W, 10]`: the channels of [`crate::perception::VoxelGrid`] for each voxel, in the
    /// order of [`QNetwork::raster_of_row`].
    pub voxels: Tensor<3>,
    /// `[B, 11]` or `[B, 14]`: what the arm knows of itself, see [`HalfTurn`].
    pub proprio: Tensor<2>,
}

impl NetworkInput {
    /// Grids and proprioception ([`proprio_features`]) as one batch for `network`.
    pub(in crate::q_attention) fn new(
        network: &QNetwork,
        grids: &[VoxelGrid],
        proprio: &[Vec<f32>],
        device: &Device,
    ) -> Self {
        let n_proprio = proprio.first().map_or(0, Vec::len);
        let n_voxels = grids.first().map_or(0, |grid| grid.space.n_voxels());
        let mut voxels = Vec::with_capacity(grids.len() * n_voxels * VOXEL_CHANNELS);
        for grid in grids {
            match network.raster_of_row() {
                Some(raster_of_row) => {
                    let half_voxel = 0.5 * grid.space.voxel_size();
                    voxels.extend(
                        raster_of_row.iter().flat_map(|&flat| centered(grid, flat, half_voxel)),
                    );
                }
                None => voxels.extend((0..n_voxels).flat_map(|flat| grid.voxel(flat))),
            }
        }
        Self {
            voxels: tensor(voxels, [grids.len(), n_voxels, VOXEL_CHANNELS], device),
            proprio: tensor(proprio.concat(), [proprio.len(), n_proprio], device),
        }
    }
}

/// What a network is told of the arm: [`Proprio::low_dim`], and under the rule of
/// [`HalfTurn::Relative`] whether the gripper is open (1) and holds something (1), position (3) and
/// first two columns of the rotation (6) of the canonical hand, finger positions (2) and time (1).
///
/// A quaternion has two signs, and over the orientations that tasks use no choice between them
/// keeps neighbours together.
pub(in crate::q_attention) fn proprio_features(half_turn: HalfTurn, proprio: &Proprio) -> Vec<f32> {
    let low_dim = proprio.low_dim();
    if half_turn != HalfTurn::Relative {
        return low_dim.to_vec();
    }
    let mut features = vec![proprio.gripper_open, f32::from(u8::from(proprio.holds()))];
    features.extend_from_slice(&proprio.grip.translation.to_array());
    features.extend(rotation_columns(half_turn.seen(proprio.grip.rotation)));
    features.extend_from_slice(&low_dim[LOW_DIM - 3..]);
    features
}

/// Length of [`proprio_features`].
pub(super) const fn n_proprio(half_turn: HalfTurn) -> usize {
    match half_turn {
        HalfTurn::Ignored | HalfTurn::Nearest => LOW_DIM,
        HalfTurn::Relative => 14,
    }
}

/// The channels of a voxel with its mean position as fractions from its centre, -1 to 1, instead of
/// metres in the world; zero where nothing is.
///
/// A lesson from one place then holds at every other, and a millimetre is not lost beside a
/// metre.
fn centered(grid: &VoxelGrid, flat: usize, half_voxel: Vec3) -> [f32; VOXEL_CHANNELS] {
    let mut channels = grid.voxel(flat);
    let voxel = grid.space.voxel_from_flat(flat);
    if grid.is_occupied(voxel) {
        let center = grid.space.point_from_voxel(voxel);
        for axis in 0..3 {
            channels[axis] = (channels[axis] - center[axis]) / half_voxel[axis];
        }
    }
    channels
}
