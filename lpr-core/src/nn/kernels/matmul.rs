//! Products of matrices of any size, by register tiles.
//!
//! The right matrix is packed into panels as wide as a tile, the left one is read where it lies: the
//! networks here have few columns and many rows. Each number of the result is one sum over the
//! inner index in ascending order, whatever the tile and the number of rows, so that a row does not
//! depend on the rows beside it. Wider vectors may fuse multiplication and addition.

mod accumulate;
mod few_rows;

pub(super) use accumulate::{accumulate, accumulate_into};

use crate::lanes::{Floats, splat};
use few_rows::{FEW_ROWS, add_scaled_rows, multiply_few_rows};

use fearless_simd::{Level, Simd, SimdBase as _, SimdFloat as _, dispatch};

/// Columns of a register tile: those of the vectors that [`by_tile`] gives it.
#[inline(always)]
pub(super) const fn tile_width<S: Simd>() -> usize {
    2 * Floats::<S>::LEN
}

/// Calls a function generic over the rows and vectors of a register tile with as many as leave
/// registers for a row of the right matrix and one number of the left.
macro_rules! by_tile {
    ($function:ident::<$simd:ident>($($argument:expr),*)) => {
        match Floats::<$simd>::LEN {
            16.. => $function::<$simd, 12, 2>($($argument),*),
            8 => $function::<$simd, 6, 2>($($argument),*),
            // Without fused operations a product needs a register as well. In wasm 3 x 4 and 6 x 2
            // took a tenth longer, 2 x 4 a twentieth.
            _ => $function::<$simd, 4, 2>($($argument),*),
        }
    };
}
pub(super) use by_tile;

/// What becomes of a sum before it is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Activation {
    /// Nothing.
    Linear,
    /// `max(x, 0)`.
    Relu,
    /// `max(x, slope x)`, with a slope below 1.
    Leaky {
        /// Slope below zero.
        slope: f32,
    },
}

impl Activation {
    /// NaN stays NaN: `max` takes its second operand where either is not a number.
    #[inline(always)]
    pub(super) fn apply<S: Simd>(self, simd: S, x: Floats<S>) -> Floats<S> {
        match self {
            Self::Linear => x,
            Self::Relu => splat(simd, 0.0).max(x),
            Self::Leaky { slope } => (splat(simd, slope) * x).max(x),
        }
    }
}

/// A matrix whose rows lie `stride` apart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Matrix<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) stride: usize,
}

impl<'a> Matrix<'a> {
    /// A matrix without gaps between its rows.
    pub(crate) fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(values.len(), rows * columns, "values of a {rows} x {columns} matrix");
        Self { values, rows, columns, stride: columns }
    }

    /// Successive rows.
    fn part(self, first: usize, rows: usize) -> Self {
        Self { values: &self.values[first * self.stride..], rows, ..self }
    }

    #[inline(always)]
    fn row(&self, row: usize) -> &'a [f32] {
        &self.values[row * self.stride..row * self.stride + self.columns]
    }
}

/// `a b + bias`, activated, into the rows of `c` without gaps.
pub(crate) fn multiply(
    level: Level,
    a: Matrix<'_>,
    b: Matrix<'_>,
    bias: Option<&[f32]>,
    activation: Activation,
    c: &mut [f32],
) {
    assert_eq!(a.columns, b.rows, "columns of the left, rows of the right matrix");
    assert_eq!(c.len(), a.rows * b.columns, "a {} x {} result", a.rows, b.columns);
    dispatch!(level, simd => {
        let store = Store { columns: b.columns, stride: b.columns, bias, activation };
        if a.rows < FEW_ROWS {
            multiply_few_rows(simd, a, b, store, c);
        } else {
            let mut memory = Vec::new();
            multiply_panels(simd, a, pack(simd, b, &mut memory), store, c);
        }
    });
}

/// `a bᵀ` into the rows of `c` without gaps.
pub(crate) fn multiply_transposed(level: Level, a: Matrix<'_>, b: Matrix<'_>, c: &mut [f32]) {
    assert_eq!(a.columns, b.columns, "columns of both matrices");
    assert_eq!(c.len(), a.rows * b.rows, "a {} x {} result", a.rows, b.rows);
    dispatch!(level, simd => {
        let store = Store::plain(b.rows, b.rows);
        let mut memory = Vec::new();
        multiply_panels(simd, a, pack_transposed(simd, b, &mut memory), store, c);
    });
}

/// A right matrix in panels as wide as a register tile: `[panel][row][column of the panel]`, zero
/// beyond the last column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panels<'a>(pub(super) &'a [f32]);

/// The panels of `b`.
#[inline(always)]
pub(super) fn pack<'a, S: Simd>(_: S, b: Matrix<'_>, memory: &'a mut Vec<f32>) -> Panels<'a> {
    let width = tile_width::<S>();
    memory.clear();
    memory.resize(b.columns.next_multiple_of(width) * b.rows, 0.0);
    for (idx, panel) in memory.chunks_exact_mut((b.rows * width).max(1)).enumerate() {
        let first = idx * width;
        let n = width.min(b.columns - first);
        for row in 0..b.rows {
            let from = &b.row(row)[first..first + n];
            let to = &mut panel[row * width..row * width + n];
            for (to, from) in to.iter_mut().zip(from) {
                *to = *from;
            }
        }
    }
    Panels(memory)
}

/// The panels of `bᵀ`.
#[inline(always)]
pub(super) fn pack_transposed<'a, S: Simd>(
    _: S,
    b: Matrix<'_>,
    memory: &'a mut Vec<f32>,
) -> Panels<'a> {
    let width = tile_width::<S>();
    memory.clear();
    memory.resize(b.rows.next_multiple_of(width) * b.columns, 0.0);
    for (idx, panel) in memory.chunks_exact_mut((b.columns * width).max(1)).enumerate() {
        let first = idx * width;
        for column in 0..width.min(b.rows - first) {
            let row = b.row(first + column);
            for (k, &value) in row.iter().enumerate() {
                panel[k * width + column] = value;
            }
        }
    }
    Panels(memory)
}

/// Where sums go and what becomes of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Store<'a> {
    pub(super) columns: usize,
    /// Distance of the rows.
    pub(super) stride: usize,
    pub(super) bias: Option<&'a [f32]>,
    pub(super) activation: Activation,
}

impl Store<'_> {
    /// As they are.
    #[inline(always)]
    pub(super) fn plain(columns: usize, stride: usize) -> Self {
        Self { columns, stride, bias: None, activation: Activation::Linear }
    }
}

/// The product of `a` and a matrix in panels into the rows of `c`.
#[inline(always)]
pub(super) fn multiply_panels<S: Simd>(
    simd: S,
    a: Matrix<'_>,
    panels: Panels<'_>,
    store: Store<'_>,
    c: &mut [f32],
) {
    if a.columns == 0 || a.rows == 0 {
        return;
    }
    by_tile!(multiply_tiles::<S>(simd, a, panels, store, c));
}

#[inline(always)]
fn multiply_tiles<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    panels: Panels<'_>,
    store: Store<'_>,
    c: &mut [f32],
) {
    let width = tile_width::<S>();
    let mut first = 0;
    while first < store.columns {
        let place = Place { panels, first };
        let mut row = 0;
        while row + R <= a.rows {
            multiply_tile::<S, R, V>(simd, a, row, place, store, c);
            row += R;
        }
        while row + 4 <= a.rows {
            multiply_tile::<S, 4, V>(simd, a, row, place, store, c);
            row += 4;
        }
        if row + 2 <= a.rows {
            multiply_tile::<S, 2, V>(simd, a, row, place, store, c);
            row += 2;
        }
        if row < a.rows {
            multiply_tile::<S, 1, V>(simd, a, row, place, store, c);
        }
        first += width;
    }
}

/// A panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) panels: Panels<'a>,
    /// Its first column.
    pub(super) first: usize,
}

#[inline(always)]
fn multiply_tile<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    row: usize,
    place: Place<'_>,
    store: Store<'_>,
    c: &mut [f32],
) {
    let sums = tile_sums::<S, R, V>(simd, a, row, place);
    let n = Floats::<S>::LEN;
    let first = place.first;
    if store.bias.is_none() && first + V * n <= store.columns {
        // Winograd's products, of which there are many small ones.
        let mut r = 0;
        while r < R {
            let c = &mut c[(row + r) * store.stride + first..][..V * n];
            let mut v = 0;
            while v < V {
                let sum = store.activation.apply(simd, sums[r][v]);
                sum.store_slice(&mut c[v * n..(v + 1) * n]);
                v += 1;
            }
            r += 1;
        }
        return;
    }
    let mut v = 0;
    while v < V && first + v * n < store.columns {
        let first = first + v * n;
        let filled = n.min(store.columns - first);
        let bias = match store.bias {
            Some(bias) => load_part(simd, &bias[first..first + filled]),
            None => splat(simd, 0.0),
        };
        let mut r = 0;
        while r < R {
            let sum = store.activation.apply(simd, sums[r][v] + bias);
            let begin = (row + r) * store.stride + first;
            store_part(simd, sum, &mut c[begin..begin + filled]);
            r += 1;
        }
        v += 1;
    }
}

/// The sums of `R` rows from `row` on with a panel.
#[inline(always)]
pub(super) fn tile_sums<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    row: usize,
    place: Place<'_>,
) -> [[Floats<S>; V]; R] {
    let n = Floats::<S>::LEN;
    let k = a.columns;
    let mut rows = [a.values; R];
    let mut r = 0;
    while r < R {
        rows[r] = &a.values[(row + r) * a.stride..][..k];
        r += 1;
    }
    let mut sums = [[splat(simd, 0.0); V]; R];
    let panel = &place.panels.0[place.first * k..][..k * V * n];
    for (i, right) in panel.chunks_exact(V * n).enumerate() {
        let vectors = load_vectors::<S, V>(simd, right);
        let mut r = 0;
        while r < R {
            add_product(simd, rows[r][i], &vectors, &mut sums[r]);
            r += 1;
        }
    }
    sums
}

/// `V` vectors of successive numbers.
#[inline(always)]
fn load_vectors<S: Simd, const V: usize>(simd: S, numbers: &[f32]) -> [Floats<S>; V] {
    let n = Floats::<S>::LEN;
    let mut vectors = [splat(simd, 0.0); V];
    let mut v = 0;
    while v < V {
        vectors[v] = Floats::<S>::from_slice(simd, &numbers[v * n..(v + 1) * n]);
        v += 1;
    }
    vectors
}

/// Adds `left` times `right`.
#[inline(always)]
fn add_product<S: Simd, const V: usize>(
    simd: S,
    left: f32,
    right: &[Floats<S>; V],
    sums: &mut [Floats<S>; V],
) {
    let left = splat(simd, left);
    let mut v = 0;
    while v < V {
        sums[v] = left.mul_add(right[v], sums[v]);
        v += 1;
    }
}

/// `to += factor from`.
#[inline(always)]
pub(super) fn add_scaled<S: Simd>(simd: S, factor: f32, from: &[f32], to: &mut [f32]) {
    add_scaled_rows::<S, 1>(simd, &[factor], [from], to);
}

/// `[rows, columns]` as `[columns, rows]`.
pub(super) fn transposed(matrix: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let mut result = vec![0.0; matrix.len()];
    for (row, values) in matrix.chunks_exact(columns).enumerate() {
        for (column, &value) in values.iter().enumerate() {
            result[column * rows + row] = value;
        }
    }
    result
}

/// The numbers of `part`, at most a vector, then zeros.
#[inline(always)]
pub(super) fn load_part<S: Simd>(simd: S, part: &[f32]) -> Floats<S> {
    let n = Floats::<S>::LEN;
    if part.len() == n {
        return Floats::<S>::from_slice(simd, part);
    }
    let mut padded = [0.0; 16];
    padded[..part.len()].copy_from_slice(part);
    Floats::<S>::from_slice(simd, &padded[..n])
}

/// The first numbers of a vector into `part`.
#[inline(always)]
pub(super) fn store_part<S: Simd>(_: S, vector: Floats<S>, part: &mut [f32]) {
    if part.len() == Floats::<S>::LEN {
        vector.store_slice(part);
    } else {
        part.copy_from_slice(&vector.as_slice()[..part.len()]);
    }
}
