//! The network of the `fast` preset: a small U-Net whose every layer is a matrix product.
//!
//! The stem reads 2³ voxels at once, 3³ convolutions run on half and a quarter of the side only,
//! and a cell emits the features of its eight voxels (a 3-D pixel shuffle), which meet each voxel's
//! own channels before its value. Cells stand in block order ([`super::blocks`]), so pooling and
//! un-pooling are reshapes, and a 3³ convolution is one gather of rows and one product.
//!
//! # Differences from the paper
//!
//! About 30 times fewer operations than C2F-ARM's U-Net. The head reads the features of the quarter
//! grid in place beside their maximum, because yaw shows in where things are around the attended
//! voxel; and the values of an Euler angle are a short Fourier series over the circle, so that one
//! demonstrated angle also teaches its neighbours. Positions in the input are within the voxel, not
//! in the world.

use super::blocks::{block_of_raster, neighbours, raster_of_block};
use super::{NetworkInput, PoseValues, QValues};
use crate::nn::{Dense, Spread, tensor};
use crate::perception::{LOW_DIM, VOXEL_CHANNELS};
use crate::rng::Rng;

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};

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
    pub(super) cell_channels: usize,
    pub(super) block_channels: usize,
}

/// Sizes of its head.
#[derive(Debug, Clone, Copy)]
pub(super) struct FastHeadSizes {
    pub(super) head_channels: usize,
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
    side: usize,
}

impl FastNetwork {
    pub(super) fn new(
        sizes: FastSizes,
        head: Option<FastHeadSizes>,
        device: &Device,
        rng: &mut Rng,
    ) -> Self {
        let FastSizes { side, cell_channels: c, block_channels: b } = sizes;
        Self {
            stem: Dense::new(BLOCK * VOXEL_CHANNELS, c, KAIMING, device, rng),
            cells: Dense::new(NEAR * c, c, KAIMING, device, rng),
            down: Dense::new(BLOCK * c, b, KAIMING, device, rng),
            proprio: Dense::new(LOW_DIM, b, KAIMING, device, rng),
            blocks: Dense::new(NEAR * b, b, KAIMING, device, rng),
            up: Dense::new(b, BLOCK * c, KAIMING, device, rng),
            merge: Dense::new(NEAR * c, c, KAIMING, device, rng),
            spread: Dense::new(c, BLOCK * VOXEL_FEATURES, KAIMING, device, rng),
            own: Dense::new(VOXEL_CHANNELS, VOXEL_FEATURES, KAIMING, device, rng),
            translation: Dense::new(VOXEL_FEATURES, 1, Spread::Zero, device, rng),
            translation_of_cell: Dense::new(c, BLOCK, Spread::Zero, device, rng),
            head: head.map(|head| FastHead::new(sizes, head, device, rng)),
            side,
        }
    }

    pub(super) fn forward(&self, input: NetworkInput) -> QValues {
        let [n, channels, n_voxels] = input.voxels.dims();
        let device = input.voxels.device();
        let [half, quarter] = [self.side / 2, self.side / 4];
        let voxels = input.voxels.swap_dims(1, 2).reshape([n * n_voxels, channels]);
        // Block order, 4³ voxels a block: the reshapes below gather the 2³ children of a cell or
        // block.
        let voxels = voxels.select(0, per_sample(&raster_of_block(self.side, 4), n, &device));
        let n_cells = n * half * half * half;
        let n_blocks = n * quarter * quarter * quarter;
        let near_cells = near_rows(half, 2, n, &device);

        let stem = relu(self.stem.forward(voxels.clone().reshape([n_cells, BLOCK * channels])));
        let cells = relu(self.cells.forward(gather_near(stem, &near_cells)));
        let [_, c] = cells.dims();
        let down = self.down.forward(cells.clone().reshape([n_blocks, BLOCK * c]));
        let [_, b] = down.dims();
        let proprio = self.proprio.forward(input.proprio).reshape([n, 1, b]);
        let down = relu(down.reshape([n, n_blocks / n, b]) + proprio).reshape([n_blocks, b]);
        let blocks = relu(
            self.blocks.forward(gather_near(down.clone(), &near_rows(quarter, 1, n, &device))),
        ) + down;
        let up = self.up.forward(blocks.clone()).reshape([n_cells, c]);
        let merged = relu(up + cells);
        let merged = relu(self.merge.forward(gather_near(merged.clone(), &near_cells))) + merged;
        let spread = self.spread.forward(merged.clone()).reshape([n * n_voxels, VOXEL_FEATURES]);
        let values = self.translation.forward(relu(spread + self.own.forward(voxels)));
        let values =
            values + self.translation_of_cell.forward(merged.clone()).reshape([n * n_voxels, 1]);
        let translation = values
            .select(0, per_sample(&block_of_raster(self.side, 4), n, &device))
            .reshape([n, n_voxels]);
        QValues {
            translation,
            pose: self.head.as_ref().map(|head| head.forward(blocks, merged, n)),
        }
    }

    /// Multiply-accumulates of one forward pass of one sample, about: one for each weight and bias
    /// wherever it is applied.
    pub(super) fn macs(&self) -> usize {
        let [half, quarter] = [self.side / 2, self.side / 4];
        let cells = half * half * half;
        let blocks = quarter * quarter * quarter;
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
            + 2 * sizes.cell_channels;
        let n_coefficients = 2 * head.harmonics + 1;
        Self {
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
    fn forward(&self, blocks: Tensor<2>, cells: Tensor<2>, n: usize) -> PoseValues {
        let in_place = relu(self.narrow.forward(blocks.clone()));
        let [n_rows, channels] = in_place.dims();
        let in_place = in_place.reshape([n, n_rows / n * channels]);
        let features = Tensor::cat(vec![in_place, pool(blocks, n), pool(cells, n)], 1);
        let hidden = relu(self.hidden.forward(features));
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

/// Rows of all 27 neighbours of each row, for `n` samples.
fn near_rows(side: usize, block: usize, n: usize, device: &Device) -> Tensor<1, Int> {
    per_sample(neighbours(side, block).as_flattened(), n, device)
}

/// A row index within one sample, repeated for `n` samples that follow each other.
fn per_sample(index: &[usize], n: usize, device: &Device) -> Tensor<1, Int> {
    let n_rows = index.iter().max().map_or(0, |last| last + 1);
    let all = (0..n)
        .flat_map(|sample| index.iter().map(move |row| (sample * n_rows + row) as i32))
        .collect::<Vec<_>>();
    let n_all = all.len();
    Tensor::from_data(TensorData::new(all, [n_all]), device)
}

/// Each row beside its neighbours: `[N, C]` to `[N, 27 C]`.
fn gather_near(features: Tensor<2>, near: &Tensor<1, Int>) -> Tensor<2> {
    let [n_rows, channels] = features.dims();
    features.select(0, near.clone()).reshape([n_rows, NEAR * channels])
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
