//! Solids as triangles.

use super::mesh::Triangle;
use core::f64::consts::{PI, TAU};
use glamx::DVec3;

/// Sides of the prism that stands for a cylinder: the gap between both is 0.12 % of the radius.
const N_SIDES: usize = 64;

/// The six faces around the origin.
pub(super) fn cuboid(half_extents: DVec3) -> Vec<Triangle> {
    let face = |axis: usize, side: f64| {
        let corner = |u: f64, v: f64| {
            let mut unit = [0.0; 3];
            (unit[axis], unit[(axis + 1) % 3], unit[(axis + 2) % 3]) = (side, u, v);
            DVec3::from_array(unit) * half_extents
        };
        let [a, b, c, d] =
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        [[a, b, c], [a, c, d]]
    };
    (0..3).flat_map(|axis| [-1.0, 1.0].into_iter().flat_map(move |side| face(axis, side))).collect()
}

/// The prism within a cylinder along z, and the furthest that a point of the cylinder is from it,
/// metres.
pub(super) fn cylinder(radius: f64, half_length: f64) -> (Vec<Triangle>, f64) {
    let corner = |i: usize, z: f64| {
        let (sin, cos) = libm::sincos(TAU * i as f64 / N_SIDES as f64);
        DVec3::new(radius * cos, radius * sin, z)
    };
    let side = |i: usize| {
        let [a, b] = [corner(i, -half_length), corner(i + 1, -half_length)];
        let [c, d] = [corner(i, half_length), corner(i + 1, half_length)];
        let [low, high] = [-half_length, half_length].map(|z| DVec3::new(0.0, 0.0, z));
        [[a, b, c], [b, d, c], [low, a, b], [high, c, d]]
    };
    let gap = radius * (1.0 - libm::cos(PI / N_SIDES as f64));
    ((0..N_SIDES).flat_map(side).collect(), gap)
}

/// The points within a radius of the segment ±`half_length` along z, from within: no further away
/// than 0.5 % of the radius.
#[cfg(feature = "hulls")]
pub(super) fn capsule(radius: f64, half_length: f64) -> Vec<Triangle> {
    /// Rings of each end.
    const N_RINGS: usize = N_SIDES / 4;
    let corner = |ring: usize, i: usize| {
        let (sin_up, cos_up) = libm::sincos(PI * ring as f64 / (2 * N_RINGS) as f64);
        let (sin, cos) = libm::sincos(TAU * i as f64 / N_SIDES as f64);
        let middle = if ring < N_RINGS { half_length } else { -half_length };
        DVec3::new(radius * sin_up * cos, radius * sin_up * sin, middle + radius * cos_up)
    };
    let patch = |(ring, i): (usize, usize)| {
        let [a, b] = [corner(ring, i), corner(ring, i + 1)];
        let [c, d] = [corner(ring + 1, i), corner(ring + 1, i + 1)];
        [[a, b, c], [b, d, c]]
    };
    let patches = (0..2 * N_RINGS).flat_map(|ring| (0..N_SIDES).map(move |i| (ring, i)));
    patches.flat_map(patch).collect()
}
