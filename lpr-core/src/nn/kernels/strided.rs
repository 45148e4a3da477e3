//! 3³ convolution with stride 2: the neighbourhoods of some cells side by side, then a product.
//!
//! Winograd's algorithm saves nothing here: its tiles would compute eight outputs for one.

use super::dense::{LayerGradients, before_activation, sum_of_rows};
use super::matmul::{
    Activation, Matrix, Store, accumulate_into, add_scaled, multiply_panels, pack, pack_transposed,
};
use super::tiles::{NOWHERE, Tiles};

use fearless_simd::{Level, dispatch};

/// Weights of a kernel.
const TAPS: usize = 27;
/// Numbers of neighbourhoods side by side, about, so that they stay in the second cache of a core.
const BLOCK_NUMBERS: usize = 1 << 16;
/// Neighbourhoods at once are a multiple: whole register tiles of any vectors.
const WHOLE: usize = 12;

/// The cells that the outputs of a layer are computed from.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    n_cells: usize,
    /// For each output the rows of the 3³ neighbourhood of its cell, x fastest; [`NOWHERE`] beyond
    /// the grid.
    near: Vec<[u32; TAPS]>,
}

impl Windows {
    /// The neighbourhoods of every eighth row: of the first cell of each 2³ block, where blocks are
    /// contiguous.
    pub(crate) fn of_blocks(tiles: &Tiles) -> Self {
        let row = |row: Option<usize>| row.map_or(NOWHERE, |row| row as u32);
        let near = tiles.neighbours().into_iter().step_by(8).map(|near| near.map(row)).collect();
        Self { n_cells: tiles.n_cells, near }
    }

    /// Rows of a sample.
    pub(crate) const fn n_cells(&self) -> usize {
        self.n_cells
    }

    /// Outputs of a sample.
    pub(crate) const fn n_outputs(&self) -> usize {
        self.near.len()
    }

    /// For each output the rows of its neighbourhood; none beyond the grid.
    pub(crate) fn neighbours(&self) -> Vec<[Option<usize>; TAPS]> {
        let row = |row: u32| (row != NOWHERE).then_some(row as usize);
        self.near.iter().map(|near| near.map(row)).collect()
    }
}

/// Sizes of a layer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layer<'a> {
    pub(crate) windows: &'a Windows,
    pub(crate) channels_in: usize,
    pub(crate) channels_out: usize,
    pub(crate) activation: Activation,
}

impl Layer<'_> {
    /// Outputs of all samples.
    fn n_outputs(&self, x: &[f32]) -> usize {
        let n_numbers = self.windows.n_cells * self.channels_in;
        assert!(x.len().is_multiple_of(n_numbers), "whole samples of {n_numbers} numbers");
        x.len() / n_numbers * self.windows.n_outputs()
    }

    /// Inputs of an output.
    const fn width(&self) -> usize {
        TAPS * self.channels_in
    }

    /// Outputs that are computed together.
    fn block(&self) -> usize {
        (BLOCK_NUMBERS / self.width()).next_multiple_of(WHOLE)
    }

    /// Where the channels of each neighbour of an output begin in the input.
    fn places(&self, output: usize) -> impl Iterator<Item = Option<usize>> {
        let n = self.windows.n_outputs();
        let base = output / n * self.windows.n_cells;
        let near = self.windows.near[output % n].iter();
        near.map(move |&row| (row != NOWHERE).then(|| (base + row as usize) * self.channels_in))
    }

    /// The neighbourhoods of outputs from `first` on, side by side.
    fn gather(&self, x: &[f32], first: usize, rows: &mut [f32]) {
        for (output, row) in (first..).zip(rows.chunks_exact_mut(self.width())) {
            for (place, to) in self.places(output).zip(row.chunks_exact_mut(self.channels_in)) {
                match place {
                    Some(begin) => to.copy_from_slice(&x[begin..begin + self.channels_in]),
                    None => to.fill(0.0),
                }
            }
        }
    }
}

/// `y = activation(conv(x) + bias)`.
///
/// # Shapes
///
/// - `x`: `[samples, cells, channels_in]`
/// - `weights`: `[27, channels_in, channels_out]`, x fastest among the taps
/// - output: `[samples, outputs, channels_out]`
pub(crate) fn forward(
    level: Level,
    layer: Layer<'_>,
    x: &[f32],
    weights: &[f32],
    bias: &[f32],
) -> Vec<f32> {
    let (k, n) = (layer.width(), layer.channels_out);
    let mut y = vec![0.0; layer.n_outputs(x) * n];
    let mut rows = vec![0.0; layer.block() * k];
    dispatch!(level, simd => {
        let mut memory = Vec::new();
        let panels = pack(simd, Matrix::new(weights, k, n), &mut memory);
        let store = Store { columns: n, stride: n, bias: Some(bias), activation: layer.activation };
        for (block, y) in y.chunks_mut(layer.block() * n).enumerate() {
            let n_rows = y.len() / n;
            let rows = &mut rows[..n_rows * k];
            layer.gather(x, block * layer.block(), rows);
            multiply_panels(simd, Matrix::new(rows, n_rows, k), panels, store, y);
        }
    });
    y
}

/// The gradients that belong to `dy`, that of the output `y`.
pub(crate) fn backward(
    level: Level,
    layer: Layer<'_>,
    [x, weights, y, dy]: [&[f32]; 4],
    with_x: bool,
) -> LayerGradients {
    let (k, n) = (layer.width(), layer.channels_out);
    let sums = before_activation(layer.activation, y, dy);
    let mut dw = vec![0.0; weights.len()];
    let mut dx = with_x.then(|| vec![0.0; x.len()]);
    let mut rows = vec![0.0; layer.block() * k];
    dispatch!(level, simd => {
        let mut memory = Vec::new();
        let panels = pack_transposed(simd, Matrix::new(weights, k, n), &mut memory);
        for (block, dy) in sums.chunks(layer.block() * n).enumerate() {
            let first = block * layer.block();
            let n_rows = dy.len() / n;
            let (dy, rows) = (Matrix::new(dy, n_rows, n), &mut rows[..n_rows * k]);
            layer.gather(x, first, rows);
            accumulate_into(simd, Matrix::new(rows, n_rows, k), dy, &mut dw);
            let Some(dx) = &mut dx else { continue };
            multiply_panels(simd, dy, panels, Store::plain(k, k), rows);
            for (output, row) in (first..).zip(rows.chunks_exact(k)) {
                for (place, from) in layer.places(output).zip(row.chunks_exact(layer.channels_in)) {
                    if let Some(begin) = place {
                        add_scaled(simd, 1.0, from, &mut dx[begin..begin + layer.channels_in]);
                    }
                }
            }
        }
    });
    LayerGradients { x: dx, weights: dw, bias: sum_of_rows(&sums, n) }
}
