//! From cells to products and back: the maps `B` and `A` of tiles.

use super::super::matmul::{load_part, store_part};
use super::super::tiles::NOWHERE;
use super::{PLANES, Products, Slab};
use crate::lanes::{Floats, splat};

use fearless_simd::{Simd, SimdBase as _};

/// Applies `$along` to all lines of 4³ vectors `$plane` numbers apart, along the axis of `$step`.
macro_rules! along {
    ($simd:ident, $cells:ident, $plane:expr, $along:path, $step:literal) => {
        let mut outer = 0;
        while outer < PLANES {
            let mut i = outer;
            while i < outer + $step {
                let line = $along(load_line($simd, $cells, i, $step, $plane));
                store_line::<S>(line, $cells, i, $step, $plane);
                i += 1;
            }
            outer += 4 * $step;
        }
    };
}

/// Four vectors from plane `first` on, `step` planes apart.
#[inline(always)]
fn load_line<S: Simd>(
    simd: S,
    cells: &[f32],
    first: usize,
    step: usize,
    plane: usize,
) -> [Floats<S>; 4] {
    let n = Floats::<S>::LEN;
    let mut line = [splat(simd, 0.0); 4];
    let mut k = 0;
    while k < 4 {
        line[k] = Floats::<S>::from_slice(simd, &cells[(first + step * k) * plane..][..n]);
        k += 1;
    }
    line
}

/// Into four vectors from plane `first` on, `step` planes apart.
#[inline(always)]
fn store_line<S: Simd>(
    line: [Floats<S>; 4],
    cells: &mut [f32],
    first: usize,
    step: usize,
    plane: usize,
) {
    let n = Floats::<S>::LEN;
    let mut k = 0;
    while k < 4 {
        line[k].store_slice(&mut cells[(first + step * k) * plane..][..n]);
        k += 1;
    }
}

/// `V = Bᵀ x B` of all tiles.
#[inline(always)]
pub(super) fn read_tiles<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    x: &[f32],
    products: Products,
    v: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = slab.layer.channels_in;
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact_mut(products.tile)) {
        let rows = &slab.layer.tiles.inputs[tile.tile];
        // Slice by slice along x and y in registers, so that a row is looked up once.
        let mut slice = 0;
        while slice < PLANES {
            let near: [&[f32]; 16] =
                core::array::from_fn(|i| row_of(x, channels, tile.base, rows[slice + i]));
            let mut first = 0;
            while first < channels {
                let filled = n.min(channels - first);
                let mut cells = [splat(simd, 0.0); 16];
                let mut i = 0;
                while i < 16 {
                    cells[i] = load_from(simd, near[i], first, filled);
                    i += 1;
                }
                let mut i = 0;
                while i < 16 {
                    let line = inputs::<S>([cells[i], cells[i + 1], cells[i + 2], cells[i + 3]]);
                    [cells[i], cells[i + 1], cells[i + 2], cells[i + 3]] = line;
                    i += 4;
                }
                let mut i = 0;
                while i < 4 {
                    let line = inputs::<S>([cells[i], cells[i + 4], cells[i + 8], cells[i + 12]]);
                    let mut k = 0;
                    while k < 4 {
                        let place = (slice + i + 4 * k) * products.plane + first;
                        line[k].store_slice(&mut v[place..][..n]);
                        k += 1;
                    }
                    i += 1;
                }
                first += n;
            }
            slice += 16;
        }
        let mut first = 0;
        while first < channels {
            let cells = &mut v[first..];
            along!(simd, cells, products.plane, inputs::<S>, 16);
            first += n;
        }
    }
}

/// Adds `B V' Bᵀ` of all tiles to the cells that they read.
#[inline(always)]
pub(super) fn add_to_inputs<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    products: Products,
    v: &mut [f32],
    dx: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = slab.layer.channels_in;
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact_mut(products.tile)) {
        let mut first = 0;
        while first < channels {
            let cells = &mut v[first..];
            along!(simd, cells, products.plane, input_gradients::<S>, 16);
            first += n;
        }
        let rows = &slab.layer.tiles.inputs[tile.tile];
        let mut slice = 0;
        while slice < PLANES {
            let mut first = 0;
            while first < channels {
                let filled = n.min(channels - first);
                let mut cells = [splat(simd, 0.0); 16];
                let mut i = 0;
                while i < 4 {
                    let line = load_line(simd, &v[first..], slice + i, 4, products.plane);
                    [cells[i], cells[i + 4], cells[i + 8], cells[i + 12]] =
                        input_gradients::<S>(line);
                    i += 1;
                }
                let mut i = 0;
                while i < 16 {
                    let line = [cells[i], cells[i + 1], cells[i + 2], cells[i + 3]];
                    let line = input_gradients::<S>(line);
                    let mut k = 0;
                    while k < 4 {
                        let row = rows[slice + i + k];
                        if row != NOWHERE {
                            let begin = (tile.base + row as usize) * channels + first;
                            let cell = &mut dx[begin..begin + filled];
                            store_part(simd, load_part(simd, cell) + line[k], cell);
                        }
                        k += 1;
                    }
                    i += 4;
                }
                first += n;
            }
            slice += 16;
        }
    }
}

/// The channels of a row; nothing beyond the grid.
#[inline(always)]
pub(super) fn row_of(x: &[f32], channels: usize, base: usize, row: u32) -> &[f32] {
    if row == NOWHERE {
        return &[];
    }
    let begin = (base + row as usize) * channels;
    &x[begin..begin + channels]
}

/// A vector of channels of a row, zero beyond the grid.
#[inline(always)]
pub(super) fn load_from<S: Simd>(simd: S, row: &[f32], first: usize, filled: usize) -> Floats<S> {
    if row.is_empty() { splat(simd, 0.0) } else { load_part(simd, &row[first..first + filled]) }
}

/// `activation(Aᵀ M A + bias)` of all tiles into the rows of the slab.
#[inline(always)]
pub(super) fn write_outputs<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    bias: &[f32],
    products: Products,
    m: &[f32],
    y: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = products.channels;
    let zero = splat(simd, 0.0);
    let (mut rows, mut layers, mut sums) = ([zero; 32], [zero; 16], [zero; 8]);
    for (place, tile) in slab.tiles.iter().enumerate() {
        let cells = &slab.layer.tiles.outputs[tile.tile];
        let mut first = 0;
        while first < channels {
            let filled = n.min(channels - first);
            let m = &m[place * products.tile + first..];
            let mut i = 0;
            while i < 16 {
                let line = load_line(simd, m, 4 * i, 1, products.plane);
                [rows[2 * i], rows[2 * i + 1]] = outputs::<S>(line);
                i += 1;
            }
            let mut i = 0;
            while i < 8 {
                // Row i of layers of two columns.
                let [from, to] = [i / 2 * 8 + i % 2, i / 2 * 4 + i % 2];
                let line = [rows[from], rows[from + 2], rows[from + 4], rows[from + 6]];
                [layers[to], layers[to + 2]] = outputs::<S>(line);
                i += 1;
            }
            let mut i = 0;
            while i < 4 {
                let line = [layers[i], layers[i + 4], layers[i + 8], layers[i + 12]];
                [sums[i], sums[i + 4]] = outputs::<S>(line);
                i += 1;
            }
            let bias = load_part(simd, &bias[first..first + filled]);
            let mut i = 0;
            while i < 8 {
                if cells[i] != NOWHERE {
                    let activated = slab.layer.activation.apply(simd, sums[i] + bias);
                    let row = tile.base + cells[i] as usize - slab.begin;
                    let begin = row * channels + first;
                    store_part(simd, activated, &mut y[begin..begin + filled]);
                }
                i += 1;
            }
            first += n;
        }
    }
}

/// `M' = A y' Aᵀ` of all tiles.
#[inline(always)]
pub(super) fn read_outputs<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    dy: &[f32],
    products: Products,
    m: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = products.channels;
    let zero = splat(simd, 0.0);
    let (mut layers, mut rows) = ([zero; 16], [zero; 32]);
    for (place, tile) in slab.tiles.iter().enumerate() {
        let cells = &slab.layer.tiles.outputs[tile.tile];
        let mut first = 0;
        while first < channels {
            let filled = n.min(channels - first);
            let mut i = 0;
            while i < 4 {
                let line = [
                    load_from(simd, row_of(dy, channels, tile.base, cells[i]), first, filled),
                    load_from(simd, row_of(dy, channels, tile.base, cells[i + 4]), first, filled),
                ];
                [layers[i], layers[i + 4], layers[i + 8], layers[i + 12]] =
                    output_gradients::<S>(line);
                i += 1;
            }
            let mut i = 0;
            while i < 8 {
                let [from, to] = [i / 2 * 4 + i % 2, i / 2 * 8 + i % 2];
                [rows[to], rows[to + 2], rows[to + 4], rows[to + 6]] =
                    output_gradients::<S>([layers[from], layers[from + 2]]);
                i += 1;
            }
            let m = &mut m[place * products.tile + first..];
            let mut i = 0;
            while i < 16 {
                let line = output_gradients::<S>([rows[2 * i], rows[2 * i + 1]]);
                store_line::<S>(line, m, 4 * i, 1, products.plane);
                i += 1;
            }
            first += n;
        }
    }
}

/// `Bᵀ` along one axis: inputs to products.
#[inline(always)]
fn inputs<S: Simd>([a, b, c, d]: [Floats<S>; 4]) -> [Floats<S>; 4] {
    [a - c, b + c, c - b, b - d]
}

/// `B` along one axis.
#[inline(always)]
fn input_gradients<S: Simd>([a, b, c, d]: [Floats<S>; 4]) -> [Floats<S>; 4] {
    [a, b - c + d, b + c - a, -d]
}

/// `Aᵀ` along one axis: products to outputs.
#[inline(always)]
fn outputs<S: Simd>([a, b, c, d]: [Floats<S>; 4]) -> [Floats<S>; 2] {
    [a + b + c, b - c - d]
}

/// `A` along one axis.
#[inline(always)]
fn output_gradients<S: Simd>([a, b]: [Floats<S>; 2]) -> [Floats<S>; 4] {
    [a, a + b, a - b, -b]
}
