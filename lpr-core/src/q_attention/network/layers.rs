//! 3-D convolution of kernels of 1³ and 3³.

use crate::nn::{Activation, Spread, Tiles, convolve, dense, tensor};
use crate::rng::Rng;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use std::sync::Arc;

/// A 3-D convolution with stride 1, which keeps the grid's size.
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
        assert!(kernel == 1 || kernel == 3, "a kernel of {kernel} cubed");
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
    /// - `x`: `[B * cells, C_in]`, cells in the order of `tiles`
    /// - output: `[B * cells, C_out]`
    pub(super) fn forward(
        &self,
        x: Tensor<2>,
        tiles: &Arc<Tiles>,
        activation: Activation,
    ) -> Tensor<2> {
        let weight = self.weight.val();
        let [c_out, c_in, kernel, _, _] = weight.dims();
        // Taps first and channels out last, as the operations take them.
        let rows =
            weight.permute([2, 3, 4, 1, 0]).reshape([kernel * kernel * kernel * c_in, c_out]);
        if kernel == 1 {
            dense(x, rows, self.bias.val(), activation)
        } else {
            convolve(x, rows, self.bias.val(), tiles, activation)
        }
    }
}
