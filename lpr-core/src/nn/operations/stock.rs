//! The same operations of burn's own: what another device runs, and the check of ours.

use super::Activation;

use burn::tensor::activation::{leaky_relu, relu};
use burn::tensor::module::linear;
use burn::tensor::{Int, Tensor, TensorData};

fn activated<const D: usize>(x: Tensor<D>, activation: Activation) -> Tensor<D> {
    match activation {
        Activation::Linear => x,
        Activation::Relu => relu(x),
        Activation::Leaky { slope } => leaky_relu(x, f64::from(slope)),
    }
}

pub(super) fn dense(
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
    activation: Activation,
) -> Tensor<2> {
    activated(linear(x, weights, Some(bias)), activation)
}

/// The neighbours of each output side by side, then a fully connected layer. Samples have `n_cells`
/// rows.
pub(super) fn convolve(
    x: Tensor<2>,
    weights: Tensor<2>,
    bias: Tensor<1>,
    near: &[[Option<usize>; 27]],
    n_cells: usize,
    activation: Activation,
) -> Tensor<2> {
    let [n, channels] = x.dims();
    let n_outputs = n / n_cells * near.len();
    // Beyond the grid is the row of zeros after the last.
    let rows = (0..n / n_cells)
        .flat_map(|sample| {
            near.iter().flatten().map(move |row| row.map_or(n, |row| sample * n_cells + row) as i32)
        })
        .collect::<Vec<_>>();
    let device = x.device();
    let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [27 * n_outputs]), &device);
    let zeros = Tensor::zeros([1, channels], &device);
    let near = Tensor::cat(vec![x, zeros], 0).select(0, rows).reshape([n_outputs, 27 * channels]);
    dense(near, weights, bias, activation)
}

/// The channels of each row, then those of the block of eight rows that it is in.
pub(super) fn joined(x: Tensor<2>, below: Tensor<2>) -> Tensor<2> {
    let ([n, _], [n_below, channels]) = (x.dims(), below.dims());
    let nearest = below.reshape([n_below, 1, channels]).expand([n_below, 8, channels]);
    Tensor::cat(vec![x, nearest.reshape([n, channels])], 1)
}

pub(super) fn pooled_dense(
    x: Tensor<2>,
    members: usize,
    weights: Tensor<2>,
    bias: Tensor<1>,
    activation: Activation,
) -> Tensor<2> {
    let ([n, _], [_, outputs]) = (x.dims(), weights.dims());
    let sums = linear(x, weights, Some(bias)).reshape([n / members, members, outputs]);
    activated(sums.max_dim(1).reshape([n / members, outputs]), activation)
}
