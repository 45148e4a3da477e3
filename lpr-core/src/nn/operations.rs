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
    let Some(operands) = Operands::new(&x, &weights, &bias) else {
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
    let Some(operands) = Operands::new(&x, &weights, &bias) else {
        return stock::convolve(x, weights, bias, &tiles.neighbours(), tiles.n_cells(), activation);
    };
    let function = ConvolveFunction { tiles: Arc::clone(tiles), inputs, outputs, activation };
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
    let Some(operands) = Operands::new(&x, &weights, &bias) else {
        let n_cells = windows.n_cells();
        return stock::convolve(x, weights, bias, &windows.neighbours(), n_cells, activation);
    };
    let function = StridedFunction { windows: Arc::clone(windows), inputs, outputs, activation };
    apply(function, operands, [n / 8, outputs])
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
    let Some(operands) = Operands::new(&x, &weights, &bias) else {
        return stock::pooled_dense(x, members, weights, bias, activation);
    };
    let layer = dense::Layer { inputs, outputs, activation };
    apply(PooledFunction { layer, members }, operands, [n / members, outputs])
}

/// A function of three slices, all of a layer here: input, weights and bias.
trait Function: Debug + Send + Sync + 'static {
    /// What the gradient needs beside operands and output.
    type Saved: Debug + Clone + Send + 'static;

    fn forward(&self, operands: [&[f32]; 3]) -> (Vec<f32>, Self::Saved);

    /// The gradients from the output and its gradient; that of the input only if it is wanted.
    fn backward(
        &self,
        operands: [&[f32]; 3],
        saved: &Self::Saved,
        outputs: [&[f32]; 2],
        with_x: bool,
    ) -> LayerGradients;
}

#[derive(Debug)]
struct DenseFunction(dense::Layer);

impl Function for DenseFunction {
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
    ) -> LayerGradients {
        dense::backward(Level::new(), self.0, [x, weights, y, dy], with_x)
    }
}

#[derive(Debug)]
struct ConvolveFunction {
    tiles: Arc<Tiles>,
    inputs: usize,
    outputs: usize,
    activation: Activation,
}

impl ConvolveFunction {
    fn layer(&self) -> winograd::Layer<'_> {
        let Self { tiles, inputs, outputs, activation } = self;
        winograd::Layer {
            tiles,
            channels_in: *inputs,
            channels_out: *outputs,
            activation: *activation,
        }
    }
}

impl Function for ConvolveFunction {
    type Saved = ();

    fn forward(&self, [x, weights, bias]: [&[f32]; 3]) -> (Vec<f32>, ()) {
        (winograd::forward(Level::new(), self.layer(), x, weights, bias), ())
    }

    fn backward(
        &self,
        [x, weights, _]: [&[f32]; 3],
        (): &(),
        [y, dy]: [&[f32]; 2],
        with_x: bool,
    ) -> LayerGradients {
        winograd::backward(Level::new(), self.layer(), [x, weights, y, dy], with_x)
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

impl Function for StridedFunction {
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
    ) -> LayerGradients {
        strided::backward(Level::new(), self.layer(), [x, weights, y, dy], with_x)
    }
}

#[derive(Debug)]
struct PooledFunction {
    layer: dense::Layer,
    members: usize,
}

impl Function for PooledFunction {
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
    ) -> LayerGradients {
        let (layer, members) = (self.layer, self.members);
        pooled::backward(Level::new(), layer, members, [x, weights, dy], saved, with_x)
    }
}

type Plain = FloatTensor<Flex>;
type Tracked = FloatTensor<Autodiff<Flex>>;

/// Input, weights and bias on burn-flex, all plain or all tracked.
enum Operands {
    Plain([Plain; 3]),
    Tracked([Tracked; 3]),
}

impl Operands {
    /// None on another device.
    fn new(x: &Tensor<2>, weights: &Tensor<2>, bias: &Tensor<1>) -> Option<Self> {
        let plain = || {
            let x = x.clone().try_into_primitive::<Flex>().ok()?;
            let weights = weights.clone().try_into_primitive::<Flex>().ok()?;
            Some([x, weights, bias.clone().try_into_primitive::<Flex>().ok()?])
        };
        let tracked = || {
            let x = x.clone().try_into_primitive::<Autodiff<Flex>>().ok()?;
            let weights = weights.clone().try_into_primitive::<Autodiff<Flex>>().ok()?;
            Some([x, weights, bias.clone().try_into_primitive::<Autodiff<Flex>>().ok()?])
        };
        plain().map(Self::Plain).or_else(|| tracked().map(Self::Tracked))
    }
}

fn apply<F: Function, const D: usize>(
    function: F,
    operands: Operands,
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
struct State<F: Function> {
    function: Arc<F>,
    operands: [Plain; 3],
    saved: F::Saved,
    output: Plain,
}

impl<F: Function> Clone for State<F> {
    fn clone(&self) -> Self {
        Self {
            function: Arc::clone(&self.function),
            operands: self.operands.clone(),
            saved: self.saved.clone(),
            output: self.output.clone(),
        }
    }
}

impl<F: Function> Backward<Flex, 3> for Step<F> {
    type State = State<F>;

    fn backward(
        self,
        ops: Ops<Self::State, 3>,
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
            ops.parents[0].is_some(),
        );
        let LayerGradients { x, weights, bias } = found;
        let found = [x, Some(weights), Some(bias)];
        for ((parent, gradient), operand) in ops.parents.iter().zip(found).zip(&operands) {
            if let (Some(parent), Some(gradient)) = (parent, gradient) {
                let shape = operand.layout().shape().clone();
                let gradient = Plain::from_data(TensorData::new(gradient, shape));
                gradients.register::<Flex>(parent.id, gradient);
            }
        }
    }
}
