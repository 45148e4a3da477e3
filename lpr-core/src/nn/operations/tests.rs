//! Our operations beside the same of burn's own, values and gradients.

use super::{Activation, Padding, Tiles, Windows, convolve, convolve_strided};
use super::{convolve_joined, dense, pooled_dense, stock};
use crate::nn::golden::assert_close;
use crate::nn::{Backend, tensor, values};
use crate::rng::{Stream, stream};

use burn::tensor::{Device, Tensor};
use rand::RngExt as _;
use std::sync::Arc;

const ACTIVATIONS: [Activation; 3] =
    [Activation::Linear, Activation::Relu, Activation::Leaky { slope: 0.1 }];

/// Input, weights and bias of a layer, all leaves.
struct Leaves {
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
}

impl Leaves {
    fn new([rows, inputs, fan_in, outputs]: [usize; 4], device: &Device) -> Self {
        let mut rng = stream(0, Stream::Noise, 1);
        let mut random =
            |n: usize| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f32>>();
        Self {
            x: tensor(random(rows * inputs), [rows, inputs], device).require_grad(),
            weights: tensor(random(fan_in * outputs), [fan_in, outputs], device).require_grad(),
            bias: tensor(random(outputs), [outputs], device).require_grad(),
        }
    }

    /// The output of a layer and the gradients of a loss that weighs all of it differently.
    fn run(&self, layer: impl Fn(Tensor<2>, Tensor<2>, Tensor<1>) -> Tensor<2>) -> [Vec<f32>; 4] {
        let y = layer(self.x.clone(), self.weights.clone(), self.bias.clone());
        let [rows, outputs] = y.dims();
        let waves = (0..rows * outputs).map(|i| libm::sinf(0.7 * i as f32)).collect();
        let waves = tensor(waves, [rows, outputs], &y.device());
        let gradients = (y.clone() * waves).sum().backward();
        [
            values(y.inner()),
            values(self.x.grad(&gradients).expect("a gradient of the input")),
            values(self.weights.grad(&gradients).expect("a gradient of the weights")),
            values(self.bias.grad(&gradients).expect("a gradient of the bias")),
        ]
    }

    fn compare(
        &self,
        ours: impl Fn(Tensor<2>, Tensor<2>, Tensor<1>) -> Tensor<2>,
        stock: impl Fn(Tensor<2>, Tensor<2>, Tensor<1>) -> Tensor<2>,
    ) {
        let parts = ["output", "input", "weights", "bias"];
        for ((ours, stock), part) in self.run(ours).iter().zip(self.run(stock)).zip(parts) {
            let scale = stock.iter().fold(1.0_f32, |most, value| most.max(value.abs()));
            assert_close(part, ours, &stock, 1e-5 * scale);
        }
    }
}

fn device() -> Device {
    Backend::Flex.device().autodiff()
}

#[test]
fn a_dense_layer_is_burns() {
    for activation in ACTIVATIONS {
        Leaves::new([21, 13, 13, 9], &device()).compare(
            |x, w, b| dense(x, w, b, activation),
            |x, w, b| stock::dense(x, w, b, activation),
        );
    }
}

#[test]
fn a_convolution_is_burns() {
    for padding in [Padding::Zero, Padding::Replicate] {
        let tiles = Arc::new(Tiles::raster([3, 4, 6], padding));
        for activation in ACTIVATIONS {
            Leaves::new([2 * 72, 5, 27 * 5, 7], &device()).compare(
                |x, w, b| convolve(x, w, b, &tiles, activation),
                |x, w, b| stock::convolve(x, w, b, &tiles.neighbours(), 72, activation),
            );
        }
    }
}

#[test]
fn a_convolution_with_stride_2_is_burns() {
    // Four blocks of 2³ cells, each contiguous.
    let rows = (0..32).map(|i| i / 16 * 4 + i / 8 % 2 * 2 + i / 4 % 2 * 16 + i / 2 % 2 * 8 + i % 2);
    let tiles = Tiles::in_order([2, 4, 4], Padding::Zero, &rows.collect::<Vec<_>>());
    let windows = Arc::new(Windows::of_blocks(&tiles));
    for activation in ACTIVATIONS {
        Leaves::new([2 * 32, 5, 27 * 5, 7], &device()).compare(
            |x, w, b| convolve_strided(x, w, b, &windows, activation),
            |x, w, b| stock::convolve(x, w, b, &windows.neighbours(), 32, activation),
        );
    }
}

#[test]
fn a_convolution_beside_the_grid_below_is_burns() {
    let tiles = Arc::new(Tiles::in_order(
        [2, 2, 4],
        Padding::Zero,
        &[0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15],
    ));
    let device = device();
    let below = (0..20).map(|i| libm::cosf(i as f32)).collect();
    let below = tensor(below, [4, 5], &device).require_grad();
    let leaves = Leaves::new([2 * 16, 16, 27 * 21, 7], &device);
    leaves.compare(
        |x, w, b| convolve_joined([x, below.clone()], w, b, &tiles, Activation::Relu),
        |x, w, b| {
            let x = stock::joined(x, below.clone());
            stock::convolve(x, w, b, &tiles.neighbours(), 16, Activation::Relu)
        },
    );
    let of_below = |y: Tensor<2>| {
        values(below.grad(&y.square().sum().backward()).expect("a gradient of the grid below"))
    };
    let (w, b) = (&leaves.weights, &leaves.bias);
    let constant = tensor(values(leaves.x.clone().inner()), [32, 16], &device);
    let x = [constant.clone(), below.clone()];
    let ours = convolve_joined(x, w.clone(), b.clone(), &tiles, Activation::Linear);
    let x = stock::joined(constant, below.clone());
    let near = tiles.neighbours();
    let stock = stock::convolve(x, w.clone(), b.clone(), &near, 16, Activation::Linear);
    let expected = of_below(stock);
    let scale = expected.iter().fold(1.0_f32, |most, value| most.max(value.abs()));
    assert_close("below", &of_below(ours), &expected, 1e-5 * scale);
}

#[test]
fn a_pooled_layer_is_burns() {
    for activation in ACTIVATIONS {
        Leaves::new([4 * 15, 6, 6, 20], &device()).compare(
            |x, w, b| pooled_dense(x, 15, w, b, activation),
            |x, w, b| stock::pooled_dense(x, 15, w, b, activation),
        );
    }
}

#[test]
fn a_constant_input_gets_no_gradient_and_without_autodiff_the_values_are_the_same() {
    let leaves = Leaves::new([8, 3, 3, 2], &device());
    let constant = tensor(values(leaves.x.clone().inner()), [8, 3], &device());
    let y = dense(constant.clone(), leaves.weights.clone(), leaves.bias.clone(), Activation::Relu);
    let gradients = y.clone().sum().backward();
    assert!(constant.grad(&gradients).is_none());
    assert!(leaves.weights.grad(&gradients).is_some());
    let plain = dense(
        constant.inner(),
        leaves.weights.clone().inner(),
        leaves.bias.clone().inner(),
        Activation::Relu,
    );
    assert_eq!(values(y.inner()), values(plain));
}

#[cfg(feature = "ndarray")]
#[test]
fn another_device_composes_the_same_of_its_own() {
    let tiles = Arc::new(Tiles::raster([4, 3, 2], Padding::Replicate));
    let run = |backend: Backend| {
        Leaves::new([24, 4, 27 * 4, 3], &backend.device().autodiff())
            .run(|x, w, b| convolve(x, w, b, &tiles, Activation::Relu))
    };
    for (ours, other) in run(Backend::Flex).iter().zip(run(Backend::Ndarray)) {
        assert_close("convolution", ours, &other, 1e-4);
    }
}
