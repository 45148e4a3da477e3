//! Spheres that cover the geometry of a link.
//!
//! A ball is itself, a capsule is a row of spheres. Boxes, cylinders and meshes go through a grid
//! (`fit/grid.rs`): balls that fit inside the solid, found on the grid, are enlarged by one and the
//! same tolerance; a few of them are chosen that cover the surface, and each is then made as small
//! as it may be. The tolerance grows until [`MAX_SPHERES`] are enough.
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
mod surface;

use super::Sphere;
use super::mesh::Triangle;
use super::solid::Solid;
use ball::Ball;
use choice::choose;
use glamx::{DVec3, Vec3};
use grid::Grid;
use surface::{cuboid, cylinder};

/// Most spheres for one solid.
pub const MAX_SPHERES: usize = 32;
/// Overshoot that is good enough, metres; where it takes too many spheres, more is allowed.
const TARGET_OVERSHOOT: f64 = 0.01;
/// By which the allowed overshoot grows while there are too many spheres.
const GROWTH: f64 = 1.08;
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

/// The spheres of a solid; the message of a mesh that is too large to sample is the only failure.
pub(crate) fn cover(solid: &Solid) -> Result<Cover, String> {
    match solid {
        Solid::Ball { radius } => Ok(Cover {
            spheres: vec![Sphere { center: Vec3::ZERO, radius: *radius as f32 }],
            overshoot: 0.0,
        }),
        Solid::Capsule { radius, half_length } => Ok(row(*radius, *half_length)),
        Solid::Cuboid { half_extents } => cover_surface(&cuboid(*half_extents), 0.0),
        Solid::Cylinder { radius, half_length } => {
            let (triangles, gap) = cylinder(*radius, *half_length);
            cover_surface(&triangles, gap)
        }
        Solid::Mesh { triangles } => cover_surface(triangles, 0.0),
    }
}

/// Equally spaced spheres on the axis, as large as the lens between neighbours needs.
fn row(radius: f64, half_length: f64) -> Cover {
    let largest = radius + TARGET_OVERSHOOT;
    let spacing = 2.0 * libm::sqrt(largest * largest - radius * radius);
    let n_intervals = libm::ceil(2.0 * half_length / spacing).clamp(1.0, (MAX_SPHERES - 1) as f64);
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
fn cover_surface(triangles: &[Triangle], gap: f64) -> Result<Cover, String> {
    let grid = Grid::new(triangles, gap)?;
    let mut tolerance = grid.least_tolerance().max(TARGET_OVERSHOOT);
    loop {
        if let Some(balls) = choose(&grid, tolerance, MAX_SPHERES) {
            return Ok(rounded(&balls));
        }
        tolerance *= GROWTH;
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
