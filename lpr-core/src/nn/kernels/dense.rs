//! A fully connected layer with its activation, and its gradients.

use super::matmul::{Activation, Matrix, accumulate, multiply, multiply_transposed};

use fearless_simd::Level;

/// Sizes of a layer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layer {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) activation: Activation,
}

/// `activation(x W + b)`.
///
/// # Shapes
///
/// - `x`: `[rows, inputs]`, `weights`: `[inputs, outputs]`, `bias`: `[outputs]`
/// - output: `[rows, outputs]`
pub(crate) fn forward(
    level: Level,
    layer: Layer,
    x: &[f32],
    weights: &[f32],
    bias: &[f32],
) -> Vec<f32> {
    let Layer { inputs, outputs, activation } = layer;
    let rows = x.len() / inputs;
    let mut y = vec![0.0; rows * outputs];
    let (x, weights) = (Matrix::new(x, rows, inputs), Matrix::new(weights, inputs, outputs));
    multiply(level, x, weights, Some(bias), activation, &mut y);
    y
}

/// The gradients of a layer of any kind.
#[derive(Debug)]
pub(crate) struct LayerGradients {
    /// None where it was not asked for.
    pub(crate) x: Option<Vec<f32>>,
    pub(crate) weights: Vec<f32>,
    pub(crate) bias: Vec<f32>,
}

/// The gradients that belong to `dy`, that of the output `y`.
pub(crate) fn backward(
    level: Level,
    layer: Layer,
    [x, weights, y, dy]: [&[f32]; 4],
    with_x: bool,
) -> LayerGradients {
    let Layer { inputs, outputs, activation } = layer;
    let rows = x.len() / inputs;
    let sums = before_activation(activation, y, dy);
    let dy = Matrix::new(&sums, rows, outputs);
    let mut dw = vec![0.0; inputs * outputs];
    accumulate(level, Matrix::new(x, rows, inputs), dy, &mut dw);
    let dx = with_x.then(|| {
        let mut dx = vec![0.0; x.len()];
        multiply_transposed(level, dy, Matrix::new(weights, inputs, outputs), &mut dx);
        dx
    });
    LayerGradients { x: dx, weights: dw, bias: sum_of_rows(&sums, outputs) }
}

/// The gradient of what entered the activation.
pub(crate) fn before_activation(activation: Activation, y: &[f32], dy: &[f32]) -> Vec<f32> {
    match activation {
        Activation::Linear => dy.to_vec(),
        Activation::Relu => {
            y.iter().zip(dy).map(|(&y, &dy)| if y <= 0.0 { 0.0 } else { dy }).collect()
        }
        Activation::Leaky { slope } => {
            y.iter().zip(dy).map(|(&y, &dy)| if y <= 0.0 { slope * dy } else { dy }).collect()
        }
    }
}

/// The sum of all rows of `columns` numbers.
pub(crate) fn sum_of_rows(rows: &[f32], columns: usize) -> Vec<f32> {
    let mut sums = vec![0.0; columns];
    for row in rows.chunks_exact(columns) {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value;
        }
    }
    sums
}
