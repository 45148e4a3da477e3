//! Products of matrices of any size, by register tiles.
//!
//! The right matrix is packed into panels as wide as a tile, the left one is read where it lies: the
//! networks here have few columns and many rows. Each number of the result is one sum over the
//! inner index in ascending order, whatever the tile and the number of rows, so that a row does not
//! depend on the rows beside it. Wider vectors may fuse multiplication and addition.

use crate::lanes::{Floats, splat};

use fearless_simd::{Level, Simd, SimdBase as _, SimdFloat as _, dispatch};

/// Vectors of a register tile.
#[inline(always)]
pub(super) const fn tile_vectors<S: Simd>() -> usize {
    if Floats::<S>::LEN >= 8 { 2 } else { 4 }
}

/// Columns of a register tile.
#[inline(always)]
pub(super) const fn tile_width<S: Simd>() -> usize {
    tile_vectors::<S>() * Floats::<S>::LEN
}

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

/// Below as many rows, packing the right matrix takes longer than its product.
const FEW_ROWS: usize = 16;

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

/// Adds `aᵀ b` to `c`, which has no gaps.
pub(crate) fn accumulate(level: Level, a: Matrix<'_>, b: Matrix<'_>, c: &mut [f32]) {
    assert_eq!(a.rows, b.rows, "rows of both matrices");
    assert_eq!(c.len(), a.columns * b.columns, "a {} x {} result", a.columns, b.columns);
    // As many rows at once as stay in the first cache beside those of `b`.
    const NUMBERS: usize = 6144;
    let most = (NUMBERS / a.columns.max(1)).max(16);
    for first in (0..a.rows).step_by(most) {
        let rows = most.min(a.rows - first);
        let [a, b] = [a, b].map(|matrix| matrix.part(first, rows));
        dispatch!(level, simd => accumulate_into(simd, a, b, c));
    }
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
    let n = Floats::<S>::LEN;
    // As many sums as the registers hold beside a row of the panel and one number of `a`.
    if n >= 16 {
        multiply_tiles::<S, 12, 2>(simd, a, panels, store, c);
    } else if n == 8 {
        multiply_tiles::<S, 6, 2>(simd, a, panels, store, c);
    } else {
        multiply_tiles::<S, 3, 4>(simd, a, panels, store, c);
    }
}

/// The product of few rows with `b` as it lies: row after row of `b` times a number of each.
#[inline(always)]
fn multiply_few_rows<S: Simd>(
    simd: S,
    a: Matrix<'_>,
    b: Matrix<'_>,
    store: Store<'_>,
    c: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    for (row, c) in c.chunks_exact_mut(b.columns.max(1)).enumerate() {
        let a = a.row(row);
        c.fill(0.0);
        let mut k = 0;
        while k + 4 <= b.rows {
            let rows = [b.row(k), b.row(k + 1), b.row(k + 2), b.row(k + 3)];
            add_scaled_rows::<S, 4>(simd, &a[k..k + 4], rows, c);
            k += 4;
        }
        while k < b.rows {
            add_scaled_rows::<S, 1>(simd, &a[k..=k], [b.row(k)], c);
            k += 1;
        }
        let mut first = 0;
        while first < b.columns {
            let part = first..b.columns.min(first + n);
            let bias = match store.bias {
                Some(bias) => load_part(simd, &bias[part.clone()]),
                None => splat(simd, 0.0),
            };
            let sum = load_part(simd, &c[part.clone()]) + bias;
            store_part(simd, store.activation.apply(simd, sum), &mut c[part]);
            first += n;
        }
    }
}

/// Adds `factors` times `rows` to `c`, in their order.
#[inline(always)]
fn add_scaled_rows<S: Simd, const R: usize>(
    simd: S,
    factors: &[f32],
    rows: [&[f32]; R],
    c: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let columns = c.len();
    let mut parts = [rows[0]; R];
    let mut vectors = [splat(simd, 0.0); R];
    let mut r = 0;
    while r < R {
        parts[r] = &rows[r][..columns];
        vectors[r] = splat(simd, factors[r]);
        r += 1;
    }
    let mut first = 0;
    while first + n <= columns {
        let mut sum = Floats::<S>::from_slice(simd, &c[first..first + n]);
        let mut r = 0;
        while r < R {
            let right = Floats::<S>::from_slice(simd, &parts[r][first..first + n]);
            sum = vectors[r].mul_add(right, sum);
            r += 1;
        }
        sum.store_slice(&mut c[first..first + n]);
        first += n;
    }
    if first < columns {
        let mut sum = load_part(simd, &c[first..]);
        let mut r = 0;
        while r < R {
            sum = vectors[r].mul_add(load_part(simd, &parts[r][first..]), sum);
            r += 1;
        }
        store_part(simd, sum, &mut c[first..]);
    }
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
        let mut vectors = [splat(simd, 0.0); V];
        let mut v = 0;
        while v < V {
            vectors[v] = Floats::<S>::from_slice(simd, &right[v * n..(v + 1) * n]);
            v += 1;
        }
        let mut r = 0;
        while r < R {
            let left = splat(simd, rows[r][i]);
            let mut v = 0;
            while v < V {
                sums[r][v] = left.mul_add(vectors[v], sums[r][v]);
                v += 1;
            }
            r += 1;
        }
    }
    sums
}

/// Adds `aᵀ b` to the rows of `c`, which has no gaps.
#[inline(always)]
pub(super) fn accumulate_into<S: Simd>(simd: S, a: Matrix<'_>, b: Matrix<'_>, c: &mut [f32]) {
    let n = Floats::<S>::LEN;
    if n >= 16 {
        accumulate_columns::<S, 12, 2>(simd, a, b, c);
    } else if n == 8 {
        accumulate_columns::<S, 6, 2>(simd, a, b, c);
    } else {
        accumulate_columns::<S, 4, 2>(simd, a, b, c);
    }
}

#[inline(always)]
fn accumulate_columns<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    b: Matrix<'_>,
    c: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let mut column = 0;
    while column + V * n <= b.columns {
        accumulate_rows::<S, R, V>(simd, a, b, column, c);
        column += V * n;
    }
    while column < b.columns {
        accumulate_rows::<S, R, 1>(simd, a, b, column, c);
        column += n;
    }
}

#[inline(always)]
fn accumulate_rows<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    b: Matrix<'_>,
    column: usize,
    c: &mut [f32],
) {
    let mut k = 0;
    while k + R <= a.columns {
        accumulate_tile::<S, R, V>(simd, a, b, [k, column], c);
        k += R;
    }
    while k + 2 <= a.columns {
        accumulate_tile::<S, 2, V>(simd, a, b, [k, column], c);
        k += 2;
    }
    if k < a.columns {
        accumulate_tile::<S, 1, V>(simd, a, b, [k, column], c);
    }
}

/// Adds to `R` rows and `V` vectors of `c` from row `k` and `column` on. Only one vector may reach
/// beyond the last column.
#[inline(always)]
fn accumulate_tile<S: Simd, const R: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    b: Matrix<'_>,
    [k, column]: [usize; 2],
    c: &mut [f32],
) {
    let n = Floats::<S>::LEN;
    let mut sums = [[splat(simd, 0.0); V]; R];
    let filled = n.min(b.columns - column);
    for row in 0..a.rows {
        let left = &a.values[row * a.stride + k..][..R];
        let right = &b.values[row * b.stride + column..];
        let mut vectors = [splat(simd, 0.0); V];
        if V == 1 {
            vectors[0] = load_part(simd, &right[..filled]);
        } else {
            let right = &right[..V * n];
            let mut v = 0;
            while v < V {
                vectors[v] = Floats::<S>::from_slice(simd, &right[v * n..(v + 1) * n]);
                v += 1;
            }
        }
        let mut r = 0;
        while r < R {
            let left = splat(simd, left[r]);
            let mut v = 0;
            while v < V {
                sums[r][v] = left.mul_add(vectors[v], sums[r][v]);
                v += 1;
            }
            r += 1;
        }
    }
    let mut r = 0;
    while r < R {
        let mut v = 0;
        while v < V {
            let begin = (k + r) * b.columns + column + v * n;
            let place = &mut c[begin..begin + filled];
            store_part(simd, load_part(simd, place) + sums[r][v], place);
            v += 1;
        }
        r += 1;
    }
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
