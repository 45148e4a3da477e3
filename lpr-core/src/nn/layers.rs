//! Fully connected layers and their initial weights, drawn from a generator that is passed in.

use super::operations::{Activation, Tiles, Windows};
use super::operations::{convolve, convolve_joined, convolve_strided, dense, pooled_dense};
use super::values::tensor;
use crate::rng::Rng;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use rand::RngExt as _;
use std::sync::Arc;

/// Width of the uniform distribution of initial weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Spread {
    /// For a layer before a leaky rectifier of this slope: `±√(6 / ((1 + slope²) fan_in))` (He et
    /// al. 2015).
    Kaiming {
        /// Slope below zero; 0 for ReLU.
        slope: f32,
    },
    /// For a linear output: `±√(6 / (fan_in + fan_out))` (Glorot and Bengio 2010).
    Xavier,
    /// All zero: the output starts as its bias.
    Zero,
}

impl Spread {
    /// Largest absolute weight.
    fn bound(self, fan_in: usize, fan_out: usize) -> f32 {
        match self {
            Self::Kaiming { slope } => libm::sqrtf(6.0 / ((1.0 + slope * slope) * fan_in as f32)),
            Self::Xavier => libm::sqrtf(6.0 / (fan_in + fan_out) as f32),
            Self::Zero => 0.0,
        }
    }

    /// A parameter of `shape` for a layer that sums `fan_in` inputs and feeds each into `fan_out`
    /// outputs.
    pub(crate) fn draw<const D: usize>(
        self,
        shape: [usize; D],
        fan_in: usize,
        fan_out: usize,
        device: &Device,
        rng: &mut Rng,
    ) -> Param<Tensor<D>> {
        let bound = self.bound(fan_in, fan_out);
        let n = shape.iter().product();
        let weights = (0..n).map(|_| (rng.random::<f32>() * 2.0 - 1.0) * bound).collect();
        Param::from_tensor(tensor(weights, shape, device))
    }
}

/// `x W + b` on the rows of a matrix. The weight is stored `[fan_in, fan_out]`: `PyTorch`'s
/// transposed.
#[derive(Module, Debug)]
pub(crate) struct Dense {
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
}

impl Dense {
    /// Weights of `fan_in` x `fan_out` spread as given, and zero biases.
    pub(crate) fn new(
        fan_in: usize,
        fan_out: usize,
        spread: Spread,
        device: &Device,
        rng: &mut Rng,
    ) -> Self {
        Self {
            weight: spread.draw([fan_in, fan_out], fan_in, fan_out, device, rng),
            bias: Param::from_tensor(tensor(vec![0.0; fan_out], [fan_out], device)),
        }
    }

    /// # Shapes
    ///
    /// - `x`: `[N, fan_in]`
    /// - output: `[N, fan_out]`
    pub(crate) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.activated(x, Activation::Linear)
    }

    /// The same, activated.
    pub(crate) fn activated(&self, x: Tensor<2>, activation: Activation) -> Tensor<2> {
        dense(x, self.weight.val(), self.bias.val(), activation)
    }

    /// On the 3³ neighbourhood of each cell: see [`convolve`].
    ///
    /// # Shapes
    ///
    /// - `x`: `[B * cells, fan_in / 27]`
    /// - output: `[B * cells, fan_out]`
    pub(crate) fn convolved(
        &self,
        x: Tensor<2>,
        tiles: &Arc<Tiles>,
        activation: Activation,
    ) -> Tensor<2> {
        convolve(x, self.weight.val(), self.bias.val(), tiles, activation)
    }

    /// The same of the cells of `x`, each beside the nearest cell of the grid `below`: see
    /// [`convolve_joined`].
    ///
    /// # Shapes
    ///
    /// - `x`: `[B * cells, own]`, `below`: `[B * cells / 8, fan_in / 27 - own]`
    /// - output: `[B * cells, fan_out]`
    pub(crate) fn joined(
        &self,
        [x, below]: [Tensor<2>; 2],
        tiles: &Arc<Tiles>,
        activation: Activation,
    ) -> Tensor<2> {
        convolve_joined([x, below], self.weight.val(), self.bias.val(), tiles, activation)
    }

    /// [`Self::convolved`] with stride 2: see [`convolve_strided`].
    ///
    /// # Shapes
    ///
    /// - `x`: `[B * cells, fan_in / 27]`
    /// - output: `[B * cells / 8, fan_out]`
    pub(crate) fn strided(
        &self,
        x: Tensor<2>,
        windows: &Arc<Windows>,
        activation: Activation,
    ) -> Tensor<2> {
        convolve_strided(x, self.weight.val(), self.bias.val(), windows, activation)
    }

    /// The maximum over each set of `members` rows, activated: see [`pooled_dense`].
    ///
    /// # Shapes
    ///
    /// - `x`: `[sets * members, fan_in]`
    /// - output: `[sets, fan_out]`
    pub(crate) fn pooled(&self, x: Tensor<2>, members: usize, activation: Activation) -> Tensor<2> {
        pooled_dense(x, members, self.weight.val(), self.bias.val(), activation)
    }
}

/// Fully connected layers with ReLU between them; the last one is linear.
#[derive(Module, Debug)]
pub(crate) struct Mlp {
    layers: Vec<Dense>,
}

impl Mlp {
    /// Layers from `widths[0]` inputs over `widths[1]`, … to the last width; the last layer's
    /// weights are spread as `output`.
    pub(crate) fn new(widths: &[usize], output: Spread, device: &Device, rng: &mut Rng) -> Self {
        let n_layers = widths.len() - 1;
        let spread =
            |idx| if idx + 1 == n_layers { output } else { Spread::Kaiming { slope: 0.0 } };
        let layers = widths
            .windows(2)
            .enumerate()
            .map(|(idx, pair)| Dense::new(pair[0], pair[1], spread(idx), device, rng))
            .collect();
        Self { layers }
    }

    /// # Shapes
    ///
    /// - `x`: `[N, widths[0]]`
    /// - output: `[N, last width]`
    pub(crate) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let (last, x) = self.before_last(x);
        last.forward(x)
    }

    /// The last layer with ReLU and its maximum over each set of `members` rows.
    ///
    /// # Shapes
    ///
    /// - `x`: `[sets * members, widths[0]]`
    /// - output: `[sets, last width]`
    pub(crate) fn pooled(&self, x: Tensor<2>, members: usize) -> Tensor<2> {
        let (last, x) = self.before_last(x);
        last.pooled(x, members, Activation::Relu)
    }

    fn before_last(&self, x: Tensor<2>) -> (&Dense, Tensor<2>) {
        let (last, hidden) =
            self.layers.split_last().expect("an Mlp is made with at least one layer");
        (last, hidden.iter().fold(x, |x, layer| layer.activated(x, Activation::Relu)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, export};
    use crate::rng::{Stream, stream};

    #[test]
    fn weights_fill_their_bound_and_depend_on_the_seed_alone() {
        let draw = |seed| {
            let mut rng = stream(seed, Stream::Init, 0);
            let mlp = Mlp::new(&[7, 64, 3], Spread::Xavier, &Backend::Flex.device(), &mut rng);
            export(&mlp)
        };
        let tensors = draw(1);
        assert_eq!(tensors, draw(1));
        assert_ne!(tensors, draw(2));
        for (name, bound) in [
            ("layers.0.weight", (6.0_f32 / 7.0).sqrt()),
            ("layers.1.weight", (6.0_f32 / 67.0).sqrt()),
        ] {
            let weights = &tensors
                .iter()
                .find(|tensor| tensor.name == name)
                .expect("both layers have weights")
                .values;
            let most = weights.iter().fold(0.0_f32, |most, weight| most.max(weight.abs()));
            assert!(most <= bound && most > 0.9 * bound, "{name}: {most} of {bound}");
            let mean = weights.iter().sum::<f32>() / weights.len() as f32;
            assert!(mean.abs() < 0.2 * bound, "{name}: mean {mean}");
        }
    }
}
