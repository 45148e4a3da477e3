//! 3-D convolution with replicate padding.

use crate::nn::{Spread, tensor};
use crate::rng::Rng;

use burn::module::{Module, Param};
use burn::tensor::module::conv3d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor};

/// A 3-D convolution with stride 1 and replicate padding, which keeps the grid's size.
#[derive(Module, Debug)]
pub(super) struct Conv3 {
    weight: Param<Tensor<5>>,
    bias: Param<Tensor<1>>,
}

impl Conv3 {
    /// Weights of `[channels in, channels out, kernel side]` spread as given, and zero biases.
    pub(super) fn new(
        [c_in, c_out, kernel]: [usize; 3],
        spread: Spread,
        device: &Device,
        rng: &mut Rng,
    ) -> Self {
        let volume = kernel * kernel * kernel;
        Self {
            weight: spread.draw(
                [c_out, c_in, kernel, kernel, kernel],
                c_in * volume,
                c_out * volume,
                device,
                rng,
            ),
            bias: Param::from_tensor(tensor(vec![0.0; c_out], [c_out], device)),
        }
    }

    /// # Shapes
    ///
    /// - `x`: `[B, C_in, D, H, W]`
    /// - output: `[B, C_out, D, H, W]`
    pub(super) fn forward(&self, x: Tensor<5>) -> Tensor<5> {
        let weight = self.weight.val();
        let [_, _, kernel, _, _] = weight.dims();
        let padded = (2..5).fold(x, |x, axis| replicate(x, axis, kernel / 2));
        conv3d(
            padded,
            weight,
            Some(self.bias.val()),
            ConvOptions::new([1, 1, 1], [0, 0, 0], [1, 1, 1], 1),
        )
    }
}

/// Repeats the first and last cell along `axis` `n` times.
fn replicate(x: Tensor<5>, axis: usize, n: usize) -> Tensor<5> {
    if n == 0 {
        return x;
    }
    let last = x.dims()[axis] - 1;
    let [before, after] = [0, last].map(|cell| x.clone().narrow(axis, cell, 1).repeat_dim(axis, n));
    Tensor::cat(vec![before, x, after], axis)
}
