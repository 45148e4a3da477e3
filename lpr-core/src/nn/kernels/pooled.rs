//! A fully connected layer on every member of a set, then the maximum over each set.
//!
//! The layer's outputs are never stored: a tile of them is compared with the maxima so far while it
//! is in registers. The gradient goes through the maxima only, of which a set has as many as
//! outputs, however many members.

use super::dense::{Gradients, Layer, before_activation, sum_of_rows};
use super::matmul::{Matrix, Panels, Place, pack, tile_sums, tile_width};
use crate::lanes::{Floats, splat};

use fearless_simd::{Level, Select as _, Simd, SimdBase as _, SimdFloat as _, dispatch};

/// Maxima, and the member that each came from.
#[derive(Debug, Clone)]
pub(crate) struct Maxima {
    /// `[sets, outputs]`: `activation(max(x W) + b)`.
    pub(crate) values: Vec<f32>,
    /// `[sets, outputs]`: the first of the largest, within its set.
    pub(crate) members: Vec<u32>,
}

/// The maxima of all sets.
///
/// # Shapes
///
/// - `x`: `[sets, members, inputs]`, `weights`: `[inputs, outputs]`, `bias`: `[outputs]`
pub(crate) fn forward(
    level: Level,
    layer: Layer,
    members: usize,
    [x, weights, bias]: [&[f32]; 3],
) -> Maxima {
    let n_sets = x.len() / (members * layer.inputs);
    let mut maxima = Maxima {
        values: vec![0.0; n_sets * layer.outputs],
        members: vec![0; n_sets * layer.outputs],
    };
    assert!(members > 0 && members < 1 << 24, "{members} members: their indices are held in f32");
    dispatch!(level, simd => {
        let mut memory = Vec::new();
        let panels = pack(simd, Matrix::new(weights, layer.inputs, layer.outputs), &mut memory);
        for (set, x) in x.chunks_exact(members * layer.inputs).enumerate() {
            let x = Matrix::new(x, members, layer.inputs);
            let range = set * layer.outputs..(set + 1) * layer.outputs;
            let (values, found) = (&mut maxima.values[range.clone()], &mut maxima.members[range]);
            pool(simd, layer, x, Right { panels, bias }, values, found);
        }
    });
    maxima
}

/// Weights and bias.
#[derive(Debug, Clone, Copy)]
struct Right<'a> {
    panels: Panels<'a>,
    bias: &'a [f32],
}

#[inline(always)]
fn pool<S: Simd>(
    simd: S,
    layer: Layer,
    x: Matrix<'_>,
    right: Right<'_>,
    values: &mut [f32],
    members: &mut [u32],
) {
    let n = Floats::<S>::LEN;
    if n >= 16 {
        pool_tiles::<S, 12, 2>(simd, layer, x, right, values, members);
    } else if n == 8 {
        pool_tiles::<S, 6, 2>(simd, layer, x, right, values, members);
    } else {
        pool_tiles::<S, 3, 4>(simd, layer, x, right, values, members);
    }
}

/// Maxima so far of a panel, and the members that they came from.
type Best<S, const V: usize> = [[Floats<S>; V]; 2];

#[inline(always)]
fn pool_tiles<S: Simd, const R: usize, const V: usize>(
    simd: S,
    layer: Layer,
    x: Matrix<'_>,
    right: Right<'_>,
    values: &mut [f32],
    members: &mut [u32],
) {
    let n = Floats::<S>::LEN;
    let width = tile_width::<S>();
    let mut first = 0;
    while first < layer.outputs {
        let panel = Place { panels: right.panels, first };
        let mut best: Best<S, V> = [[splat(simd, f32::NEG_INFINITY); V], [splat(simd, 0.0); V]];
        let mut row = 0;
        while row + R <= x.rows {
            raise::<S, R, V>(simd, x, row, panel, &mut best);
            row += R;
        }
        while row + 2 <= x.rows {
            raise::<S, 2, V>(simd, x, row, panel, &mut best);
            row += 2;
        }
        if row < x.rows {
            raise::<S, 1, V>(simd, x, row, panel, &mut best);
        }
        let mut v = 0;
        while v < V && first + v * n < layer.outputs {
            let begin = first + v * n;
            let end = layer.outputs.min(begin + n);
            let mut padded = [0.0; 16];
            padded[..end - begin].copy_from_slice(&right.bias[begin..end]);
            let sum = best[0][v] + Floats::<S>::from_slice(simd, &padded[..n]);
            let activated = layer.activation.apply(simd, sum);
            for lane in 0..end - begin {
                values[begin + lane] = activated[lane];
                members[begin + lane] = best[1][v][lane] as u32;
            }
            v += 1;
        }
        first += width;
    }
}

/// Raises the maxima to the sums of `R` rows; what is not a number stays.
#[inline(always)]
fn raise<S: Simd, const R: usize, const V: usize>(
    simd: S,
    x: Matrix<'_>,
    row: usize,
    panel: Place<'_>,
    best: &mut Best<S, V>,
) {
    let sums = tile_sums::<S, R, V>(simd, x, row, panel);
    let mut r = 0;
    while r < R {
        let member = splat(simd, (row + r) as f32);
        let mut v = 0;
        while v < V {
            let is_kept = sums[r][v].simd_le(best[0][v]) | !best[0][v].simd_eq(best[0][v]);
            best[0][v] = is_kept.select(best[0][v], sums[r][v]);
            best[1][v] = is_kept.select(best[1][v], member);
            v += 1;
        }
        r += 1;
    }
}

/// The gradients that belong to `dy`, that of the maxima.
pub(crate) fn backward(
    level: Level,
    layer: Layer,
    members: usize,
    [x, weights, dy]: [&[f32]; 3],
    maxima: &Maxima,
    with_x: bool,
) -> Gradients {
    let Layer { inputs, outputs, activation } = layer;
    let sums = before_activation(activation, &maxima.values, dy);
    let columns = transposed(weights, inputs, outputs);
    let mut dx = with_x.then(|| vec![0.0; x.len()]);
    // By outputs first, so that both sums run over successive numbers.
    let mut dw = vec![0.0; weights.len()];
    dispatch!(level, simd => {
        for (i, (&sum, &member)) in sums.iter().zip(&maxima.members).enumerate() {
            if sum != 0.0 {
                let (set, output) = (i / outputs, i % outputs);
                let begin = (set * members + member as usize) * inputs;
                let row = begin..begin + inputs;
                let column = output * inputs..(output + 1) * inputs;
                add_scaled(simd, sum, &x[row.clone()], &mut dw[column.clone()]);
                if let Some(dx) = &mut dx {
                    add_scaled(simd, sum, &columns[column], &mut dx[row]);
                }
            }
        }
    });
    let bias = sum_of_rows(&sums, outputs);
    Gradients { x: dx, weights: transposed(&dw, outputs, inputs), bias }
}

/// `to += factor from`.
#[inline(always)]
fn add_scaled<S: Simd>(simd: S, factor: f32, from: &[f32], to: &mut [f32]) {
    let n = Floats::<S>::LEN;
    let vector = splat(simd, factor);
    let whole = from.len() / n * n;
    let mut i = 0;
    while i < whole {
        let place = &mut to[i..i + n];
        let sum = Floats::<S>::from_slice(simd, place);
        vector.mul_add(Floats::<S>::from_slice(simd, &from[i..i + n]), sum).store_slice(place);
        i += n;
    }
    for i in whole..from.len() {
        to[i] += factor * from[i];
    }
}

/// `[rows, columns]` as `[columns, rows]`.
fn transposed(matrix: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let mut result = vec![0.0; matrix.len()];
    for (row, values) in matrix.chunks_exact(columns).enumerate() {
        for (column, &value) in values.iter().enumerate() {
            result[column * rows + row] = value;
        }
    }
    result
}
