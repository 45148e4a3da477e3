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
//!
//! A cell may also have the channels of the block of 2³ cells that it lies in, those of the nearest
//! cell of a grid of half the side. Of the 64 products of these only 27 are not zero: [`below`].

mod below;
mod cells;
mod weights;

use super::dense::{LayerGradients, before_activation, sum_of_rows};
use super::matmul::{Activation, Matrix, Store, accumulate_into, multiply_panels};
use super::tiles::Tiles;
use crate::in_order::each_with_scratch;
use crate::lanes::Floats;
use below::{add_to_below, read_below, reads_below};
use cells::{add_to_inputs, read_outputs, read_tiles, write_outputs};
use weights::{TransformedWeights, transposed_taps, weight_gradients};

use fearless_simd::{Level, Simd, SimdBase as _, dispatch};

/// Products of a tile.
const PLANES: usize = 64;
/// Weights of a kernel.
const TAPS: usize = 27;
/// Numbers of a slab of `V` or `M`, about, so that both stay in the second cache of a core: 2 to 8
/// times as many took as long.
const SLAB_NUMBERS: usize = 1 << 15;
/// The same for gradients: those of the transformed weights are read and written once a slab.
const GRADIENT_SLAB_NUMBERS: usize = 1 << 18;
/// Numbers between tiles: a line, so that rows of a plane do not share a place in the first cache.
const GAP: usize = 16;
/// Tiles of a slab are a multiple: whole register tiles of any vectors.
const WHOLE: usize = 12;
/// Below as many multiplications, some tenths of a millisecond, all is done by the thread that asks.
const FEW_PRODUCTS: usize = 1 << 24;

/// Sizes of a layer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layer<'a> {
    pub(crate) tiles: &'a Tiles,
    /// Channels of each cell.
    pub(crate) channels_in: usize,
    /// Channels of each block of eight successive rows; without any, the order of rows is free.
    pub(crate) channels_below: usize,
    pub(crate) channels_out: usize,
    pub(crate) activation: Activation,
}

impl<'a> Layer<'a> {
    fn n_samples(&self, x: &[f32]) -> usize {
        let n_numbers = self.tiles.n_cells * self.channels_in;
        assert!(x.len().is_multiple_of(n_numbers), "whole samples of {n_numbers} numbers");
        x.len() / n_numbers
    }

    /// Channels of a cell and of its block.
    const fn channels(&self) -> usize {
        self.channels_in + self.channels_below
    }

    fn check(&self, [x, below]: [&[f32]; 2], weights: &[f32]) {
        assert_eq!(weights.len(), TAPS * self.channels() * self.channels_out, "27 taps");
        let n_blocks = x.len() / self.channels_in / 8;
        assert_eq!(below.len(), n_blocks * self.channels_below, "a row for each block");
        let is_whole = self.channels_below == 0 || self.channels_in.is_multiple_of(16);
        assert!(is_whole, "the channels of a block follow whole vectors of others");
    }

    /// Tiles of a slab, at most, unless a group has more.
    fn slab_tiles(&self, numbers: usize) -> usize {
        let channels = self.channels().max(self.channels_out).next_multiple_of(16);
        (numbers / (PLANES * channels)).clamp(WHOLE, 8 * WHOLE) / WHOLE * WHOLE
    }

    /// All tiles of `n_samples` in slabs of successive rows and about as many numbers.
    fn slabs(self, n_samples: usize, numbers: usize) -> Vec<Slab<'a>> {
        let mut slabs: Vec<Slab<'_>> = Vec::new();
        let most = self.slab_tiles(numbers);
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
                        slabs.push(Slab { layer: self, tiles: tiles.collect(), begin, end });
                    }
                }
            }
        }
        slabs
    }
}

/// Tiles that are computed together, and the rows that they compute.
#[derive(Debug)]
struct Slab<'a> {
    layer: Layer<'a>,
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
/// - `x`: `[samples, cells, channels_in]`, `below`: `[samples, cells / 8, channels_below]`
/// - `weights`: `[27, channels_in + channels_below, channels_out]`, x fastest among the taps
/// - output: `[samples, cells, channels_out]`
pub(crate) fn forward(
    level: Level,
    layer: Layer<'_>,
    [x, below]: [&[f32]; 2],
    weights: &[f32],
    bias: &[f32],
) -> Vec<f32> {
    let n_samples = layer.n_samples(x);
    layer.check([x, below], weights);
    assert_eq!(bias.len(), layer.channels_out, "a bias for each channel");
    let mut y = vec![0.0; n_samples * layer.tiles.n_cells * layer.channels_out];
    let u = dispatch!(level, simd => {
        let channels = [layer.channels(), layer.channels_out];
        TransformedWeights::new(simd, weights, channels, layer.channels_in)
    });
    let mut rest = &mut y[..];
    let slabs = layer.slabs(n_samples, SLAB_NUMBERS).into_iter().map(|slab| {
        let (rows, after) =
            core::mem::take(&mut rest).split_at_mut((slab.end - slab.begin) * layer.channels_out);
        rest = after;
        (slab, rows)
    });
    let compute = |scratch: &mut Scratch, (slab, rows): (Slab<'_>, &mut [f32])| {
        dispatch!(level, simd => forward_slab(simd, &slab, [x, below, bias], &u, scratch, rows));
    };
    let n_products = n_samples * layer.tiles.inputs.len() * PLANES;
    if n_products * layer.channels() * layer.channels_out < FEW_PRODUCTS {
        let mut scratch = Scratch::default();
        slabs.for_each(|slab| compute(&mut scratch, slab));
    } else {
        each_with_scratch(slabs.collect(), Scratch::default, compute);
    }
    y
}

/// The gradients that belong to `dy`, that of the output `y`; the last is that of `below`, if those
/// of the input are wanted.
pub(crate) fn backward(
    level: Level,
    layer: Layer<'_>,
    [x, below, weights, y, dy]: [&[f32]; 5],
    with_x: bool,
) -> (LayerGradients, Option<Vec<f32>>) {
    let n_samples = layer.n_samples(x);
    layer.check([x, below], weights);
    assert_eq!(dy.len(), n_samples * layer.tiles.n_cells * layer.channels_out, "all outputs");
    let sums = before_activation(layer.activation, y, dy);
    let slabs = layer.slabs(n_samples, GRADIENT_SLAB_NUMBERS);
    dispatch!(level, simd => {
        let mut to_inputs = with_x.then(|| {
            let weights = transposed_taps(weights, layer);
            let channels = [layer.channels_out, layer.channels()];
            let u = TransformedWeights::new(simd, &weights, channels, layer.channels_out);
            (u, [vec![0.0; x.len()], vec![0.0; below.len()]])
        });
        let mut du = vec![0.0; PLANES * layer.channels() * layer.channels_out];
        let mut scratch = Scratch::default();
        for slab in &slabs {
            let to_inputs = to_inputs.as_mut().map(|(u, to)| (&*u, to));
            backward_slab(simd, slab, [x, below, &sums], &mut scratch, &mut du, to_inputs);
        }
        let [dx, dbelow] = to_inputs.map_or([None, None], |(_, to)| to.map(Some));
        let weights = weight_gradients(simd, layer, &du);
        let bias = sum_of_rows(&sums, layer.channels_out);
        (LayerGradients { x: dx, weights, bias }, dbelow)
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
    /// Those that all planes have: not those of a block.
    everywhere: usize,
    /// Distance of the planes.
    plane: usize,
    /// Distance of the tiles.
    tile: usize,
}

impl Products {
    #[inline(always)]
    fn new<S: Simd>(_: S, n_tiles: usize, channels: usize, everywhere: usize) -> Self {
        let plane = channels.next_multiple_of(Floats::<S>::LEN);
        Self { n_tiles, channels, everywhere, plane, tile: PLANES * plane + GAP }
    }

    #[inline(always)]
    fn grow(&self, memory: &mut Vec<f32>) {
        if memory.len() < self.n_tiles * self.tile {
            memory.resize(self.n_tiles * self.tile, 0.0);
        }
    }

    #[inline(always)]
    const fn channels_of(&self, plane: usize) -> usize {
        if reads_below(plane) { self.channels } else { self.everywhere }
    }

    /// A row for each tile.
    #[inline(always)]
    fn of_plane<'a>(&self, memory: &'a [f32], plane: usize) -> Matrix<'a> {
        Matrix {
            values: &memory[plane * self.plane..],
            rows: self.n_tiles,
            columns: self.channels_of(plane),
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
            let store = Store::plain(self.channels_of(p), self.tile);
            multiply_panels(simd, a, u.plane(p), store, &mut memory[p * self.plane..]);
        }
    }
}

#[inline(always)]
fn forward_slab<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    [x, below, bias]: [&[f32]; 3],
    u: &TransformedWeights,
    scratch: &mut Scratch,
    y: &mut [f32],
) {
    let (layer, n_tiles) = (slab.layer, slab.tiles.len());
    let v = Products::new(simd, n_tiles, layer.channels(), layer.channels_in);
    let m = Products::new(simd, n_tiles, layer.channels_out, layer.channels_out);
    v.grow(&mut scratch.v);
    m.grow(&mut scratch.m);
    read_tiles(simd, slab, x, v, &mut scratch.v);
    read_below(simd, slab, below, v, &mut scratch.v);
    m.multiply(simd, (v, &scratch.v), u, &mut scratch.m);
    write_outputs(simd, slab, bias, m, &scratch.m, y);
}

#[inline(always)]
fn backward_slab<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    [x, below, dy]: [&[f32]; 3],
    scratch: &mut Scratch,
    du: &mut [f32],
    to_inputs: Option<(&TransformedWeights, &mut [Vec<f32>; 2])>,
) {
    let (layer, n_tiles) = (slab.layer, slab.tiles.len());
    let v = Products::new(simd, n_tiles, layer.channels(), layer.channels_in);
    let m = Products::new(simd, n_tiles, layer.channels_out, layer.channels_out);
    v.grow(&mut scratch.v);
    m.grow(&mut scratch.m);
    read_tiles(simd, slab, x, v, &mut scratch.v);
    read_below(simd, slab, below, v, &mut scratch.v);
    read_outputs(simd, slab, dy, m, &mut scratch.m);
    let size = layer.channels() * layer.channels_out;
    for p in 0..PLANES {
        let [left, right] = [v.of_plane(&scratch.v, p), m.of_plane(&scratch.m, p)];
        accumulate_into(simd, left, right, &mut du[p * size..(p + 1) * size]);
    }
    let Some((u, gradients)) = to_inputs else { return };
    let [dx, dbelow] = gradients;
    v.multiply(simd, (m, &scratch.m), u, &mut scratch.v);
    add_to_inputs(simd, slab, v, &mut scratch.v, dx);
    add_to_below(simd, slab, v, &scratch.v, dbelow);
}
