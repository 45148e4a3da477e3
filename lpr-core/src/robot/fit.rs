//! Spheres that cover the geometry of a link.
//!
//! A ball is itself, a capsule is a row of spheres. Boxes, cylinders and meshes go through a grid
//! (`fit/grid.rs`): balls that fit inside the solid, found on the grid, are enlarged by one and the
//! same tolerance; a few of them are chosen that cover the surface, and each is then made as small
//! as it may be. The tolerance grows until [`FEW_SPHERES`] are enough; where that is more than was
//! asked for, up to [`MAX_SPHERES`] are chosen on a finer grid.
//!
//! Covered, without exception, are every point of the surface (of a mesh: of its triangles),
//! and every cell of the grid that the surface encloses. A mesh need not be closed, convex or
//! oriented; a mesh with a hole wider than a cell encloses nothing, and is covered along its
//! surface only.
//!
//! The overshoot of a sphere is its radius less the distance of its centre from the surface, in
//! which the errors of the grid are taken at their worst: no point of the sphere is further from
//! the solid.

mod ball;
mod choice;
mod grid;

use super::Sphere;
use super::mesh::Triangle;
use super::solid::Solid;
use super::surface::{cuboid, cylinder};
use ball::Ball;
use choice::choose;
use glamx::{DVec3, Vec3};
use grid::{Fineness, Grid};

/// Most spheres for one solid.
pub const MAX_SPHERES: usize = 256;
/// Furthest that spheres reach beyond a link from a file, metres, where nothing else is asked for
/// and [`MAX_SPHERES`] are enough.
pub(crate) const OVERSHOOT: f64 = 0.01;
/// Spheres that are few enough for any solid.
const FEW_SPHERES: usize = 32;
/// By which the tolerance grows while there are too many of few spheres.
const GROWTH: f64 = 1.08;
/// By which it grows while there are too many of many, which take longer to choose.
const FAST_GROWTH: f64 = 1.3;
const COARSE: Fineness = Fineness { n_cells: 6000.0, max_per_side: 64.0, enough: 0.0 };
/// Share of the overshoot asked for at which a cell is fine enough.
const FINE_ENOUGH: f64 = 0.5;
/// Room for the rounding of centres and radii to f32, as a share of their size; twenty units in the
/// last place.
const ROUNDING: f64 = 2e-6;

/// Spheres that cover a solid, in its frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cover {
    pub(crate) spheres: Vec<Sphere>,
    /// Furthest that a sphere reaches beyond the solid, metres.
    pub(crate) overshoot: f32,
}

/// The spheres of a solid that reach no further than `overshoot` beyond it, metres, where that can
/// be had; the message of a mesh that is too large to sample is the only failure.
pub(crate) fn cover(solid: &Solid, overshoot: f64) -> Result<Cover, String> {
    cover_by(solid, overshoot, MAX_SPHERES)
}

/// The same with a few spheres, however far they reach: of what is carried, or tested otherwise.
pub(crate) fn cover_by_few(solid: &Solid) -> Result<Cover, String> {
    cover_by(solid, OVERSHOOT, FEW_SPHERES)
}

fn cover_by(solid: &Solid, overshoot: f64, most: usize) -> Result<Cover, String> {
    match solid {
        Solid::Ball { radius } => Ok(Cover {
            spheres: vec![Sphere { center: Vec3::ZERO, radius: *radius as f32 }],
            overshoot: 0.0,
        }),
        Solid::Capsule { radius, half_length } => Ok(row(*radius, *half_length, overshoot, most)),
        Solid::Cuboid { half_extents } => {
            cover_surface(&cuboid(*half_extents), 0.0, overshoot, most)
        }
        Solid::Cylinder { radius, half_length } => {
            let (triangles, gap) = cylinder(*radius, *half_length);
            cover_surface(&triangles, gap, overshoot, most)
        }
        Solid::Mesh { triangles } => cover_surface(triangles, 0.0, overshoot, most),
    }
}

/// Equally spaced spheres on the axis, as large as the lens between neighbours needs.
fn row(radius: f64, half_length: f64, overshoot: f64, most: usize) -> Cover {
    let largest = radius + overshoot;
    let spacing = 2.0 * libm::sqrt(largest * largest - radius * radius);
    let n_intervals = libm::ceil(2.0 * half_length / spacing).clamp(1.0, (most - 1) as f64);
    let half_spacing = half_length / n_intervals;
    let needed = libm::sqrt(radius * radius + half_spacing * half_spacing);
    let center = |i: usize| DVec3::new(0.0, 0.0, half_spacing * (2.0 * i as f64 - n_intervals));
    let balls = (0..=n_intervals as usize).map(|i| Ball {
        center: center(i),
        depth: radius,
        radius: needed,
    });
    rounded(&balls.collect::<Vec<_>>())
}

/// Every point of the surface is within `gap` of a triangle, and the triangles are within the
/// solid.
fn cover_surface(
    triangles: &[Triangle],
    gap: f64,
    overshoot: f64,
    most: usize,
) -> Result<Cover, String> {
    let grid = Grid::new(triangles, gap, COARSE)?;
    let least = grid.least_tolerance().max(overshoot);
    if let Some(balls) = choose(&grid, least, FEW_SPHERES) {
        return Ok(rounded(&balls));
    }
    if most > FEW_SPHERES
        && let Some(many) = cover_by_many(triangles, gap, overshoot, most)
    {
        return Ok(many);
    }
    let mut tolerance = least;
    loop {
        tolerance *= GROWTH;
        if let Some(balls) = choose(&grid, tolerance, FEW_SPHERES) {
            return Ok(rounded(&balls));
        }
    }
}

/// More than a few spheres, of a surface that can be sampled finely.
fn cover_by_many(triangles: &[Triangle], gap: f64, overshoot: f64, most: usize) -> Option<Cover> {
    let fineness =
        Fineness { n_cells: 25_000.0, max_per_side: 96.0, enough: FINE_ENOUGH * overshoot };
    let grid = Grid::new(triangles, gap, fineness).ok()?;
    let mut tolerance = grid.least_tolerance().max(overshoot);
    loop {
        if let Some(balls) = choose(&grid, tolerance, most) {
            return Some(rounded(&balls));
        }
        tolerance *= FAST_GROWTH;
    }
}

/// The balls in f32, no smaller than before.
fn rounded(balls: &[Ball]) -> Cover {
    let radius =
        |ball: &Ball| ball.radius + ROUNDING * (ball.radius + ball.center.abs().max_element());
    let sphere =
        |ball: &Ball| Sphere { center: ball.center.as_vec3(), radius: radius(ball) as f32 };
    let overshoot = balls.iter().fold(0.0, |most: f64, ball| most.max(radius(ball) - ball.depth));
    Cover {
        spheres: balls.iter().map(sphere).collect(),
        overshoot: (overshoot * (1.0 + ROUNDING)) as f32,
    }
}

#[cfg(test)]
mod tests;
