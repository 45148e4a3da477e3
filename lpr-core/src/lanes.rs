//! Arithmetic on one number for each lane: a lane is a configuration of the arm.
//!
//! Every function does the same operations in the same order whatever the width of the machine's
//! vectors, and none is fused, so that a lane's result does not depend on the width.

use fearless_simd::{Select as _, Simd, SimdBase as _, SimdFloat as _};
use glamx::Vec3;

/// One `f32` for each lane.
pub(crate) type Floats<S> = <S as Simd>::f32s;

/// One vector for each lane.
#[derive(Clone, Copy)]
pub(crate) struct Vec3s<S: Simd> {
    pub(crate) x: Floats<S>,
    pub(crate) y: Floats<S>,
    pub(crate) z: Floats<S>,
}

#[inline(always)]
pub(crate) fn splat<S: Simd>(simd: S, value: f32) -> Floats<S> {
    Floats::<S>::splat(simd, value)
}

impl<S: Simd> Vec3s<S> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, v: Vec3) -> Self {
        Self { x: splat(simd, v.x), y: splat(simd, v.y), z: splat(simd, v.z) }
    }

    #[inline(always)]
    pub(crate) fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }

    #[inline(always)]
    pub(crate) fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    #[inline(always)]
    pub(crate) fn minus(self, other: Vec3) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    #[inline(always)]
    pub(crate) fn times(self, factor: f32) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }

    #[inline(always)]
    pub(crate) fn scaled(self, factor: Floats<S>) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }

    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Vec3) -> Floats<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(crate) fn length_squared(self) -> Floats<S> {
        self.x * self.x + self.y * self.y + self.z * self.z
    }
}

/// π/2 in two parts: the first has so few bits that its products with small integers are exact.
const HALF_PI: [f32; 2] = [1.570_312_5, 4.838_268e-4];

/// Sine and cosine, for angles of a few turns: within 2e-7.
///
/// The angle is brought to ±π/4 by quarter turns; minimax polynomials there as in Cephes (`sinf`,
/// `cosf`).
#[inline(always)]
pub(crate) fn sincos<S: Simd>(simd: S, angle: Floats<S>) -> (Floats<S>, Floats<S>) {
    let quarters = (angle * core::f32::consts::FRAC_2_PI).round_ties_even();
    let r = angle - quarters * HALF_PI[0] - quarters * HALF_PI[1];
    let r2 = r * r;
    let sine = ((r2 * -1.951_529_6e-4 + 8.332_161e-3) * r2 + -1.666_665_5e-1) * r2 * r + r;
    let cosine =
        ((r2 * 2.443_315_7e-5 + -1.388_731_6e-3) * r2 + 4.166_664_6e-2) * r2 * r2 - r2 * 0.5 + 1.0;
    let turn = quarters.to_int::<S::i32s>();
    let one = S::i32s::splat(simd, 1);
    let two = S::i32s::splat(simd, 2);
    let is_odd = (turn & one).simd_eq(one);
    let sine_is_negative = (turn & two).simd_eq(two);
    let cosine_is_negative = ((turn + one) & two).simd_eq(two);
    let (s, c) = (is_odd.select(cosine, sine), is_odd.select(sine, cosine));
    (sine_is_negative.select(-s, s), cosine_is_negative.select(-c, c))
}

/// Every width of vectors that this machine has.
#[cfg(test)]
pub(crate) fn levels() -> Vec<fearless_simd::Level> {
    use fearless_simd::Level;
    let best = Level::new();
    #[cfg(target_arch = "x86_64")]
    let narrower = [
        best.as_sse2().map(Level::Sse2),
        best.as_sse4_2().map(Level::Sse4_2),
        best.as_avx2().map(Level::Avx2),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let narrower: [Option<Level>; 0] = [];
    narrower.into_iter().flatten().chain([best]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    #[inline(always)]
    fn errors<S: Simd>(simd: S, angle: f32) -> [f64; 2] {
        let (sin, cos) = sincos(simd, splat(simd, angle));
        let (exact_sin, exact_cos) = libm::sincos(f64::from(angle));
        [(f64::from(sin[0]) - exact_sin).abs(), (f64::from(cos[0]) - exact_cos).abs()]
    }

    #[test]
    fn sine_and_cosine_are_exact_to_rounding_over_the_joints_two_turns() {
        let level = Level::new();
        for i in -70_000_i32..=70_000 {
            let angle = 1e-4 * i as f32;
            let [sin, cos] = dispatch!(level, simd => errors(simd, angle));
            assert!(sin < 2e-7 && cos < 2e-7, "{angle}: {sin}, {cos}");
        }
    }
}
