//! The product of a transposed matrix: gradients of weights.

use super::{Matrix, add_product, by_tile, load_part, load_vectors, store_part};
use crate::lanes::{Floats, splat};

use fearless_simd::{Level, Simd, SimdBase as _, dispatch};

/// Adds `aᵀ b` to `c`, which has no gaps.
pub(in crate::nn::kernels) fn accumulate(
    level: Level,
    a: Matrix<'_>,
    b: Matrix<'_>,
    c: &mut [f32],
) {
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

/// Adds `aᵀ b` to the rows of `c`, which has no gaps.
#[inline(always)]
pub(in crate::nn::kernels) fn accumulate_into<S: Simd>(
    simd: S,
    a: Matrix<'_>,
    b: Matrix<'_>,
    c: &mut [f32],
) {
    by_tile!(accumulate_columns::<S>(simd, a, b, c));
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
        let vectors = if V == 1 {
            [load_part(simd, &right[..filled]); V]
        } else {
            load_vectors::<S, V>(simd, right)
        };
        let mut r = 0;
        while r < R {
            add_product(simd, left[r], &vectors, &mut sums[r]);
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
