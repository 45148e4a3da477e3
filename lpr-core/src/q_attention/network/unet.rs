//! A U-Net of plain layers, to be timed beside other frameworks: tests/peers/pytorch.
//!
//! On a grid of 16³ with 10 channels: two 3³ layers at full, half and quarter side, the first of
//! the lower two with stride 2; two back up, each on the nearest cells of the grid below beside the
//! features of its own; a value for each voxel, and a head on the mean of the quarter grid and the
//! maximum of the full one. Zero padding, ReLU everywhere, cells in block order ([`super::blocks`]).

use super::blocks::block_of_raster;
use crate::nn::{
    Activation, Adam, AdamSettings, Backend, Dense, GradientClip, Padding, ParameterGradients,
    Spread, Tiles, Windows, in_halves, parameter_gradients, sum_of_gradients, tensor, values,
};
use crate::rng::Rng;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::RngExt as _;
use std::sync::Arc;

const SIDE: usize = 16;
/// Voxels of a sample.
const N_VOXELS: usize = SIDE * SIDE * SIDE;
const CHANNELS: usize = 10;
/// Cells of a 3³ neighbourhood.
const NEAR: usize = 27;
const KAIMING: Spread = Spread::Kaiming { slope: 0.0 };

/// The network with its optimiser. What it computes is of no use.
#[derive(Debug)]
pub struct UNet {
    layers: Layers,
    adam: Adam,
    device: Device,
}

impl UNet {
    /// A network with fresh weights.
    #[must_use]
    pub fn new(backend: Backend, rng: &mut Rng) -> Self {
        let device = backend.device();
        let layers = Layers::new(&device, rng);
        let settings = AdamSettings { learning_rate: 1e-3, l2: 0.0, clip: GradientClip::None };
        Self { adam: Adam::new(settings, &layers), layers, device }
    }

    /// Random voxels for [`Self::infer`] and [`Self::update`].
    #[must_use]
    pub fn random_sample(rng: &mut Rng) -> Vec<f32> {
        (0..N_VOXELS * CHANNELS).map(|_| rng.random()).collect()
    }

    /// The values of all voxels and those of the head.
    #[must_use]
    pub fn infer(&self, sample: &[f32]) -> [Vec<f32>; 2] {
        self.layers.forward(tensor(sample.to_vec(), [N_VOXELS, CHANNELS], &self.device)).map(values)
    }

    /// One step of Adam on the sum of the mean squares of both outputs, which is returned.
    pub fn update(&mut self, batch: &[Vec<f32>]) -> f32 {
        let halves = in_halves(batch, |half| self.half(half, batch.len()));
        let loss = halves.iter().map(|half| half.0).sum();
        let gradients = sum_of_gradients(halves.into_iter().map(|half| half.1));
        self.layers = self.adam.step(self.layers.clone(), gradients);
        loss
    }

    /// Loss and gradients of some samples of a batch of `n_samples`.
    fn half(&self, batch: &[Vec<f32>], n_samples: usize) -> (f32, ParameterGradients) {
        let device = self.device.clone().autodiff();
        let leaves = self.layers.clone().train();
        let x = tensor(batch.concat(), [batch.len() * N_VOXELS, CHANNELS], &device);
        let [voxels, head] = leaves.forward(x).map(|values| values.square().mean());
        let loss = (voxels + head) * (batch.len() as f32 / n_samples as f32);
        let value = loss.clone().inner().into_scalar();
        (value, parameter_gradients(&leaves, loss.backward()))
    }
}

#[derive(Module, Debug)]
struct Layers {
    full: [Dense; 2],
    half: [Dense; 2],
    quarter: [Dense; 2],
    up: [Dense; 2],
    value: Dense,
    head: [Dense; 2],
    #[module(skip)]
    grids: Grids,
}

/// How the cells of the full, half and quarter grid lie.
#[derive(Debug, Clone)]
struct Grids {
    tiles: [Arc<Tiles>; 3],
    /// From the full to the half and from there to the quarter grid.
    windows: [Arc<Windows>; 2],
}

impl Grids {
    fn new() -> Self {
        let tiles = [(1, 4), (2, 2), (4, 1)].map(|(division, block)| {
            let side = SIDE / division;
            let rows = block_of_raster(side, block);
            Arc::new(Tiles::in_order([side; 3], Padding::Zero, &rows))
        });
        let windows = [0, 1].map(|grid| Arc::new(Windows::of_blocks(&tiles[grid])));
        Self { tiles, windows }
    }
}

impl Layers {
    fn new(device: &Device, rng: &mut Rng) -> Self {
        let mut dense = |fan_in, fan_out| Dense::new(fan_in, fan_out, KAIMING, device, rng);
        Self {
            full: [dense(NEAR * CHANNELS, 32), dense(NEAR * 32, 32)],
            half: [dense(NEAR * 32, 64), dense(NEAR * 64, 64)],
            quarter: [dense(NEAR * 64, 64), dense(NEAR * 64, 64)],
            up: [dense(NEAR * 128, 64), dense(NEAR * 96, 32)],
            value: dense(32, 1),
            head: [dense(96, 256), dense(256, 218)],
            grids: Grids::new(),
        }
    }

    /// `[B * voxels, 10]` to the values of all voxels, `[B, voxels]`, and of the head, `[B, 218]`.
    fn forward(&self, x: Tensor<2>) -> [Tensor<2>; 2] {
        let relu = Activation::Relu;
        let n = x.dims()[0] / N_VOXELS;
        let Grids { tiles: [full, half, quarter], windows: [to_half, to_quarter] } = &self.grids;
        let x = self.full[0].convolved(x, full, relu);
        let c = self.full[1].convolved(x, full, relu);
        let x = self.half[0].strided(c.clone(), to_half, relu);
        let d1 = self.half[1].convolved(x, half, relu);
        let x = self.quarter[0].strided(d1.clone(), to_quarter, relu);
        let d2 = self.quarter[1].convolved(x, quarter, relu);
        let u = self.up[0].joined([d1, d2.clone()], half, relu);
        let u = self.up[1].joined([c, u], full, relu);
        let mean = d2.reshape([n, N_VOXELS / 64, 64]).mean_dim(1).reshape([n, 64]);
        let most = u.clone().reshape([n, N_VOXELS, 32]).max_dim(1).reshape([n, 32]);
        let head = self.head[0].activated(Tensor::cat(vec![mean, most], 1), relu);
        [self.value.forward(u).reshape([n, N_VOXELS]), self.head[1].forward(head)]
    }
}
