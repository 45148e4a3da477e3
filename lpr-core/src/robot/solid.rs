//! The geometry of a link as its description states it.

use super::mesh::Triangle;
#[cfg(feature = "hulls")]
use super::surface;
use glamx::{DPose3, DVec3};

/// Geometry around its own origin, lengths in metres. Cylinders and capsules lie along z.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// A ball.
    Ball {
        /// Radius.
        radius: f64,
    },
    /// A box.
    Cuboid {
        /// Half the side lengths.
        half_extents: DVec3,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half the length.
        half_length: f64,
    },
    /// All points within `radius` of the segment ±`half_length`.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half the length of the segment.
        half_length: f64,
    },
    /// A mesh.
    Mesh {
        /// Corners of each triangle.
        triangles: Vec<Triangle>,
    },
}

/// A solid in the frame of a link's body.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedSolid {
    /// Pose of the solid.
    pub body_from_solid: DPose3,
    /// The solid.
    pub solid: Solid,
}

#[cfg(feature = "hulls")]
impl Solid {
    /// True if a point, in its frame, is inside; of a mesh nothing is known.
    pub(crate) fn contains(&self, point: DVec3) -> bool {
        let from_axis = |half_length: f64| {
            DVec3::new(point.x, point.y, point.z - point.z.clamp(-half_length, half_length))
        };
        match self {
            Self::Ball { radius } => point.length_squared() < radius * radius,
            Self::Capsule { radius, half_length } => {
                from_axis(*half_length).length_squared() < radius * radius
            }
            Self::Cylinder { radius, half_length } => {
                point.z.abs() < *half_length
                    && from_axis(*half_length).length_squared() < radius * radius
            }
            Self::Cuboid { half_extents } => point.abs().cmplt(*half_extents).all(),
            Self::Mesh { .. } => false,
        }
    }

    /// Its surface, as triangles; round ones from within, no further away than 0.5 % of the radius.
    pub(crate) fn surface(&self) -> Vec<Triangle> {
        match self {
            Self::Ball { radius } => surface::capsule(*radius, 0.0),
            Self::Capsule { radius, half_length } => surface::capsule(*radius, *half_length),
            Self::Cylinder { radius, half_length } => surface::cylinder(*radius, *half_length).0,
            Self::Cuboid { half_extents } => surface::cuboid(*half_extents),
            Self::Mesh { triangles } => triangles.clone(),
        }
    }

    /// True if it is convex, and of few enough faces that each can be asked. Of a mesh: closed, and
    /// of the volume of its hull.
    pub(super) fn is_convex(&self) -> bool {
        /// Most corners of a hull.
        const MAX_CORNERS: usize = 64;
        /// Share of the hull's volume that a convex mesh may lack: rounding of its corners.
        const SLACK: f64 = 1e-3;
        let Self::Mesh { triangles } = self else {
            return true;
        };
        let corners: Vec<_> = triangles.as_flattened().iter().map(|it| it.as_vec3()).collect();
        let Ok((hull, faces)) = parry3d::transformation::try_convex_hull(&corners) else {
            return false;
        };
        if hull.len() > MAX_CORNERS {
            return false;
        }
        let faces: Vec<Triangle> =
            faces.iter().map(|face| face.map(|corner| hull[corner as usize].as_dvec3())).collect();
        let wanted = sixfold_volume(&faces).abs();
        wanted > 0.0 && sixfold_volume(triangles).abs() > (1.0 - SLACK) * wanted
    }
}

#[cfg(not(feature = "hulls"))]
impl Solid {
    /// True if it is convex for sure.
    pub(super) const fn is_convex(&self) -> bool {
        !matches!(self, Self::Mesh { .. })
    }
}

/// Six times the volume that a closed surface encloses; less for one that turns inside out.
#[cfg(feature = "hulls")]
fn sixfold_volume(triangles: &[Triangle]) -> f64 {
    let about = triangles.first().map_or(DVec3::ZERO, |triangle| triangle[0]);
    triangles.iter().map(|[a, b, c]| (*a - about).dot((*b - about).cross(*c - about))).sum()
}
