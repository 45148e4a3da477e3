//! From weights to products and back: the map `G`.

use super::super::matmul::{Panels, load_part, store_part, tile_width, transposed};
use super::below::reads_below;
use super::{Layer, PLANES, TAPS};
use crate::lanes::{Floats, splat};

use fearless_simd::{Simd, SimdBase as _};

/// `G` along one axis: weights to products.
#[inline(always)]
fn weights<S: Simd>([a, b, c]: [Floats<S>; 3]) -> [Floats<S>; 4] {
    let [even, odd] = [(a + c) * 0.5, b * 0.5];
    [a, even + odd, even - odd, c]
}

/// `Gᵀ` along one axis.
#[inline(always)]
fn weight_gradients_along<S: Simd>([a, b, c, d]: [Floats<S>; 4]) -> [Floats<S>; 3] {
    let [sum, difference] = [(b + c) * 0.5, (b - c) * 0.5];
    [a + sum, difference, sum + d]
}

/// `U = G w Gᵀ` in panels, one set after the other.
pub(super) struct TransformedWeights {
    values: Vec<f32>,
    /// Numbers of a plane.
    plane: usize,
}

impl TransformedWeights {
    /// From `[27, rows, columns]`; rows from `everywhere` on are those of blocks.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        weights: &[f32],
        [rows, columns]: [usize; 2],
        everywhere: usize,
    ) -> Self {
        let [n, width] = [Floats::<S>::LEN, tile_width::<S>()];
        let plane = rows * columns.next_multiple_of(width);
        let mut values = vec![0.0; PLANES * plane];
        for row in 0..rows {
            let mut first = 0;
            while first < columns {
                let filled = n.min(columns - first);
                let mut taps = [splat(simd, 0.0); TAPS];
                let mut tap = 0;
                while tap < TAPS {
                    let begin = (tap * rows + row) * columns + first;
                    taps[tap] = load_part(simd, &weights[begin..begin + filled]);
                    tap += 1;
                }
                let products = transform_weights(simd, &taps);
                let mut p = 0;
                while p < PLANES {
                    let of_block = reads_below(p);
                    if of_block || row < everywhere {
                        let rows = if of_block { rows } else { everywhere };
                        let begin = (first / width * rows + row) * width + first % width;
                        products[p].store_slice(&mut values[p * plane + begin..][..n]);
                    }
                    p += 1;
                }
                first += n;
            }
        }
        Self { values, plane }
    }

    #[inline(always)]
    pub(super) fn plane(&self, p: usize) -> Panels<'_> {
        Panels(&self.values[p * self.plane..][..self.plane])
    }
}

/// `[27, channels out, channels in]`.
pub(super) fn transposed_taps(weights: &[f32], layer: Layer<'_>) -> Vec<f32> {
    let [rows, columns] = [layer.channels(), layer.channels_out];
    let taps = weights.chunks_exact(rows * columns);
    taps.map(|tap| transposed(tap, rows, columns)).collect::<Vec<_>>().concat()
}

#[inline(always)]
fn transform_weights<S: Simd>(simd: S, taps: &[Floats<S>; TAPS]) -> [Floats<S>; PLANES] {
    let zero = splat(simd, 0.0);
    let (mut rows, mut layers, mut products) = ([zero; 36], [zero; 48], [zero; PLANES]);
    let mut i = 0;
    while i < 9 {
        [rows[4 * i], rows[4 * i + 1], rows[4 * i + 2], rows[4 * i + 3]] =
            weights::<S>([taps[3 * i], taps[3 * i + 1], taps[3 * i + 2]]);
        i += 1;
    }
    let mut i = 0;
    while i < 12 {
        let from = i / 4 * 12 + i % 4;
        let first = i / 4 * 16 + i % 4;
        [layers[first], layers[first + 4], layers[first + 8], layers[first + 12]] =
            weights::<S>([rows[from], rows[from + 4], rows[from + 8]]);
        i += 1;
    }
    let mut i = 0;
    while i < 16 {
        [products[i], products[i + 16], products[i + 32], products[i + 48]] =
            weights::<S>([layers[i], layers[i + 16], layers[i + 32]]);
        i += 1;
    }
    products
}

/// `Gᵀ U' G`: the gradients of the weights.
#[inline(always)]
pub(super) fn weight_gradients<S: Simd>(simd: S, layer: Layer<'_>, du: &[f32]) -> Vec<f32> {
    let n = Floats::<S>::LEN;
    let size = layer.channels() * layer.channels_out;
    let mut dw = vec![0.0; TAPS * size];
    let mut first = 0;
    while first < size {
        let filled = n.min(size - first);
        let mut products = [splat(simd, 0.0); PLANES];
        let mut p = 0;
        while p < PLANES {
            let begin = p * size + first;
            products[p] = load_part(simd, &du[begin..begin + filled]);
            p += 1;
        }
        let taps = transform_weight_gradients(simd, &products);
        let mut tap = 0;
        while tap < TAPS {
            let begin = tap * size + first;
            store_part(simd, taps[tap], &mut dw[begin..begin + filled]);
            tap += 1;
        }
        first += n;
    }
    dw
}

#[inline(always)]
fn transform_weight_gradients<S: Simd>(
    simd: S,
    products: &[Floats<S>; PLANES],
) -> [Floats<S>; TAPS] {
    let zero = splat(simd, 0.0);
    let (mut rows, mut layers, mut taps) = ([zero; 36], [zero; 48], [zero; TAPS]);
    let mut i = 0;
    while i < 16 {
        let line = [products[i], products[i + 16], products[i + 32], products[i + 48]];
        [layers[i], layers[i + 16], layers[i + 32]] = weight_gradients_along::<S>(line);
        i += 1;
    }
    let mut i = 0;
    while i < 12 {
        let from = i / 4 * 16 + i % 4;
        let first = i / 4 * 12 + i % 4;
        let line = [layers[from], layers[from + 4], layers[from + 8], layers[from + 12]];
        [rows[first], rows[first + 4], rows[first + 8]] = weight_gradients_along::<S>(line);
        i += 1;
    }
    let mut i = 0;
    while i < 9 {
        let line = [rows[4 * i], rows[4 * i + 1], rows[4 * i + 2], rows[4 * i + 3]];
        [taps[3 * i], taps[3 * i + 1], taps[3 * i + 2]] = weight_gradients_along::<S>(line);
        i += 1;
    }
    taps
}
