//! A fully connected layer on every member of a set, then the maximum over each set.
//!
//! The layer's outputs are never stored: a tile of them is compared with the maxima so far while it
//! is in registers. The gradient goes through the maxima only, of which a set has as many as
//! outputs, however many members.

use super::dense::{Layer, LayerGradients, before_activation, sum_of_rows};
use super::matmul::{
    Matrix, Panels, Place, add_scaled, by_tile, load_part, pack, tile_sums, tile_width, transposed,
};
use crate::lanes::{Floats, splat};

use fearless_simd::{Level, Select as _, Simd, SimdBase as _, dispatch};

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
    by_tile!(pool_tiles::<S>(simd, layer, x, right, values, members));
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
            let bias = load_part(simd, &right.bias[begin..end]);
            let activated = layer.activation.apply(simd, best[0][v] + bias);
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
) -> LayerGradients {
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
    LayerGradients { x: dx, weights: transposed(&dw, outputs, inputs), bias }
}
