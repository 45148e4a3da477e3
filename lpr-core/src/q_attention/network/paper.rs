//! The 3-D U-Net of C2F-ARM: inception blocks, leaky rectifiers, replicate padding, no
//! normalisation.
//!
//! Layer by layer as in the released network; the sizes it was released with are 64 channels, a
//! bottleneck of 32 and 128 hidden units: 879,553 parameters at depth 0 and 1,186,459 at the last
//! depth (both tested).

use super::layers::Conv3;
use super::{NetworkInput, PoseValues, QValues};
use crate::nn::{Activation, Dense, Padding, Spread, Tiles, tensor};
use crate::perception::VOXEL_CHANNELS;
use crate::rng::Rng;

use burn::module::Module;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use std::sync::Arc;

/// Slope of the leaky rectifier below zero (released).
const SLOPE: f32 = 0.02;
const LEAKY: Activation = Activation::Leaky { slope: SLOPE };
/// Temperature of the spatial softmax (released).
const TEMPERATURE: f32 = 0.01;
const KAIMING: Spread = Spread::Kaiming { slope: SLOPE };

/// Sizes of a [`PaperNetwork`].
#[derive(Debug, Clone, Copy)]
pub(super) struct PaperSizes {
    pub(super) side: usize,
    /// Numbers of the proprioception.
    pub(super) proprio: usize,
    pub(super) channels: usize,
    pub(super) bottleneck: usize,
    pub(super) hidden: usize,
    /// Bins of each Euler angle; none: no pose head.
    pub(super) rotation_bins: Option<usize>,
}

/// See the module.
#[derive(Module, Debug)]
pub(super) struct PaperNetwork {
    input: Inception,
    proprio: Dense,
    down: [Inception; 3],
    up: [UpBlock; 2],
    merge: Conv3,
    translation: Conv3,
    head: Option<PaperHead>,
    /// Of the whole, half and a quarter of the side.
    #[module(skip)]
    grids: [Grid; 3],
}

/// A cubic grid in raster order.
#[derive(Debug, Clone)]
struct Grid {
    side: usize,
    tiles: Arc<Tiles>,
}

impl Grid {
    fn new(side: usize) -> Self {
        Self { side, tiles: Arc::new(Tiles::raster([side; 3], Padding::Replicate)) }
    }
}

impl PaperNetwork {
    pub(super) fn new(sizes: PaperSizes, device: &Device, rng: &mut Rng) -> Self {
        let PaperSizes { side, proprio, channels: c, bottleneck, .. } = sizes;
        let mut inception = |fan_in, out| Inception::new(fan_in, out, bottleneck, device, rng);
        let input = inception(VOXEL_CHANNELS, c);
        let down = [inception(2 * c, c), inception(c, 2 * c), inception(2 * c, 4 * c)];
        let up = [
            UpBlock { first: inception(4 * c, c), second: inception(c, c) },
            UpBlock { first: inception(3 * c, c), second: inception(c, c) },
        ];
        Self {
            input,
            proprio: Dense::new(proprio, c, KAIMING, device, rng),
            down,
            up,
            merge: Conv3::new([2 * c, c, 3], KAIMING, device, rng),
            translation: Conv3::new([c, 1, 3], Spread::Xavier, device, rng),
            head: sizes.rotation_bins.map(|bins| PaperHead::new(sizes, bins, device, rng)),
            grids: [1, 2, 4].map(|division| Grid::new(side / division)),
        }
    }

    pub(super) fn forward(&self, input: NetworkInput) -> QValues {
        let [n, n_voxels, channels] = input.voxels.dims();
        let [full, half, quarter] = &self.grids;
        let voxels = self.input.forward(&input.voxels.reshape([n * n_voxels, channels]), full);
        let proprio = self.proprio.activated(input.proprio, LEAKY);
        let [_, c] = proprio.dims();
        let proprio =
            proprio.reshape([n, 1, c]).expand([n, n_voxels, c]).reshape([n * n_voxels, c]);

        let d0 = self.down[0].forward(&Tensor::cat(vec![voxels, proprio], 1), full);
        let d1 = self.down[1].forward(&max_pool(d0.clone(), full.side), half);
        let d2 = self.down[2].forward(&max_pool(d1.clone(), half.side), quarter);
        let u2 = self.up[0].forward(&d2, [quarter, half]);
        let u1 = self.up[1].forward(&Tensor::cat(vec![u2, d1.clone()], 1), [half, full]);
        let merged = Tensor::cat(vec![u1, d0.clone()], 1);
        let last = self.merge.forward(merged, &full.tiles, LEAKY);
        let translation = self.translation.forward(last.clone(), &full.tiles, Activation::Linear);
        let maps = [(d0, full), (d1, half), (d2, quarter), (last, full)];
        QValues {
            translation: translation.reshape([n, n_voxels]),
            pose: self.head.as_ref().map(|head| head.forward(maps)),
        }
    }

    /// Multiply-accumulates of one forward pass of one sample, about: one for each weight and bias
    /// wherever it is applied.
    pub(super) fn macs(&self) -> usize {
        let cells = |division: usize| {
            let side = self.grids[0].side / division;
            side * side * side
        };
        let full = self.input.num_params()
            + self.down[0].num_params()
            + self.up[1].second.num_params()
            + self.merge.num_params()
            + self.translation.num_params();
        let half = self.down[1].num_params()
            + self.up[0].second.num_params()
            + self.up[1].first.num_params();
        let quarter = self.down[2].num_params() + self.up[0].first.num_params();
        let head = self.head.as_ref().map_or(0, Module::num_params);
        cells(1) * full + cells(2) * half + cells(4) * quarter + self.proprio.num_params() + head
    }
}

/// Three parallel receptive fields: 1³, 3³ and 5³ (as two 3³), with half, a quarter and a quarter
/// of the output channels.
#[derive(Module, Debug)]
struct Inception {
    point: Conv3,
    near: [Conv3; 2],
    far: [Conv3; 3],
}

impl Inception {
    fn new(fan_in: usize, out: usize, bottleneck: usize, device: &Device, rng: &mut Rng) -> Self {
        let mut conv =
            |fan_in, out, kernel| Conv3::new([fan_in, out, kernel], KAIMING, device, rng);
        Self {
            point: conv(fan_in, out / 2, 1),
            near: [conv(fan_in, bottleneck, 1), conv(bottleneck, out / 4, 3)],
            far: [
                conv(fan_in, bottleneck, 1),
                conv(bottleneck, bottleneck, 3),
                conv(bottleneck, out / 4, 3),
            ],
        }
    }

    /// # Shapes
    ///
    /// - `x`: `[B * cells, fan_in]`
    /// - output: `[B * cells, out]`
    fn forward(&self, x: &Tensor<2>, grid: &Grid) -> Tensor<2> {
        let through = |convs: &[Conv3]| {
            convs.iter().fold(x.clone(), |x, conv| conv.forward(x, &grid.tiles, LEAKY))
        };
        let point = self.point.forward(x.clone(), &grid.tiles, LEAKY);
        Tensor::cat(vec![point, through(&self.near), through(&self.far)], 1)
    }
}

/// Inception, doubling of the grid, inception.
#[derive(Module, Debug)]
struct UpBlock {
    first: Inception,
    second: Inception,
}

impl UpBlock {
    fn forward(&self, x: &Tensor<2>, [small, large]: [&Grid; 2]) -> Tensor<2> {
        self.second.forward(&upsample(self.first.forward(x, small), small.side), large)
    }
}

/// Rotation and gripper values from the spatial softmax and maximum of four feature maps.
#[derive(Module, Debug)]
struct PaperHead {
    hidden: [Dense; 2],
    out: Dense,
    #[module(skip)]
    rotation_bins: usize,
}

impl PaperHead {
    fn new(sizes: PaperSizes, rotation_bins: usize, device: &Device, rng: &mut Rng) -> Self {
        // Three coordinates and a maximum for each channel of the maps with 1, 2, 4 and 1 times
        // `channels`.
        let n_features = 4 * 8 * sizes.channels;
        Self {
            hidden: [
                Dense::new(n_features, sizes.hidden, KAIMING, device, rng),
                Dense::new(sizes.hidden, sizes.hidden, KAIMING, device, rng),
            ],
            out: Dense::new(sizes.hidden, 3 * rotation_bins + 2, Spread::Xavier, device, rng),
            rotation_bins,
        }
    }

    fn forward(&self, maps: [(Tensor<2>, &Grid); 4]) -> PoseValues {
        let features = maps
            .into_iter()
            .flat_map(|(map, grid)| {
                let [n_rows, channels] = map.dims();
                let n_cells = grid.side * grid.side * grid.side;
                let map = map.reshape([n_rows / n_cells, n_cells, channels]);
                [spatial_softmax(map.clone(), grid.side), global_max(map)]
            })
            .collect();
        let hidden =
            self.hidden.iter().fold(Tensor::cat(features, 1), |x, dense| dense.activated(x, LEAKY));
        let values = self.out.forward(hidden);
        let [n, n_values] = values.dims();
        let rotation =
            values.clone().narrow(1, 0, n_values - 2).reshape([n, 3, self.rotation_bins]);
        PoseValues { rotation, gripper: values.narrow(1, n_values - 2, 2) }
    }
}

/// Maximum over 3³ windows with stride 2 and one cell of padding; the side must be even.
fn max_pool(x: Tensor<2>, side: usize) -> Tensor<2> {
    let [n_rows, channels] = x.dims();
    let n = n_rows / (side * side * side);
    // Along z, y and x: what stands before the axis, and what of one cell of it stands behind.
    let half = side / 2;
    let axes =
        [[n, side * side * channels], [n * half, side * channels], [n * half * half, channels]];
    let x = axes.into_iter().fold(x, |x, [before, behind]| {
        let pairs = x.reshape([before, half, 2, behind]);
        let odd = pairs.clone().narrow(2, 1, 1);
        // The window of an even cell starts at the odd one before it; the first has none.
        let first = pairs.clone().narrow(1, 0, 1).narrow(2, 0, 1);
        let earlier = Tensor::cat(vec![first, odd.narrow(1, 0, half - 1)], 1);
        let windows = Tensor::cat(vec![earlier, pairs], 2).max_dim(2);
        windows.reshape([before * half, behind])
    });
    x.reshape([n_rows / 8, channels])
}

/// Trilinear interpolation to twice the side; corners are not aligned.
fn upsample(x: Tensor<2>, side: usize) -> Tensor<2> {
    let [n_rows, channels] = x.dims();
    let n = n_rows / (side * side * side);
    let axes = [
        [n, side * side * channels],
        [n * 2 * side, side * channels],
        [n * 4 * side * side, channels],
    ];
    let x = axes.into_iter().fold(x, |x, [before, behind]| {
        let x = x.reshape([before, side, behind]);
        let [first, last] = [0, side - 1].map(|cell| x.clone().narrow(1, cell, 1));
        let earlier = Tensor::cat(vec![first, x.clone().narrow(1, 0, side - 1)], 1);
        let later = Tensor::cat(vec![x.clone().narrow(1, 1, side - 1), last], 1);
        let between =
            [earlier, later].map(|near| (x.clone() * 0.75 + near * 0.25).unsqueeze_dim::<4>(2));
        Tensor::cat(between.to_vec(), 2).reshape([before * 2 * side, behind])
    });
    x.reshape([8 * n_rows, channels])
}

/// Expected x, y, z in -1..1 of each channel's softmax: `[B, cells, C]` to `[B, 3 C]`.
fn spatial_softmax(x: Tensor<3>, side: usize) -> Tensor<2> {
    let [n, n_cells, c] = x.dims();
    let device = x.device();
    let attention = softmax(x / TEMPERATURE, 1);
    let along = |i: usize| 2.0 * (i % side) as f32 / (side - 1) as f32 - 1.0;
    let coordinates =
        (0..n_cells).flat_map(|i| [along(i), along(i / side), along(i / (side * side))]).collect();
    let coordinates = tensor::<3>(coordinates, [1, n_cells, 3], &device);
    attention.swap_dims(1, 2).matmul(coordinates).reshape([n, 3 * c])
}

/// `[B, cells, C]` to `[B, C]`.
fn global_max(x: Tensor<3>) -> Tensor<2> {
    let [n, _, c] = x.dims();
    x.max_dim(1).reshape([n, c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::assert_close;
    use crate::nn::{Backend, export, import, parameter_gradients, values};
    use crate::rng::{Stream, stream};

    use serde::Deserialize;

    fn network(sizes: PaperSizes) -> PaperNetwork {
        PaperNetwork::new(sizes, &Backend::Flex.device(), &mut stream(0, Stream::Init, 0))
    }

    #[test]
    fn released_sizes_have_the_released_number_of_parameters() {
        let sizes = PaperSizes {
            side: 16,
            proprio: 11,
            channels: 64,
            bottleneck: 32,
            hidden: 128,
            rotation_bins: None,
        };
        assert_eq!(network(sizes).num_params(), 879_553);
        let last = network(PaperSizes { rotation_bins: Some(72), ..sizes });
        assert_eq!(last.num_params(), 1_186_459);
        // 1.80 GMAC without the biases.
        assert!((1.79e9..1.82e9).contains(&(last.macs() as f64)), "{}", last.macs());
    }

    /// `n` values of a sine.
    fn wave(n: usize, step: f64, start: f64, scale: f64) -> Vec<f32> {
        (0..n).map(|i| (libm::sin(step * i as f64 + start) * scale) as f32).collect()
    }

    /// `n` numbers without a pattern: those of a wave cancel in the wide network's gradients.
    fn noise(n: usize, step: f64, start: f64, scale: f64) -> Vec<f32> {
        let number = |i: usize| {
            let value = libm::sin(step * 12.9898 * i as f64 + 78.233 * (start + 1.0)) * 43758.5453;
            2.0 * (value - libm::floor(value)) - 1.0
        };
        (0..n).map(|i| (number(i) * scale) as f32).collect()
    }

    #[derive(Deserialize)]
    struct Golden {
        #[serde(flatten)]
        outputs: Outputs,
        slopes: Vec<f32>,
        paper: GoldenPaper,
    }

    #[derive(Deserialize)]
    struct Outputs {
        /// Some, evenly apart.
        translation: Vec<f32>,
        pose: Vec<f32>,
        loss: f32,
    }

    /// Of the sizes that the preset `paper` names.
    #[derive(Deserialize)]
    struct GoldenPaper {
        #[serde(flatten)]
        outputs: Outputs,
        gradients: Vec<GoldenGradient>,
    }

    #[derive(Deserialize)]
    struct GoldenGradient {
        largest: f32,
        /// Some, evenly apart.
        kept: Vec<f32>,
    }

    fn golden() -> Golden {
        serde_json::from_str(include_str!("../../../../tests/golden/q_network.json"))
            .expect("a golden file")
    }

    /// `n` numbers from a step, a start and a scale.
    type Numbers = fn(usize, f64, f64, f64) -> Vec<f32>;

    /// Outputs, of which every `step`th voxel, and all gradients of a batch of two.
    fn run(sizes: PaperSizes, step: usize, numbers: Numbers) -> (Outputs, Vec<Vec<f32>>) {
        let network = network(sizes);
        let mut weights = export(&network);
        let mut fan_in = 1;
        for (k, tensor) in weights.iter_mut().enumerate() {
            // A bias follows the weight that it belongs to.
            fan_in = match tensor.shape[..] {
                [fan_in, _] => fan_in,
                [_, c_in, kernel, _, _] => c_in * kernel * kernel * kernel,
                _ => fan_in,
            };
            tensor.values =
                numbers(tensor.values.len(), 0.7, 1.3 * k as f64, 1.0 / (fan_in as f64).sqrt());
        }
        let leaves = import(network, &weights).expect("its own tensors").train();
        let device = Backend::Flex.device().autodiff();
        let n_voxels = sizes.side * sizes.side * sizes.side;
        let voxels = numbers(2 * 10 * n_voxels, 0.11, 0.5, 1.0);
        let output = leaves.forward(NetworkInput {
            voxels: tensor(voxels, [2, 10, n_voxels], &device).swap_dims(1, 2),
            proprio: tensor(numbers(22, 0.3, 0.0, 1.0), [2, 11], &device),
            attended: None,
        });
        let pose = output.pose.expect("a pose head");
        let [_, axes, bins] = pose.rotation.dims();
        let pose = Tensor::cat(vec![pose.rotation.reshape([2, axes * bins]), pose.gripper], 1);
        let loss = output.translation.clone().square().mean() + pose.clone().square().mean();
        let outputs = Outputs {
            translation: values(output.translation).into_iter().step_by(step).collect(),
            pose: values(pose),
            loss: values(loss.clone())[0],
        };
        (outputs, parameter_gradients(&leaves, loss.backward()))
    }

    #[test]
    fn values_and_gradients_are_those_of_pytorch() {
        let sizes = PaperSizes {
            side: 8,
            proprio: 11,
            channels: 4,
            bottleneck: 3,
            hidden: 5,
            rotation_bins: Some(4),
        };
        let (Golden { outputs: expected, slopes, .. }, (found, gradients)) =
            (golden(), run(sizes, 7, wave));
        assert_close("translation", &found.translation, &expected.translation, 1e-5);
        assert_close("pose", &found.pose, &expected.pose, 1e-4);
        assert_close("loss", &[found.loss], &[expected.loss], 1e-5);
        // The gradient of each parameter along a wave.
        let along = |gradient: &Vec<f32>| {
            let wave = wave(gradient.len(), 0.9, 0.2, 1.0);
            gradient.iter().zip(wave).map(|(gradient, wave)| gradient * wave).sum()
        };
        let found = gradients.iter().map(along).collect::<Vec<f32>>();
        assert_close("slopes", &found, &slopes, 1e-3);
    }

    /// The largest difference from what is expected, as a part of `scale`.
    fn error(found: impl Iterator<Item = f32>, expected: &[f32], scale: f32) -> f32 {
        let found = found.collect::<Vec<_>>();
        assert_eq!(found.len(), expected.len());
        let differences =
            found.iter().zip(expected).map(|(found, expected)| (found - expected).abs());
        differences.fold(0.0, f32::max) / scale
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "the figures, with --no-capture")]
    fn at_the_released_sizes_they_differ_by_a_ten_thousandth_of_the_largest() {
        let sizes = PaperSizes {
            proprio: 11,
            side: 16,
            channels: 64,
            bottleneck: 32,
            hidden: 128,
            rotation_bins: Some(72),
        };
        let (GoldenPaper { outputs: expected, gradients: kept }, (found, gradients)) =
            (golden().paper, run(sizes, 61, noise));
        let largest = |values: &[f32]| values.iter().fold(0.0_f32, |most, v| most.max(v.abs()));
        let outputs = [
            ("translation", found.translation, expected.translation),
            ("pose", found.pose, expected.pose),
            ("loss", vec![found.loss], vec![expected.loss]),
        ];
        for (what, found, expected) in outputs {
            let error = error(found.into_iter(), &expected, largest(&expected));
            println!("{what}: {error:e}");
            assert!(error <= 1e-4, "{what}: {error:e}");
        }
        assert_eq!(gradients.len(), kept.len());
        let mut worst = 0.0_f32;
        for (k, (found, expected)) in gradients.iter().zip(&kept).enumerate() {
            let some = found.iter().copied().step_by((found.len() / 32).max(1));
            let off = error(some, &expected.kept, expected.largest);
            let off = off.max((largest(found) / expected.largest - 1.0).abs());
            assert!(off <= 1e-4, "tensor {k}: {off:e}");
            worst = worst.max(off);
        }
        println!("gradients of {} tensors: {worst:e}", kept.len());
    }
}
