//! Differentiable operations of burn made of our kernels.
//!
//! An operation is a function of slices with a hand-written gradient. On burn-flex it runs as it is;
//! on another device [`stock`] composes the same of burn's own operations, which also checks it.

mod stock;
#[cfg(test)]
mod tests;

pub(crate) use super::kernels::Activation;
use super::kernels::dense::LayerGradients;
pub(crate) use super::kernels::strided::Windows;
pub(crate) use super::kernels::tiles::{Padding, Tiles};
use super::kernels::{dense, pooled, strided, winograd};

use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use burn::tensor::{Tensor, TensorData};
use burn_autodiff::checkpoint::base::Checkpointer;
use burn_autodiff::checkpoint::strategy::NoCheckpointing;
use burn_autodiff::grads::Gradients;
use burn_autodiff::ops::{Backward, Ops, OpsKind};
use core::fmt::Debug;
use fearless_simd::Level;
use std::sync::Arc;

/// The operands of these names, unless they are on another device.
macro_rules! operands {
    ($($tensor:ident),*) => {{
        let plain =
            || Some([$($tensor.clone().try_into_primitive::<Flex>().ok()?),*]);
        let tracked =
            || Some([$($tensor.clone().try_into_primitive::<Autodiff<Flex>>().ok()?),*]);
        plain().map(Operands::Plain).or_else(|| tracked().map(Operands::Tracked))
    }};
}

/// `activation(x W + b)`.
///
/// # Shapes
///
/// - `x`: `[N, inputs]`, `weights`: `[inputs, outputs]`, `bias`: `[outputs]`
/// - output: `[N, outputs]`
pub(crate) fn dense(
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, inputs], [_, outputs]) = (x.dims(), weights.dims());
    let Some(operands) = operands!(x, weights, bias) else {
        return stock::dense(x, weights, bias, activation);
    };
    let layer = dense::Layer { inputs, outputs, activation };
    apply(DenseFunction(layer), operands, [n, outputs])
}

/// `activation(conv(x) + b)` with a 3³ kernel on the cells of each sample.
///
/// # Shapes
///
/// - `x`: `[B * cells, inputs]`, cells in the order of `tiles`
/// - `weights`: `[27 * inputs, outputs]`, taps x fastest, then channels; `bias`: `[outputs]`
/// - output: `[B * cells, outputs]`
pub(crate) fn convolve(
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
    tiles: &Arc<Tiles>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, inputs], [_, outputs]) = (x.dims(), weights.dims());
    let Some(operands) = operands!(x, weights, bias) else {
        return stock::convolve(x, weights, bias, &tiles.neighbours(), tiles.n_cells(), activation);
    };
    let tiles = Arc::clone(tiles);
    let function = ConvolveFunction { tiles, inputs, channels_below: 0, outputs, activation };
    apply(function, operands, [n, outputs])
}

/// The same with stride 2.
///
/// # Shapes
///
/// - `x`: `[B * cells, inputs]`, cells in the order of `windows`
/// - `weights`: `[27 * inputs, outputs]`, taps x fastest, then channels; `bias`: `[outputs]`
/// - output: `[B * windows, outputs]`
pub(crate) fn convolve_strided(
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
    windows: &Arc<Windows>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, inputs], [_, outputs]) = (x.dims(), weights.dims());
    let Some(operands) = operands!(x, weights, bias) else {
        let n_cells = windows.n_cells();
        return stock::convolve(x, weights, bias, &windows.neighbours(), n_cells, activation);
    };
    let function = StridedFunction { windows: Arc::clone(windows), inputs, outputs, activation };
    apply(function, operands, [n / 8, outputs])
}

/// `activation(conv(x beside the block of eight rows that it is in) + b)`: the nearest cells of the
/// grid below.
///
/// # Shapes
///
/// - `x`: `[B * cells, own]`, aligned 2³ blocks of cells contiguous
/// - `below`: `[B * cells / 8, inputs - own]`
/// - `weights`: `[27 * inputs, outputs]`, taps x fastest, then channels; `bias`: `[outputs]`
/// - output: `[B * cells, outputs]`
pub(crate) fn convolve_joined(
    [x, below]: [Tensor<2>; 2],
    weights: Tensor<2>,
    bias: Tensor<1>,
    tiles: &Arc<Tiles>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, own], [_, channels_below], [_, outputs]) = (x.dims(), below.dims(), weights.dims());
    let Some(operands) = operands!(x, weights, bias, below) else {
        let x = stock::joined(x, below);
        return stock::convolve(x, weights, bias, &tiles.neighbours(), tiles.n_cells(), activation);
    };
    let tiles = Arc::clone(tiles);
    let function = ConvolveFunction { tiles, inputs: own, channels_below, outputs, activation };
    apply(function, operands, [n, outputs])
}

/// `activation(max over each set of (x W) + b)`.
///
/// # Shapes
///
/// - `x`: `[sets * members, inputs]`, `weights`: `[inputs, outputs]`, `bias`: `[outputs]`
/// - output: `[sets, outputs]`
pub(crate) fn pooled_dense(
    x: Tensor<2>,
    members: usize,
    weights: Tensor<2>,
    bias: Tensor<1>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, inputs], [_, outputs]) = (x.dims(), weights.dims());
    let Some(operands) = operands!(x, weights, bias) else {
        return stock::pooled_dense(x, members, weights, bias, activation);
    };
    let layer = dense::Layer { inputs, outputs, activation };
    apply(PooledFunction { layer, members }, operands, [n / members, outputs])
}

/// A function of slices, all of a layer here: input, weights and bias, then what else there is.
trait Function<const N: usize>: Debug + Send + Sync + 'static {
    /// What the gradient needs beside operands and output.
    type Saved: Debug + Clone + Send + 'static;

    fn forward(&self, operands: [&[f32]; N]) -> (Vec<f32>, Self::Saved);

    /// The gradients from the output and its gradient; those of inputs only if one is wanted.
    fn backward(
        &self,
        operands: [&[f32]; N],
        saved: &Self::Saved,
        outputs: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; N];
}

fn of_layer(LayerGradients { x, weights, bias }: LayerGradients) -> [Option<Vec<f32>>; 3] {
    [x, Some(weights), Some(bias)]
}

#[derive(Debug)]
struct DenseFunction(dense::Layer);

impl Function<3> for DenseFunction {
    type Saved = ();

    fn forward(&self, [x, weights, bias]: [&[f32]; 3]) -> (Vec<f32>, ()) {
        (dense::forward(Level::new(), self.0, x, weights, bias), ())
    }

    fn backward(
        &self,
        [x, weights, _]: [&[f32]; 3],
        (): &(),
        [y, dy]: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; 3] {
        of_layer(dense::backward(Level::new(), self.0, [x, weights, y, dy], with_x))
    }
}

#[derive(Debug)]
struct ConvolveFunction {
    tiles: Arc<Tiles>,
    inputs: usize,
    channels_below: usize,
    outputs: usize,
    activation: Activation,
}

impl ConvolveFunction {
    fn layer(&self) -> winograd::Layer<'_> {
        let Self { tiles, inputs, channels_below, outputs, activation } = self;
        winograd::Layer {
            tiles,
            channels_in: *inputs,
            channels_below: *channels_below,
            channels_out: *outputs,
            activation: *activation,
        }
    }
}

impl Function<3> for ConvolveFunction {
    type Saved = ();

    fn forward(&self, [x, weights, bias]: [&[f32]; 3]) -> (Vec<f32>, ()) {
        Function::<4>::forward(self, [x, weights, bias, &[]])
    }

    fn backward(
        &self,
        [x, weights, bias]: [&[f32]; 3],
        (): &(),
        outputs: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; 3] {
        let operands = [x, weights, bias, &[]];
        let [x, weights, bias, _] = Function::<4>::backward(self, operands, &(), outputs, with_x);
        [x, weights, bias]
    }
}

/// With the channels of blocks.
impl Function<4> for ConvolveFunction {
    type Saved = ();

    fn forward(&self, [x, weights, bias, below]: [&[f32]; 4]) -> (Vec<f32>, ()) {
        (winograd::forward(Level::new(), self.layer(), [x, below], weights, bias), ())
    }

    fn backward(
        &self,
        [x, weights, _, below]: [&[f32]; 4],
        (): &(),
        [y, dy]: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; 4] {
        let slices = [x, below, weights, y, dy];
        let (layer, below) = winograd::backward(Level::new(), self.layer(), slices, with_x);
        let [x, weights, bias] = of_layer(layer);
        [x, weights, bias, below]
    }
}

#[derive(Debug)]
struct StridedFunction {
    windows: Arc<Windows>,
    inputs: usize,
    outputs: usize,
    activation: Activation,
}

impl StridedFunction {
    fn layer(&self) -> strided::Layer<'_> {
        let Self { windows, inputs, outputs, activation } = self;
        strided::Layer {
            windows,
            channels_in: *inputs,
            channels_out: *outputs,
            activation: *activation,
        }
    }
}

impl Function<3> for StridedFunction {
    type Saved = ();

    fn forward(&self, [x, weights, bias]: [&[f32]; 3]) -> (Vec<f32>, ()) {
        (strided::forward(Level::new(), self.layer(), x, weights, bias), ())
    }

    fn backward(
        &self,
        [x, weights, _]: [&[f32]; 3],
        (): &(),
        [y, dy]: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; 3] {
        of_layer(strided::backward(Level::new(), self.layer(), [x, weights, y, dy], with_x))
    }
}

#[derive(Debug)]
struct PooledFunction {
    layer: dense::Layer,
    members: usize,
}

impl Function<3> for PooledFunction {
    /// The maxima: their values are the output once more.
    type Saved = Arc<pooled::Maxima>;

    fn forward(&self, operands: [&[f32]; 3]) -> (Vec<f32>, Self::Saved) {
        let maxima = pooled::forward(Level::new(), self.layer, self.members, operands);
        (maxima.values.clone(), Arc::new(maxima))
    }

    fn backward(
        &self,
        [x, weights, _]: [&[f32]; 3],
        saved: &Self::Saved,
        [_, dy]: [&[f32]; 2],
        with_x: bool,
    ) -> [Option<Vec<f32>>; 3] {
        let (layer, members) = (self.layer, self.members);
        let operands = [x, weights, dy];
        of_layer(pooled::backward(Level::new(), layer, members, operands, saved, with_x))
    }
}

type Plain = FloatTensor<Flex>;
type Tracked = FloatTensor<Autodiff<Flex>>;

/// Operands on burn-flex, all plain or all tracked.
enum Operands<const N: usize> {
    Plain([Plain; N]),
    Tracked([Tracked; N]),
}

fn apply<F: Function<N>, const N: usize, const D: usize>(
    function: F,
    operands: Operands<N>,
    shape: [usize; D],
) -> Tensor<D> {
    let tensor = |values| Plain::from_data(TensorData::new(values, shape));
    match operands {
        Operands::Plain(operands) => {
            let operands = operands.map(|operand| operand.to_contiguous());
            let (values, _) = function.forward(operands.each_ref().map(slice));
            Tensor::from_primitive::<Flex>(tensor(values))
        }
        Operands::Tracked(operands) => {
            let guards = operands.each_ref().map(|operand| operand.node());
            let operands = operands.map(|operand| operand.into_primitive().to_contiguous());
            let (values, saved) = function.forward(operands.each_ref().map(slice));
            let output = tensor(values);
            let function = Arc::new(function);
            let node = match Step::<F>::new()
                .prepare::<NoCheckpointing>(guards)
                .compute_bound()
                .stateful()
            {
                OpsKind::Tracked(prepared) => {
                    let output_values = output.clone();
                    let state = State { function, operands, saved, output: output_values };
                    prepared.finish(state, output)
                }
                OpsKind::UnTracked(prepared) => prepared.finish(output),
            };
            Tensor::from_primitive::<Autodiff<Flex>>(node)
        }
    }
}

fn slice(tensor: &Plain) -> &[f32] {
    tensor.as_slice().expect("made contiguous, and every float tensor of this crate holds f32")
}

/// A function's part in the backward pass.
#[derive(Debug)]
struct Step<F>(core::marker::PhantomData<F>);

impl<F> Step<F> {
    const fn new() -> Self {
        Self(core::marker::PhantomData)
    }
}

#[derive(Debug)]
struct State<F: Function<N>, const N: usize> {
    function: Arc<F>,
    operands: [Plain; N],
    saved: F::Saved,
    output: Plain,
}

impl<F: Function<N>, const N: usize> Clone for State<F, N> {
    fn clone(&self) -> Self {
        Self {
            function: Arc::clone(&self.function),
            operands: self.operands.clone(),
            saved: self.saved.clone(),
            output: self.output.clone(),
        }
    }
}

impl<F: Function<N>, const N: usize> Backward<Flex, N> for Step<F> {
    type State = State<F, N>;

    fn backward(
        self,
        ops: Ops<Self::State, N>,
        gradients: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let dy = gradients.consume::<Flex>(&ops.node).to_contiguous();
        let State { function, operands, saved, output } = ops.state;
        let slices = operands.each_ref().map(slice);
        let found = function.backward(
            slices,
            &saved,
            [slice(&output), slice(&dy)],
            // Weights and bias are always wanted.
            [0, 3].iter().any(|&idx| ops.parents.get(idx).is_some_and(Option::is_some)),
        );
        for ((parent, gradient), operand) in ops.parents.iter().zip(found).zip(&operands) {
            if let (Some(parent), Some(gradient)) = (parent, gradient) {
                let shape = operand.layout().shape().clone();
                let gradient = Plain::from_data(TensorData::new(gradient, shape));
                gradients.register::<Flex>(parent.id, gradient);
            }
        }
    }
}
