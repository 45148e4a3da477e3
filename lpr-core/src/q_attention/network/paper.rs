//! The 3-D U-Net of C2F-ARM: inception blocks, leaky rectifiers, replicate padding, no
//! normalisation.
//!
//! Layer by layer as in the released network; the sizes it was released with are 64 channels, a
//! bottleneck of 32 and 128 hidden units: 879,553 parameters at depth 0 and 1,186,459 at the last
//! depth (both tested).

use super::layers::Conv3;
use super::{NetworkInput, PoseValues, QValues};
use crate::nn::{Dense, Spread, tensor};
use crate::perception::{LOW_DIM, VOXEL_CHANNELS};
use crate::rng::Rng;

use burn::module::Module;
use burn::tensor::activation::{leaky_relu, softmax};
use burn::tensor::{Device, Tensor};

/// Slope of the leaky rectifier below zero (released).
const SLOPE: f64 = 0.02;
/// Temperature of the spatial softmax (released).
const TEMPERATURE: f32 = 0.01;
const KAIMING: Spread = Spread::Kaiming { slope: SLOPE as f32 };

/// Sizes of a [`PaperNetwork`].
#[derive(Debug, Clone, Copy)]
pub(super) struct PaperSizes {
    pub(super) side: usize,
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
    #[module(skip)]
    side: usize,
}

impl PaperNetwork {
    pub(super) fn new(sizes: PaperSizes, device: &Device, rng: &mut Rng) -> Self {
        let PaperSizes { side, channels: c, bottleneck, .. } = sizes;
        let mut inception = |fan_in, out| Inception::new(fan_in, out, bottleneck, device, rng);
        let input = inception(VOXEL_CHANNELS, c);
        let down = [inception(2 * c, c), inception(c, 2 * c), inception(2 * c, 4 * c)];
        let up = [
            UpBlock { first: inception(4 * c, c), second: inception(c, c) },
            UpBlock { first: inception(3 * c, c), second: inception(c, c) },
        ];
        Self {
            input,
            proprio: Dense::new(LOW_DIM, c, KAIMING, device, rng),
            down,
            up,
            merge: Conv3::new([2 * c, c, 3], KAIMING, device, rng),
            translation: Conv3::new([c, 1, 3], Spread::Xavier, device, rng),
            head: sizes.rotation_bins.map(|bins| PaperHead::new(sizes, bins, device, rng)),
            side,
        }
    }

    pub(super) fn forward(&self, input: NetworkInput) -> QValues {
        let [n, channels, n_voxels] = input.voxels.dims();
        let side = self.side;
        let voxels = input.voxels.reshape([n, channels, side, side, side]);
        let voxels = self.input.forward(&voxels);
        let proprio = leaky_relu(self.proprio.forward(input.proprio), SLOPE);
        let [_, c] = proprio.dims();
        let proprio = proprio.reshape([n, c, 1, 1, 1]).expand([n, c, side, side, side]);

        let d0 = self.down[0].forward(&Tensor::cat(vec![voxels, proprio], 1));
        let d1 = self.down[1].forward(&max_pool(d0.clone()));
        let d2 = self.down[2].forward(&max_pool(d1.clone()));
        let u2 = self.up[0].forward(&d2);
        let u1 = self.up[1].forward(&Tensor::cat(vec![u2, d1.clone()], 1));
        let last = activated(&self.merge, Tensor::cat(vec![u1, d0.clone()], 1));
        let translation = self.translation.forward(last.clone()).reshape([n, n_voxels]);
        QValues {
            translation,
            pose: self.head.as_ref().map(|head| head.forward([d0, d1, d2, last])),
        }
    }

    /// Multiply-accumulates of one forward pass of one sample, about: one for each weight and bias
    /// wherever it is applied.
    pub(super) fn macs(&self) -> usize {
        let cells = |division: usize| {
            (self.side / division) * (self.side / division) * (self.side / division)
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

    fn forward(&self, x: &Tensor<5>) -> Tensor<5> {
        let through = |convs: &[Conv3]| convs.iter().fold(x.clone(), |x, conv| activated(conv, x));
        let [point, near, far] =
            [activated(&self.point, x.clone()), through(&self.near), through(&self.far)];
        Tensor::cat(vec![point, near, far], 1)
    }
}

/// Inception, doubling of the grid, inception.
#[derive(Module, Debug)]
struct UpBlock {
    first: Inception,
    second: Inception,
}

impl UpBlock {
    fn forward(&self, x: &Tensor<5>) -> Tensor<5> {
        self.second.forward(&upsample(self.first.forward(x)))
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

    fn forward(&self, maps: [Tensor<5>; 4]) -> PoseValues {
        let features = maps
            .into_iter()
            .flat_map(|map| [spatial_softmax(map.clone()), global_max(map)])
            .collect();
        let hidden = self
            .hidden
            .iter()
            .fold(Tensor::cat(features, 1), |x, dense| leaky_relu(dense.forward(x), SLOPE));
        let values = self.out.forward(hidden);
        let [n, n_values] = values.dims();
        let rotation =
            values.clone().narrow(1, 0, n_values - 2).reshape([n, 3, self.rotation_bins]);
        PoseValues { rotation, gripper: values.narrow(1, n_values - 2, 2) }
    }
}

fn activated(conv: &Conv3, x: Tensor<5>) -> Tensor<5> {
    leaky_relu(conv.forward(x), SLOPE)
}

/// Maximum over 3³ windows with stride 2 and one cell of padding; sides must be even.
fn max_pool(x: Tensor<5>) -> Tensor<5> {
    (2..5).fold(x, |x, axis| {
        let x = x.swap_dims(axis, 4);
        let [n, c, d, h, w] = x.dims();
        let pairs = x.reshape([n * c * d * h, w / 2, 2]);
        let odd = pairs.clone().narrow(2, 1, 1);
        // The window of an even cell starts at the odd one before it; the first has none.
        let before = Tensor::cat(
            vec![pairs.clone().narrow(1, 0, 1).narrow(2, 0, 1), odd.narrow(1, 0, w / 2 - 1)],
            1,
        );
        let windows = Tensor::cat(vec![before, pairs], 2).max_dim(2);
        windows.reshape([n, c, d, h, w / 2]).swap_dims(axis, 4)
    })
}

/// Trilinear interpolation to twice the side; corners are not aligned.
fn upsample(x: Tensor<5>) -> Tensor<5> {
    (2..5).fold(x, |x, axis| {
        let x = x.swap_dims(axis, 4);
        let [n, c, d, h, w] = x.dims();
        let doubled = x.clone().reshape([n * c * d * h, w]).matmul(doubling(w, &x.device()));
        doubled.reshape([n, c, d, h, 2 * w]).swap_dims(axis, 4)
    })
}

/// Weights of linear interpolation from `w` cells to `2 w`: `[w, 2 w]`.
fn doubling(w: usize, device: &Device) -> Tensor<2> {
    let mut weights = vec![0.0_f32; 2 * w * w];
    for out in 0..2 * w {
        let near = out / 2;
        let other = if out % 2 == 0 { near.saturating_sub(1) } else { (near + 1).min(w - 1) };
        weights[near * 2 * w + out] += 0.75;
        weights[other * 2 * w + out] += 0.25;
    }
    tensor(weights, [w, 2 * w], device)
}

/// Expected x, y, z in -1..1 of each channel's softmax: `[B, C, D, H, W]` to `[B, 3 C]`.
fn spatial_softmax(x: Tensor<5>) -> Tensor<2> {
    let [n, c, d, h, w] = x.dims();
    let device = x.device();
    let attention = softmax(x.reshape([n * c, d * h * w]) / TEMPERATURE, 1);
    let along = |i: usize, side: usize| 2.0 * i as f32 / (side - 1) as f32 - 1.0;
    let coordinates = (0..d * h * w)
        .flat_map(|i| [along(i % w, w), along(i / w % h, h), along(i / (w * h), d)])
        .collect();
    let coordinates = tensor(coordinates, [d * h * w, 3], &device);
    attention.matmul(coordinates).reshape([n, 3 * c])
}

/// `[B, C, D, H, W]` to `[B, C]`.
fn global_max(x: Tensor<5>) -> Tensor<2> {
    let [n, c, d, h, w] = x.dims();
    x.reshape([n, c, d * h * w]).max_dim(2).reshape([n, c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::assert_close;
    use crate::nn::{Backend, export, import, values};
    use crate::rng::{Stream, stream};

    use serde::Deserialize;

    fn network(sizes: PaperSizes) -> PaperNetwork {
        PaperNetwork::new(sizes, &Backend::Flex.device(), &mut stream(0, Stream::Init, 0))
    }

    #[test]
    fn released_sizes_have_the_released_number_of_parameters() {
        let sizes =
            PaperSizes { side: 16, channels: 64, bottleneck: 32, hidden: 128, rotation_bins: None };
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

    #[derive(Deserialize)]
    struct Golden {
        translation: Vec<f32>,
        pose: Vec<f32>,
        loss: f32,
        slopes: Vec<f32>,
    }

    #[test]
    fn values_and_gradients_are_those_of_pytorch() {
        let golden: Golden =
            serde_json::from_str(include_str!("../../../../tests/golden/q_network.json"))
                .expect("a golden file");
        let network = network(PaperSizes {
            side: 8,
            channels: 4,
            bottleneck: 3,
            hidden: 5,
            rotation_bins: Some(4),
        });
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
                wave(tensor.values.len(), 0.7, 1.3 * k as f64, 1.0 / (fan_in as f64).sqrt());
        }
        let leaves = import(network, &weights).expect("its own tensors").train();
        let device = Backend::Flex.device().autodiff();
        let input = NetworkInput {
            voxels: tensor(wave(2 * 10 * 512, 0.11, 0.5, 1.0), [2, 10, 512], &device),
            proprio: tensor(wave(22, 0.3, 0.0, 1.0), [2, 11], &device),
        };
        let output = leaves.forward(input);
        let pose = output.pose.expect("a pose head");
        let pose = Tensor::cat(vec![pose.rotation.reshape([2, 12]), pose.gripper], 1);
        let loss = output.translation.clone().square().mean() + pose.clone().square().mean();
        let some = values(output.translation).into_iter().step_by(7).collect::<Vec<_>>();
        assert_close("translation", &some, &golden.translation, 1e-5);
        assert_close("pose", &values(pose), &golden.pose, 1e-4);
        assert_close("loss", &values(loss.clone()), &[golden.loss], 1e-5);
        let slopes = slopes(&leaves, &loss);
        assert_close("slopes", &slopes, &golden.slopes, 1e-3);
    }

    /// The gradient of each parameter along a wave.
    fn slopes(leaves: &PaperNetwork, loss: &Tensor<1>) -> Vec<f32> {
        struct Slopes(burn::tensor::Gradients, Vec<f32>);
        impl burn::module::ModuleVisitor for Slopes {
            fn visit_float<const D: usize>(&mut self, param: &burn::module::Param<Tensor<D>>) {
                let gradient =
                    values(param.val().grad(&self.0).expect("the loss depends on every parameter"));
                let wave = wave(gradient.len(), 0.9, 0.2, 1.0);
                self.1
                    .push(gradient.iter().zip(wave).map(|(gradient, wave)| gradient * wave).sum());
            }
        }
        let mut slopes = Slopes(loss.backward(), Vec::new());
        leaves.visit(&mut slopes);
        slopes.1
    }
}
