//! The channels of blocks of 2³ cells: the nearest cells of a grid of half the side.
//!
//! Along an axis a tile reads cells of the blocks `a, b, b, c`, of which `Bᵀ` makes
//! `a - b, 2 b, 0, b - c`: 27 products come from 27 blocks.

use super::super::matmul::{load_part, store_part};
use super::super::tiles::NOWHERE;
use super::cells::{load_from, row_of};
use super::{Products, Slab};
use crate::lanes::{Floats, splat};

use fearless_simd::{Simd, SimdBase as _};

/// Of four cells along an axis one of each block, and of four products those that are not zero.
const PLACES: [usize; 3] = [0, 1, 3];
/// Blocks around a tile, and products of a block's channels.
const NEAR: usize = 27;

/// Whether a product has channels of blocks.
#[inline(always)]
pub(super) const fn reads_below(plane: usize) -> bool {
    plane % 4 != 2 && plane / 4 % 4 != 2 && plane / 16 != 2
}

/// The cell, or product, of 4³ that stands for one of 3³.
#[inline(always)]
const fn place(i: usize) -> usize {
    (PLACES[i / 9] * 4 + PLACES[i / 3 % 3]) * 4 + PLACES[i % 3]
}

/// Rows of the blocks around a tile: of eight successive rows each.
#[inline(always)]
fn blocks(slab: &Slab<'_>, tile: usize) -> [u32; NEAR] {
    let rows = &slab.layer.tiles.inputs[tile];
    core::array::from_fn(|i| match rows[place(i)] {
        NOWHERE => NOWHERE,
        row => row / 8,
    })
}

/// Applies `$along` to all lines of 3³ vectors along each axis.
macro_rules! along_all {
    ($cells:ident, $along:path) => {
        let mut step = 1;
        while step < NEAR {
            let mut i = 0;
            while i < NEAR {
                if i / step % 3 == 0 {
                    let line = [$cells[i], $cells[i + step], $cells[i + 2 * step]];
                    [$cells[i], $cells[i + step], $cells[i + 2 * step]] = $along(line);
                }
                i += 1;
            }
            step *= 3;
        }
    };
}

/// The products of blocks, behind those of cells.
#[inline(always)]
pub(super) fn read_below<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    below: &[f32],
    products: Products,
    v: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = slab.layer.channels_below;
    if channels == 0 {
        return;
    }
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact_mut(products.tile)) {
        let rows = blocks(slab, tile.tile);
        let near: [&[f32]; NEAR] =
            core::array::from_fn(|i| row_of(below, channels, tile.base / 8, rows[i]));
        let mut first = 0;
        while first < channels {
            let filled = n.min(channels - first);
            let mut cells = [splat(simd, 0.0); NEAR];
            let mut i = 0;
            while i < NEAR {
                cells[i] = load_from(simd, near[i], first, filled);
                i += 1;
            }
            along_all!(cells, inputs::<S>);
            let mut i = 0;
            while i < NEAR {
                let begin = place(i) * products.plane + slab.layer.channels_in + first;
                cells[i].store_slice(&mut v[begin..][..n]);
                i += 1;
            }
            first += n;
        }
    }
}

/// Adds the gradients of all products of blocks to theirs.
#[inline(always)]
pub(super) fn add_to_below<S: Simd>(
    simd: S,
    slab: &Slab<'_>,
    products: Products,
    v: &[f32],
    dbelow: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let channels = slab.layer.channels_below;
    if channels == 0 {
        return;
    }
    for (tile, v) in slab.tiles.iter().zip(v.chunks_exact(products.tile)) {
        let rows = blocks(slab, tile.tile);
        let mut first = 0;
        while first < channels {
            let filled = n.min(channels - first);
            let mut cells = [splat(simd, 0.0); NEAR];
            let mut i = 0;
            while i < NEAR {
                let begin = place(i) * products.plane + slab.layer.channels_in + first;
                cells[i] = Floats::<S>::from_slice(simd, &v[begin..][..n]);
                i += 1;
            }
            along_all!(cells, input_gradients::<S>);
            let mut i = 0;
            while i < NEAR {
                if rows[i] != NOWHERE {
                    let begin = (tile.base / 8 + rows[i] as usize) * channels + first;
                    let block = &mut dbelow[begin..begin + filled];
                    store_part(simd, load_part(simd, block) + cells[i], block);
                }
                i += 1;
            }
            first += n;
        }
    }
}

/// `Bᵀ` along one axis.
#[inline(always)]
fn inputs<S: Simd>([a, b, c]: [Floats<S>; 3]) -> [Floats<S>; 3] {
    [a - b, b + b, b - c]
}

/// `B` along one axis.
#[inline(always)]
fn input_gradients<S: Simd>([a, b, c]: [Floats<S>; 3]) -> [Floats<S>; 3] {
    [a, b + b - a + c, -c]
}
