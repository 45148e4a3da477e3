//! 3³ convolution by Winograd's algorithm F(2, 3) in three dimensions (Lavin and Gray 2016).
//!
//! 2³ outputs come from 4³ inputs by 64 products where the sum has 216. Each is a product of
//! matrices over the channels, for all tiles at once. With `Bᵀ`, `G` and `Aᵀ` along each axis:
//!
//! ```text
//! V = Bᵀ x B    U = G w Gᵀ    M_p = V_p U_p, p of 64    y = Aᵀ M A + bias
//! ```
//!
//! The gradients are the adjoints of the same maps, so that they hold for every padding and order
//! of cells: `M' = A y' Aᵀ` serves both `U'_p = V_pᵀ M'_p` and `V'_p = M'_p U_pᵀ`. `V` is computed
//! again for them: to write and read it takes longer.

use super::matmul::{
    Activation, Matrix, Panels, Store, accumulate_into, load_part, multiply_panels, store_part,
    tile_width,
};
use super::tiles::{NOWHERE, Tiles};
use crate::in_order::each_with_scratch;
use crate::lanes::{Floats, splat};

use fearless_simd::{Level, Simd, SimdBase as _, dispatch};

/// Products of a tile.
const PLANES: usize = 64;
/// Weights of a kernel.
const TAPS: usize = 27;
/// Numbers of a slab of `V` or `M`, about: both stay in the second cache of a core.
const SLAB_NUMBERS: usize = 1 << 15;
/// Numbers between tiles: a line, so that rows of a plane do not share a place in the first cache.
const GAP: usize = 16;

/// Below as many multiplications, a second thread starts too late.
const FEW_PRODUCTS: usize = 1 << 24;

/// Sizes of a layer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layer<'a> {
    pub(crate) tiles: &'a Tiles,
    pub(crate) channels_in: usize,
    pub(crate) channels_out: usize,
    pub(crate) activation: Activation,
}

impl Layer<'_> {
    fn n_samples(&self, x: &[f32]) -> usize {
        let n_numbers = self.tiles.n_cells * self.channels_in;
        assert!(x.len().is_multiple_of(n_numbers), "whole samples of {n_numbers} numbers");
        x.len() / n_numbers
    }

    fn check_weights(&self, weights: &[f32]) {
        assert_eq!(weights.len(), TAPS * self.channels_in * self.channels_out, "27 taps");
    }

    /// Tiles of a slab, at most, unless a group has more.
    fn slab_tiles(&self) -> usize {
        let channels = self.channels_in.max(self.channels_out).next_multiple_of(16);
        (SLAB_NUMBERS / (PLANES * channels)).clamp(12, 96) / 12 * 12
    }

    /// All tiles of `n_samples` in slabs of successive rows.
    fn slabs(&self, n_samples: usize) -> Vec<Slab> {
        let mut slabs: Vec<Slab> = Vec::new();
        let most = self.slab_tiles();
        for sample in 0..n_samples {
            let base = sample * self.tiles.n_cells;
            for group in &self.tiles.groups {
                let end = base + group.rows.end;
                let tiles = group.tiles.clone().map(|tile| Tile { base, tile });
                match slabs.last_mut() {
                    Some(slab) if slab.tiles.len() + tiles.len() <= most => {
                        slab.tiles.extend(tiles);
                        slab.end = end;
                    }
                    _ => {
                        let begin = base + group.rows.start;
                        slabs.push(Slab { tiles: tiles.collect(), begin, end });
                    }
                }
            }
        }
        slabs
    }
}

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

/// Tiles that are computed together, and the rows that they compute.
#[derive(Debug)]
struct Slab {
    tiles: Vec<Tile>,
    begin: usize,
    end: usize,
}

/// A tile of a sample whose rows begin at `base`.
#[derive(Debug, Clone, Copy)]
struct Tile {
    base: usize,
    tile: usize,
}

/// `y = activation(conv(x) + bias)`.
///
/// # Shapes
///
/// - `x`: `[samples, cells, channels_in]`
/// - `weights`: `[27, channels_in, channels_out]`, x fastest among the taps
/// - output: `[samples, cells, channels_out]`
pub(crate) fn forward(
    level: Level,
    layer: Layer<'_>,
    x: &[f32],
    weights: &[f32],
    bias: &[f32],
) -> Vec<f32> {
    let n_samples = layer.n_samples(x);
    layer.check_weights(weights);
    assert_eq!(bias.len(), layer.channels_out, "a bias for each channel");
    let mut y = vec![0.0; n_samples * layer.tiles.n_cells * layer.channels_out];
    let u = dispatch!(level, simd => {
        TransformedWeights::new(simd, weights, [layer.channels_in, layer.channels_out])
    });
    let mut rest = &mut y[..];
    let slabs = layer.slabs(n_samples).into_iter().map(|slab| {
        let (rows, after) =
            core::mem::take(&mut rest).split_at_mut((slab.end - slab.begin) * layer.channels_out);
        rest = after;
        (slab, rows)
    });
    let compute = |scratch: &mut Scratch, (slab, rows): (Slab, &mut [f32])| {
        dispatch!(level, simd => forward_slab(simd, layer, &slab, [x, bias], &u, scratch, rows));
    };
    let n_products = n_samples * layer.tiles.inputs.len() * PLANES;
    if n_products * layer.channels_in * layer.channels_out < FEW_PRODUCTS {
        let mut scratch = Scratch::default();
        slabs.for_each(|slab| compute(&mut scratch, slab));
    } else {
        each_with_scratch(slabs.collect(), Scratch::default, compute);
    }
    y
}

/// The gradients of a layer.
#[derive(Debug)]
pub(crate) struct Gradients {
    /// None where it was not asked for.
    pub(crate) x: Option<Vec<f32>>,
    pub(crate) weights: Vec<f32>,
}

/// The gradients that belong to `dy`, that of the sum before the activation.
pub(crate) fn backward(
    level: Level,
    layer: Layer<'_>,
    [x, weights, dy]: [&[f32]; 3],
    with_x: bool,
) -> Gradients {
    let n_samples = layer.n_samples(x);
    layer.check_weights(weights);
    assert_eq!(dy.len(), n_samples * layer.tiles.n_cells * layer.channels_out, "all outputs");
    let slabs = layer.slabs(n_samples);
    dispatch!(level, simd => {
        let mut to_inputs = with_x.then(|| {
            let weights = transposed_taps(weights, layer);
            let channels = [layer.channels_out, layer.channels_in];
            (TransformedWeights::new(simd, &weights, channels), vec![0.0; x.len()])
        });
        let mut du = vec![0.0; PLANES * layer.channels_in * layer.channels_out];
        let mut scratch = Scratch::default();
        for slab in &slabs {
            let to_inputs = to_inputs.as_mut().map(|(u, dx)| (&*u, &mut dx[..]));
            backward_slab(simd, layer, slab, [x, dy], &mut scratch, &mut du, to_inputs);
        }
        Gradients { x: to_inputs.map(|(_, dx)| dx), weights: weight_gradients(simd, layer, &du) }
    })
}

/// Memory of one slab after the other.
#[derive(Debug, Default)]
struct Scratch {
    v: Vec<f32>,
    m: Vec<f32>,
}

/// Where the products of tiles stand: `[tile][plane][channel]`, channels in whole vectors.
#[derive(Debug, Clone, Copy)]
struct Products {
    n_tiles: usize,
    channels: usize,
    /// Distance of the planes.
    plane: usize,
    /// Distance of the tiles.
    tile: usize,
}

impl Products {
    #[inline(always)]
    fn new<S: Simd>(_: S, n_tiles: usize, channels: usize) -> Self {
        let plane = channels.next_multiple_of(Floats::<S>::LEN);
        Self { n_tiles, channels, plane, tile: PLANES * plane + GAP }
    }

    #[inline(always)]
    fn grow(&self, memory: &mut Vec<f32>) {
        if memory.len() < self.n_tiles * self.tile {
            memory.resize(self.n_tiles * self.tile, 0.0);
        }
    }

    /// A row for each tile.
    #[inline(always)]
    fn of_plane<'a>(&self, memory: &'a [f32], plane: usize) -> Matrix<'a> {
        Matrix {
            values: &memory[plane * self.plane..],
            rows: self.n_tiles,
            columns: self.channels,
            stride: self.tile,
        }
    }

    /// `left` times the panels of a plane, for every plane.
    #[inline(always)]
    fn multiply<S: Simd>(
        &self,
        simd: S,
        left: (Self, &[f32]),
        u: &TransformedWeights,
        memory: &mut [f32],
    ) {
        for p in 0..PLANES {
            let a = left.0.of_plane(left.1, p);
            let store = Store::plain(self.channels, self.tile);
            multiply_panels(simd, a, u.plane(p), store, &mut memory[p * self.plane..]);
        }
    }
}

#[inline(always)]
fn forward_slab<S: Simd>(
    simd: S,
    layer: Layer<'_>,
    slab: &Slab,
    [x, bias]: [&[f32]; 2],
    u: &TransformedWeights,
    scratch: &mut Scratch,
    y: &mut [f32],
) {
    let n_tiles = slab.tiles.len();
    let v = Products::new(simd, n_tiles, layer.channels_in);
    let m = Products::new(simd, n_tiles, layer.channels_out);
    v.grow(&mut scratch.v);
    m.grow(&mut scratch.m);
    read_tiles(simd, layer.tiles, slab, x, v, &mut scratch.v);
    m.multiply(simd, (v, &scratch.v), u, &mut scratch.m);
    write_outputs(simd, layer, slab, bias, m, &scratch.m, y);
}

#[inline(always)]
fn backward_slab<S: Simd>(
    simd: S,
    layer: Layer<'_>,
    slab: &Slab,
    [x, dy]: [&[f32]; 2],
    scratch: &mut Scratch,
    du: &mut [f32],
    to_inputs: Option<(&TransformedWeights, &mut [f32])>,
) {
    let n_tiles = slab.tiles.len();
    let v = Products::new(simd, n_tiles, layer.channels_in);
    let m = Products::new(simd, n_tiles, layer.channels_out);
    v.grow(&mut scratch.v);
    m.grow(&mut scratch.m);
    read_tiles(simd, layer.tiles, slab, x, v, &mut scratch.v);
    read_outputs(simd, layer.tiles, slab, dy, m, &mut scratch.m);
    let size = layer.channels_in * layer.channels_out;
    for p in 0..PLANES {
        let [left, right] = [v.of_plane(&scratch.v, p), m.of_plane(&scratch.m, p)];
        accumulate_into(simd, left, right, &mut du[p * size..(p + 1) * size]);
    }
    let Some((u, dx)) = to_inputs else { return };
    v.multiply(simd, (m, &scratch.m), u, &mut scratch.v);
    add_to_inputs(simd, layer.tiles, slab, v, &mut scratch.v, dx);
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
fn read_tiles<S: Simd>(
    simd: S,
    tiles: &Tiles,
    slab: &Slab,
    x: &[f32],
    products: Products,
    v: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = products.channels;
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact_mut(products.tile)) {
        let rows = &tiles.inputs[tile.tile];
        // Along x for all channels, so that a row is looked up once.
        let mut i = 0;
        while i < PLANES {
            let line = [
                row_of(x, channels, tile.base, rows[i]),
                row_of(x, channels, tile.base, rows[i + 1]),
                row_of(x, channels, tile.base, rows[i + 2]),
                row_of(x, channels, tile.base, rows[i + 3]),
            ];
            let mut first = 0;
            while first < channels {
                let filled = n.min(channels - first);
                let cells = inputs::<S>([
                    load_from(simd, line[0], first, filled),
                    load_from(simd, line[1], first, filled),
                    load_from(simd, line[2], first, filled),
                    load_from(simd, line[3], first, filled),
                ]);
                store_line::<S>(cells, &mut v[first..], i, 1, products.plane);
                first += n;
            }
            i += 4;
        }
        let mut first = 0;
        while first < channels {
            let cells = &mut v[first..];
            along!(simd, cells, products.plane, inputs::<S>, 4);
            along!(simd, cells, products.plane, inputs::<S>, 16);
            first += n;
        }
    }
}

/// Adds `B V' Bᵀ` of all tiles to the cells that they read.
#[inline(always)]
fn add_to_inputs<S: Simd>(
    simd: S,
    tiles: &Tiles,
    slab: &Slab,
    products: Products,
    v: &mut [f32],
    dx: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = products.channels;
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact_mut(products.tile)) {
        let mut first = 0;
        while first < channels {
            let cells = &mut v[first..];
            along!(simd, cells, products.plane, input_gradients::<S>, 16);
            along!(simd, cells, products.plane, input_gradients::<S>, 4);
            along!(simd, cells, products.plane, input_gradients::<S>, 1);
            first += n;
        }
        let rows = &tiles.inputs[tile.tile];
        let mut i = 0;
        while i < PLANES {
            if rows[i] != NOWHERE {
                let begin = (tile.base + rows[i] as usize) * channels;
                let row = &mut dx[begin..begin + channels];
                let mut first = 0;
                while first < channels {
                    let filled = n.min(channels - first);
                    let v = &v[i * products.plane + first..][..n];
                    let cell = &mut row[first..first + filled];
                    let sum = load_part(simd, cell) + Floats::<S>::from_slice(simd, v);
                    store_part(simd, sum, cell);
                    first += n;
                }
            }
            i += 1;
        }
    }
}

/// The channels of a row; nothing beyond the grid.
#[inline(always)]
fn row_of(x: &[f32], channels: usize, base: usize, row: u32) -> &[f32] {
    if row == NOWHERE {
        return &[];
    }
    let begin = (base + row as usize) * channels;
    &x[begin..begin + channels]
}

/// A vector of channels of a row, zero beyond the grid.
#[inline(always)]
fn load_from<S: Simd>(simd: S, row: &[f32], first: usize, filled: usize) -> Floats<S> {
    if row.is_empty() { splat(simd, 0.0) } else { load_part(simd, &row[first..first + filled]) }
}

/// `activation(Aᵀ M A + bias)` of all tiles into the rows of the slab.
#[inline(always)]
fn write_outputs<S: Simd>(
    simd: S,
    layer: Layer<'_>,
    slab: &Slab,
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
        let cells = &layer.tiles.outputs[tile.tile];
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
                    let activated = layer.activation.apply(simd, sums[i] + bias);
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
fn read_outputs<S: Simd>(
    simd: S,
    tiles: &Tiles,
    slab: &Slab,
    dy: &[f32],
    products: Products,
    m: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = products.channels;
    let zero = splat(simd, 0.0);
    let (mut layers, mut rows) = ([zero; 16], [zero; 32]);
    for (place, tile) in slab.tiles.iter().enumerate() {
        let cells = &tiles.outputs[tile.tile];
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
struct TransformedWeights {
    values: Vec<f32>,
    /// Numbers of a plane.
    plane: usize,
}

impl TransformedWeights {
    /// From `[27, rows, columns]`.
    #[inline(always)]
    fn new<S: Simd>(simd: S, weights: &[f32], [rows, columns]: [usize; 2]) -> Self {
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
                let begin = (first / width * rows + row) * width + first % width;
                let mut p = 0;
                while p < PLANES {
                    products[p].store_slice(&mut values[p * plane + begin..][..n]);
                    p += 1;
                }
                first += n;
            }
        }
        Self { values, plane }
    }

    #[inline(always)]
    fn plane(&self, p: usize) -> Panels<'_> {
        Panels(&self.values[p * self.plane..][..self.plane])
    }
}

/// `[27, channels out, channels in]`.
fn transposed_taps(weights: &[f32], layer: Layer<'_>) -> Vec<f32> {
    let [rows, columns] = [layer.channels_in, layer.channels_out];
    let mut result = vec![0.0; weights.len()];
    let taps = weights.chunks_exact(rows * columns).zip(result.chunks_exact_mut(rows * columns));
    for (from, to) in taps {
        for (row, values) in from.chunks_exact(columns).enumerate() {
            for (column, &value) in values.iter().enumerate() {
                to[column * rows + row] = value;
            }
        }
    }
    result
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
fn weight_gradients<S: Simd>(simd: S, layer: Layer<'_>, du: &[f32]) -> Vec<f32> {
    let n = Floats::<S>::LEN;
    let size = layer.channels_in * layer.channels_out;
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
