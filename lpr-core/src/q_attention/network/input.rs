//! What the network of a depth reads.

use super::QNetwork;
use crate::nn::tensor;
use crate::perception::{LOW_DIM, Proprio, VOXEL_CHANNELS, VoxelGrid};

use burn::tensor::{Device, Tensor};
use glamx::Vec3;

/// Input of the network of one depth.
#[derive(Debug, Clone)]
pub struct NetworkInput {
    /// `[B, D H W, 10]`: the channels of [`crate::perception::VoxelGrid`] for each voxel, in the
    /// order of [`QNetwork::raster_of_row`].
    pub voxels: Tensor<3>,
    /// `[B, 11]`: what the arm knows of itself.
    pub proprio: Tensor<2>,
}

impl NetworkInput {
    /// Grids and proprioception as one batch for `network`.
    pub(in crate::q_attention) fn new(
        network: &QNetwork,
        grids: &[VoxelGrid],
        proprio: &[Proprio],
        device: &Device,
    ) -> Self {
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
        let low_dim = proprio.iter().flat_map(Proprio::low_dim).collect();
        Self {
            voxels: tensor(voxels, [grids.len(), n_voxels, VOXEL_CHANNELS], device),
            proprio: tensor(low_dim, [proprio.len(), LOW_DIM], device),
        }
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
