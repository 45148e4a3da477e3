//! The product of few rows with a matrix as it lies.

use super::{Matrix, Store, load_part, store_part};
use crate::lanes::{Floats, splat};

use fearless_simd::{Simd, SimdBase as _, SimdFloat as _};

/// Below as many rows, packing the right matrix takes longer than its product: for one row of a
/// 1280 x 256 matrix five times as long, for eight the same.
pub(super) const FEW_ROWS: usize = 4;

/// The product of few rows with `b` as it lies: row after row of `b` times a number of each.
#[inline(always)]
pub(super) fn multiply_few_rows<S: Simd>(
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
pub(super) fn add_scaled_rows<S: Simd, const R: usize>(
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
