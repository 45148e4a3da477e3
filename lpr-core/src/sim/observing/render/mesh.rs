//! Triangle meshes of the primitive shapes.

use crate::error::{Error, Result};
use crate::scene::Shape;
use core::f32::consts::{FRAC_PI_2, PI, TAU};
use glamx::Vec3;
use parry3d::transformation::try_convex_hull;

/// Fineness of the tessellation of round shapes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// For images of 128 × 128 pixels: 16 sides; at most 2 % of the radius inside a cylinder, 6 %
    /// inside a ball.
    Observation,
    /// For pictures that people look at: 64 sides.
    Picture,
}

impl Detail {
    /// Sides around the axis.
    const fn sides(self) -> usize {
        match self {
            Self::Observation => 16,
            Self::Picture => 64,
        }
    }

    /// Bands from the pole of a hemisphere to its equator.
    const fn bands(self) -> usize {
        match self {
            Self::Observation => 3,
            Self::Picture => 16,
        }
    }
}

/// The true surface that a mesh stands for: what smooth shading takes its normals from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Surface {
    /// Flat faces.
    Faceted,
    /// A capsule or, with zero half length, a ball.
    Round { half_length: f32 },
    /// A cylinder: round side, flat caps.
    Tube,
}

/// A closed convex mesh around its own origin, counter-clockwise seen from outside.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    pub(super) vertices: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Outward unit normal of each triangle.
    pub(super) normals: Vec<Vec3>,
    /// Distance of each triangle's plane from the origin along its normal, metres.
    pub(super) offsets: Vec<f32>,
    /// Radius of the ball around the origin that holds all vertices, metres.
    pub(super) radius: f32,
    surface: Surface,
}

impl Mesh {
    /// The mesh of `shape`.
    ///
    /// # Errors
    ///
    /// For a convex shape whose points have no hull.
    pub(super) fn new(shape: &Shape, detail: Detail) -> Result<Self> {
        Ok(match *shape {
            Shape::Sphere { radius } => revolved(
                &round_profile(radius, 0.0, detail),
                detail,
                Surface::Round { half_length: 0.0 },
            ),
            Shape::Capsule { radius, half_length } => revolved(
                &round_profile(radius, half_length, detail),
                detail,
                Surface::Round { half_length },
            ),
            Shape::Cylinder { radius, half_length } => {
                let profile = [
                    (0.0, -half_length),
                    (radius, -half_length),
                    (radius, half_length),
                    (0.0, half_length),
                ];
                revolved(&profile, detail, Surface::Tube)
            }
            Shape::Cuboid { half_extents } => cuboid(half_extents),
            Shape::Convex { ref points } => {
                let (vertices, triangles) = try_convex_hull(points).map_err(|error| {
                    Error::Environment(format!(
                        "a convex shape of {} points: {error}",
                        points.len()
                    ))
                })?;
                Self::from_triangles(vertices, &triangles, Surface::Faceted)
            }
        })
    }

    fn from_triangles(vertices: Vec<Vec3>, candidates: &[[u32; 3]], surface: Surface) -> Self {
        let mut mesh = Self {
            vertices,
            triangles: Vec::new(),
            normals: Vec::new(),
            offsets: Vec::new(),
            radius: 0.0,
            surface,
        };
        for &triangle in candidates {
            let [a, b, c] = triangle.map(|idx| mesh.vertices[idx as usize]);
            // In f64: the hull may hold slivers, and one without area has no normal.
            let normal = (b - a).as_dvec3().cross((c - a).as_dvec3());
            let Some(normal) = normal.try_normalize() else { continue };
            mesh.triangles.push(triangle);
            mesh.normals.push(normal.as_vec3());
            mesh.offsets.push(normal.dot(a.as_dvec3()) as f32);
        }
        mesh.radius = mesh.vertices.iter().fold(0.0, |radius, vertex| vertex.length().max(radius));
        mesh
    }

    /// Outward normal of the true surface at `point` of triangle `triangle_idx`, both in the mesh's
    /// frame.
    pub(super) fn smooth_normal(&self, triangle_idx: usize, point: Vec3) -> Vec3 {
        let flat = self.normals[triangle_idx];
        let radial = match self.surface {
            Surface::Faceted => return flat,
            Surface::Tube if flat.z.abs() > 0.5 => return flat,
            Surface::Tube => Vec3::new(point.x, point.y, 0.0),
            Surface::Round { half_length } => {
                Vec3::new(point.x, point.y, point.z - point.z.clamp(-half_length, half_length))
            }
        };
        radial.normalize_or(flat)
    }
}

/// Radius and height of a capsule's outline from the lower to the upper pole.
fn round_profile(radius: f32, half_length: f32, detail: Detail) -> Vec<(f32, f32)> {
    let bands = detail.bands();
    let at = |band: usize, side: f32| {
        let (sin, cos) = libm::sincosf(FRAC_PI_2 * band as f32 / bands as f32);
        // The poles close exactly.
        let around = if band == bands { 0.0 } else { radius * cos };
        (around, side * (half_length + radius * sin))
    };
    let mut profile: Vec<_> = (0..=bands).rev().map(|band| at(band, -1.0)).collect();
    let first_above = if half_length > 0.0 { 0 } else { 1 };
    profile.extend((first_above..=bands).map(|band| at(band, 1.0)));
    profile
}

/// The surface that `profile` (radius, height; first and last on the axis) sweeps around z.
fn revolved(profile: &[(f32, f32)], detail: Detail, surface: Surface) -> Mesh {
    let sides = detail.sides();
    let rings = &profile[1..profile.len() - 1];
    let mut vertices =
        vec![Vec3::new(0.0, 0.0, profile[0].1), Vec3::new(0.0, 0.0, profile[profile.len() - 1].1)];
    for &(radius, z) in rings {
        vertices.extend((0..sides).map(|side| {
            // Half a side off the axes, so that no edge runs along the silhouette of an
            // axis-aligned view.
            let (sin, cos) = libm::sincosf((TAU * side as f32 + PI) / sides as f32);
            Vec3::new(radius * cos, radius * sin, z)
        }));
    }
    let vertex = |ring: usize, side: usize| (2 + ring * sides + side % sides) as u32;
    let mut triangles = Vec::new();
    for side in 0..sides {
        triangles.push([0, vertex(0, side + 1), vertex(0, side)]);
        for ring in 1..rings.len() {
            let [a, b] = [vertex(ring - 1, side), vertex(ring - 1, side + 1)];
            let [c, d] = [vertex(ring, side), vertex(ring, side + 1)];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
        triangles.push([1, vertex(rings.len() - 1, side), vertex(rings.len() - 1, side + 1)]);
    }
    Mesh::from_triangles(vertices, &triangles, surface)
}

fn cuboid(half_extents: Vec3) -> Mesh {
    // Vertex number: bit 0 for +x, bit 1 for +y, bit 2 for +z.
    let sign = |idx: u32, bit: u32| if idx >> bit & 1 == 1 { 1.0 } else { -1.0 };
    let vertices = (0..8)
        .map(|idx| half_extents * Vec3::new(sign(idx, 0), sign(idx, 1), sign(idx, 2)))
        .collect();
    let quads =
        [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]];
    let triangles: Vec<[u32; 3]> =
        quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh::from_triangles(vertices, &triangles, Surface::Faceted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn shapes() -> [Shape; 5] {
        [
            Shape::Sphere { radius: 0.3 },
            Shape::Cuboid { half_extents: Vec3::new(0.1, 0.2, 0.3) },
            Shape::Cylinder { radius: 0.2, half_length: 0.3 },
            Shape::Capsule { radius: 0.1, half_length: 0.3 },
            Shape::Convex {
                points: vec![
                    Vec3::ZERO,
                    Vec3::X,
                    Vec3::Y,
                    Vec3::Z,
                    Vec3::new(0.2, 0.2, 0.2),
                    Vec3::new(0.7, 0.7, 0.7),
                ],
            },
        ]
    }

    /// Volume by the divergence theorem.
    fn volume(mesh: &Mesh) -> f32 {
        let cone = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|idx| mesh.vertices[idx as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        mesh.triangles.iter().map(cone).sum()
    }

    #[test]
    fn meshes_are_closed_and_wound_outwards() {
        for shape in shapes() {
            let mesh = Mesh::new(&shape, Detail::Observation).expect("a proper shape");
            let mut edges = BTreeMap::new();
            for &[a, b, c] in &mesh.triangles {
                for edge in [(a, b), (b, c), (c, a)] {
                    *edges.entry(edge).or_insert(0) += 1;
                }
            }
            assert!(
                edges.iter().all(|(&(a, b), &n)| n == 1 && edges.contains_key(&(b, a))),
                "{shape:?} has a hole"
            );
            assert!(volume(&mesh) > 0.0, "{shape:?} is inside out");
            for (triangle, (normal, offset)) in
                mesh.triangles.iter().zip(mesh.normals.iter().zip(&mesh.offsets))
            {
                let inside = mesh.vertices.iter().all(|v| normal.dot(*v) < offset + 1e-5);
                assert!(inside, "{shape:?}: {triangle:?} does not face outwards");
            }
        }
    }

    #[test]
    fn volumes_approach_the_true_ones() {
        let exact = [
            4.0 / 3.0 * PI * 0.027,
            8.0 * 0.006,
            PI * 0.04 * 0.6,
            PI * 0.01 * 0.6 + 4.0 / 3.0 * PI * 0.001,
        ];
        for (shape, exact) in shapes().iter().zip(exact) {
            let measured = volume(&Mesh::new(shape, Detail::Picture).expect("a proper shape"));
            assert!((measured / exact - 1.0).abs() < 0.01, "{shape:?}: {measured} of {exact}");
        }
    }

    #[test]
    fn smooth_normals_of_a_ball_point_from_its_center() {
        let mesh =
            Mesh::new(&Shape::Sphere { radius: 0.3 }, Detail::Observation).expect("a proper shape");
        let point = Vec3::new(0.1, -0.2, 0.15);
        assert!((mesh.smooth_normal(0, point) - point.normalize_or_zero()).length() < 1e-6);
    }

    #[test]
    fn points_without_a_hull_are_an_error() {
        let shape = Shape::Convex { points: vec![Vec3::X] };
        assert!(matches!(Mesh::new(&shape, Detail::Observation), Err(Error::Environment(_))));
    }
}
