//! The network of the `fast` preset: a small U-Net.
//!
//! The stem reads 2³ voxels at once, 3³ convolutions run on half and a quarter of the side only,
//! and a cell emits the features of its eight voxels (a 3-D pixel shuffle), which meet each voxel's
//! own channels before its value. Cells stand in block order ([`super::blocks`]), so that pooling and
//! un-pooling are reshapes.
//!
//! # Differences from the paper
//!
//! About 30 times fewer operations than C2F-ARM's U-Net. The head reads the features of the quarter
//! grid in place beside their maximum, because yaw shows in where things are around the attended
//! voxel; it can read the cells around that voxel too, wherever it is, so that a thing shows its yaw
//! alike everywhere; and the values of an Euler angle are a short Fourier series over the circle, so
//! that one demonstrated angle also teaches its neighbours. Positions in the input are within the
//! voxel, not in the world.

use super::blocks::{block_of_raster, raster_of_block};
use super::{NetworkInput, PoseValues, QValues};
use crate::nn::{Activation, Dense, Padding, Spread, Tiles, ints, tensor};
use crate::rng::Rng;

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use std::sync::Arc;

/// Cells of a 2³ block.
const BLOCK: usize = 8;
/// Cells of a 3³ neighbourhood.
const NEAR: usize = 27;

/// Features of a voxel before its value: from its cell, plus from its own channels.
const VOXEL_FEATURES: usize = 8;

const KAIMING: Spread = Spread::Kaiming { slope: 0.0 };

/// Sizes of a [`FastNetwork`].
#[derive(Debug, Clone, Copy)]
pub(super) struct FastSizes {
    pub(super) side: usize,
    /// Channels of a voxel.
    pub(super) channels: usize,
    /// Numbers of the proprioception.
    pub(super) proprio: usize,
    pub(super) cell_channels: usize,
    pub(super) block_channels: usize,
}

/// Sizes of its head.
#[derive(Debug, Clone, Copy)]
pub(super) struct FastHeadSizes {
    pub(super) head_channels: usize,
    pub(super) attended_channels: usize,
    pub(super) hidden: usize,
    pub(super) rotation_bins: usize,
    pub(super) harmonics: usize,
}

/// See the module.
#[derive(Module, Debug)]
pub(super) struct FastNetwork {
    stem: Dense,
    cells: Dense,
    down: Dense,
    proprio: Dense,
    blocks: Dense,
    up: Dense,
    merge: Dense,
    spread: Dense,
    own: Dense,
    translation: Dense,
    translation_of_cell: Dense,
    head: Option<FastHead>,
    #[module(skip)]
    order: Arc<Order>,
}

/// Where the voxels, cells and blocks of a sample stand: in block order, 4³ voxels a block.
#[derive(Debug)]
struct Order {
    side: usize,
    raster_of_row: Vec<usize>,
    row_of_raster: Vec<i32>,
    cells: Arc<Tiles>,
    blocks: Arc<Tiles>,
}

impl Order {
    fn new(side: usize) -> Self {
        let tiles = |side: usize, block: usize| {
            let rows = block_of_raster(side, block);
            Arc::new(Tiles::in_order([side; 3], Padding::Replicate, &rows))
        };
        let row_of_raster = block_of_raster(side, 4).into_iter().map(|row| row as i32).collect();
        Self {
            side,
            raster_of_row: raster_of_block(side, 4),
            row_of_raster,
            cells: tiles(side / 2, 2),
            blocks: tiles(side / 4, 1),
        }
    }

    /// Rows of the cells around a voxel of each of the samples; beyond the grid the outermost.
    fn cells_around(&self, voxels: &[usize]) -> Vec<i32> {
        let (side, n_cells) = (self.side, self.row_of_raster.len() / BLOCK);
        let mut rows = Vec::with_capacity(voxels.len() * NEAR);
        for (sample, &voxel) in voxels.iter().enumerate() {
            let at = [voxel % side, voxel / side % side, voxel / (side * side)];
            for near in 0..NEAR {
                let step = [near % 3, near / 3 % 3, near / 9];
                // The voxel at the same place in the cell before, in its own, in the one behind.
                let [x, y, z] = [0, 1, 2]
                    .map(|axis| (at[axis] + 2 * step[axis]).saturating_sub(2).min(side - 1));
                let row = self.row_of_raster[(z * side + y) * side + x] as usize;
                // A cell's eight voxels are eight rows.
                rows.push((sample * n_cells + row / BLOCK) as i32);
            }
        }
        rows
    }
}

impl FastNetwork {
    pub(super) fn new(
        sizes: FastSizes,
        head: Option<FastHeadSizes>,
        device: &Device,
        rng: &mut Rng,
    ) -> Self {
        let FastSizes { side, cell_channels: c, block_channels: b, .. } = sizes;
        Self {
            stem: Dense::new(BLOCK * sizes.channels, c, KAIMING, device, rng),
            cells: Dense::new(NEAR * c, c, KAIMING, device, rng),
            down: Dense::new(BLOCK * c, b, KAIMING, device, rng),
            proprio: Dense::new(sizes.proprio, b, KAIMING, device, rng),
            blocks: Dense::new(NEAR * b, b, KAIMING, device, rng),
            up: Dense::new(b, BLOCK * c, KAIMING, device, rng),
            merge: Dense::new(NEAR * c, c, KAIMING, device, rng),
            spread: Dense::new(c, BLOCK * VOXEL_FEATURES, KAIMING, device, rng),
            own: Dense::new(sizes.channels, VOXEL_FEATURES, KAIMING, device, rng),
            translation: Dense::new(VOXEL_FEATURES, 1, Spread::Zero, device, rng),
            translation_of_cell: Dense::new(c, BLOCK, Spread::Zero, device, rng),
            head: head.map(|head| FastHead::new(sizes, head, device, rng)),
            order: Arc::new(Order::new(side)),
        }
    }

    pub(super) fn forward(&self, input: NetworkInput) -> QValues {
        let [n, n_voxels, channels] = input.voxels.dims();
        let device = input.voxels.device();
        let [n_cells, n_blocks] = [n * n_voxels / BLOCK, n * n_voxels / (BLOCK * BLOCK)];
        let order = &self.order;

        // In block order, reshapes gather the 2³ children of a cell or block.
        let children = input.voxels.clone().reshape([n_cells, BLOCK * channels]);
        let stem = self.stem.activated(children, Activation::Relu);
        let cells = self.cells.convolved(stem, &order.cells, Activation::Relu);
        let [_, c] = cells.dims();
        let down = self.down.forward(cells.clone().reshape([n_blocks, BLOCK * c]));
        let [_, b] = down.dims();
        let proprio = self.proprio.forward(input.proprio).reshape([n, 1, b]);
        let down = relu(down.reshape([n, n_blocks / n, b]) + proprio).reshape([n_blocks, b]);
        let blocks = self.blocks.convolved(down.clone(), &order.blocks, Activation::Relu) + down;
        let up = self.up.forward(blocks.clone()).reshape([n_cells, c]);
        let merged = relu(up + cells);
        let merged = self.merge.convolved(merged.clone(), &order.cells, Activation::Relu) + merged;
        let spread = self.spread.forward(merged.clone()).reshape([n * n_voxels, VOXEL_FEATURES]);
        let own = self.own.forward(input.voxels.reshape([n * n_voxels, channels]));
        let values = self.translation.forward(relu(spread + own)).reshape([n, n_voxels]);
        let values =
            values + self.translation_of_cell.forward(merged.clone()).reshape([n, n_voxels]);
        let rows = Tensor::<1, Int>::from_data(
            TensorData::new(order.row_of_raster.clone(), [n_voxels]),
            &device,
        );
        let translation = values.select(1, rows);
        let pose = self.head.as_ref().map(|head| {
            let around = head.attended.is_some().then(|| {
                let best = || ints(translation.clone().argmax(1));
                let rows = order.cells_around(&input.attended.unwrap_or_else(best));
                let rows = TensorData::new(rows, [n * NEAR]);
                let cells = merged.clone().select(0, Tensor::from_data(rows, &device));
                cells.reshape([n, NEAR * c])
            });
            head.forward(blocks, merged, around, n)
        });
        QValues { translation, pose }
    }

    /// Raster index of the voxel that stands in each row of the input.
    pub(super) fn raster_of_row(&self) -> &[usize] {
        &self.order.raster_of_row
    }

    /// Multiply-accumulates of one forward pass of one sample, about: one for each weight and bias
    /// wherever it is applied.
    pub(super) fn macs(&self) -> usize {
        let cells = self.order.raster_of_row.len() / BLOCK;
        let blocks = cells / BLOCK;
        let per_cell =
            [&self.stem, &self.cells, &self.merge, &self.spread, &self.translation_of_cell]
                .map(Module::num_params)
                .iter()
                .sum::<usize>();
        let per_block =
            [&self.down, &self.blocks, &self.up].map(Module::num_params).iter().sum::<usize>();
        let head = self.head.as_ref().map_or(0, |head| head.macs(blocks));
        let per_voxel = self.own.num_params() + self.translation.num_params();
        BLOCK * cells * per_voxel
            + cells * per_cell
            + blocks * per_block
            + self.proprio.num_params()
            + head
    }
}

/// Rotation and gripper values from the features of blocks and cells.
#[derive(Module, Debug)]
struct FastHead {
    narrow: Dense,
    attended: Option<Dense>,
    hidden: Dense,
    rotation: Dense,
    gripper: Dense,
    #[module(skip)]
    rotation_bins: usize,
    #[module(skip)]
    harmonics: usize,
}

impl FastHead {
    fn new(sizes: FastSizes, head: FastHeadSizes, device: &Device, rng: &mut Rng) -> Self {
        let quarter = sizes.side / 4;
        let n_features = quarter * quarter * quarter * head.head_channels
            + 2 * sizes.block_channels
            + 2 * sizes.cell_channels
            + head.attended_channels;
        let n_coefficients = 2 * head.harmonics + 1;
        let attended = head.attended_channels;
        let attended = (attended > 0)
            .then(|| Dense::new(NEAR * sizes.cell_channels, attended, KAIMING, device, rng));
        Self {
            attended,
            narrow: Dense::new(sizes.block_channels, head.head_channels, KAIMING, device, rng),
            hidden: Dense::new(n_features, head.hidden, KAIMING, device, rng),
            rotation: Dense::new(head.hidden, 3 * n_coefficients, Spread::Zero, device, rng),
            gripper: Dense::new(head.hidden, 2, Spread::Zero, device, rng),
            rotation_bins: head.rotation_bins,
            harmonics: head.harmonics,
        }
    }

    /// # Shapes
    ///
    /// - `blocks`: `[B * blocks, block_channels]`, `cells`: `[B * cells, cell_channels]`
    /// - `around`: `[B, 27 * cell_channels]`, the cells around the attended voxel
    fn forward(
        &self,
        blocks: Tensor<2>,
        cells: Tensor<2>,
        around: Option<Tensor<2>>,
        n: usize,
    ) -> PoseValues {
        let in_place = self.narrow.activated(blocks.clone(), Activation::Relu);
        let [n_rows, channels] = in_place.dims();
        let in_place = in_place.reshape([n, n_rows / n * channels]);
        let attended = self.attended.iter().zip(around);
        let attended = attended.map(|(layer, cells)| layer.activated(cells, Activation::Relu));
        let mut features = vec![in_place, pool(blocks, n), pool(cells, n)];
        features.extend(attended);
        let features = Tensor::cat(features, 1);
        let hidden = self.hidden.activated(features, Activation::Relu);
        let device = hidden.device();
        let coefficients =
            self.rotation.forward(hidden.clone()).reshape([3 * n, 2 * self.harmonics + 1]);
        let rotation =
            coefficients.matmul(fourier_basis(self.harmonics, self.rotation_bins, &device));
        PoseValues {
            rotation: rotation.reshape([n, 3, self.rotation_bins]),
            gripper: self.gripper.forward(hidden),
        }
    }

    fn macs(&self, n_blocks: usize) -> usize {
        let series = 3 * (2 * self.harmonics + 1) * self.rotation_bins;
        n_blocks * self.narrow.num_params()
            + self.attended.as_ref().map_or(0, Module::num_params)
            + self.hidden.num_params()
            + self.rotation.num_params()
            + self.gripper.num_params()
            + series
    }
}

/// Mean and maximum over the rows of each sample: `[B * rows, C]` to `[B, 2 C]`.
fn pool(features: Tensor<2>, n: usize) -> Tensor<2> {
    let [n_rows, channels] = features.dims();
    let features = features.reshape([n, n_rows / n, channels]);
    Tensor::cat(vec![features.clone().mean_dim(1), features.max_dim(1)], 2)
        .reshape([n, 2 * channels])
}

/// `1, cos θ, sin θ, cos 2θ, …` at the centres of all bins: `[2 H + 1, R]`.
fn fourier_basis(harmonics: usize, n_bins: usize, device: &Device) -> Tensor<2> {
    let angle = |order: usize, bin: usize| {
        core::f32::consts::TAU * (order * bin % n_bins) as f32 / n_bins as f32
    };
    let basis = (0..=2 * harmonics)
        .flat_map(|row| {
            (0..n_bins).map(move |bin| {
                let angle = angle(row.div_ceil(2), bin);
                if row % 2 == 0 && row > 0 { libm::sinf(angle) } else { libm::cosf(angle) }
            })
        })
        .collect::<Vec<_>>();
    tensor(basis, [2 * harmonics + 1, n_bins], device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cells_around_a_voxel_are_its_own_and_its_neighbours() {
        let side = 12;
        let order = Order::new(side);
        let n_voxels = side * side * side;
        // Cell of each voxel, in cells from the corner.
        let cell = |voxel: usize| {
            [voxel % side, voxel / side % side, voxel / (side * side)].map(|at| at / 2)
        };
        let n_cells = n_voxels / BLOCK;
        let mut cell_of_row = vec![[0; 3]; n_cells];
        for voxel in 0..n_voxels {
            cell_of_row[order.row_of_raster[voxel] as usize / BLOCK] = cell(voxel);
        }
        let voxels: Vec<_> = (0..n_voxels).collect();
        for (voxel, rows) in order.cells_around(&voxels).chunks(NEAR).enumerate() {
            let own = cell(voxel);
            for (near, &row) in rows.iter().enumerate() {
                let row = row as usize - voxel * n_cells;
                let step = [near % 3, near / 3 % 3, near / 9];
                let expected =
                    [0, 1, 2].map(|k| (own[k] + step[k]).saturating_sub(1).min(side / 2 - 1));
                assert_eq!(cell_of_row[row], expected, "voxel {voxel}, neighbour {near}");
            }
        }
    }
}
