//! The links of an arm, and the shapes that stand for them.

use super::solid::PlacedSolid;
use glamx::{DPose3, Vec3};

/// A link with the shapes that stand for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name of the link.
    pub name: String,
    /// Index of the body that it is part of: 0 for the base, `i` for what joint `i` (counted from
    /// 1) carries.
    pub body: usize,
    /// The link's own frame in the body's.
    pub body_from_link: DPose3,
    /// The frame of the spheres and capsules in the body's.
    pub body_from_shapes: DPose3,
    /// Collision spheres.
    pub spheres: Vec<Sphere>,
    /// Physical and drawn geometry: of a built-in arm, whose spheres cover it.
    pub capsules: Vec<Capsule>,
    /// Furthest that a sphere reaches beyond the geometry it was fitted to, metres; 0 where the
    /// geometry is spheres.
    pub overshoot: f32,
    /// The geometry itself; of a built-in arm none.
    pub solids: Vec<PlacedSolid>,
    /// True where checks use the solids instead of the spheres: of a link that does not move and
    /// all of whose parts are convex.
    pub is_exact: bool,
}

/// A sphere fixed to a frame of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre in the frame it belongs to, metres.
    pub center: Vec3,
    /// Radius, metres.
    pub radius: f32,
}

/// A capsule of a link between two points of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// One end of the axis, metres.
    pub a: Vec3,
    /// The other end, metres.
    pub b: Vec3,
    /// Radius, metres.
    pub radius: f32,
}

impl Link {
    /// The collision spheres in the frame of the body.
    #[must_use]
    pub fn spheres_in_body(&self) -> Vec<Sphere> {
        moved(&self.spheres, &self.body_from_shapes)
    }
}

/// The spheres in another frame.
pub(super) fn moved(spheres: &[Sphere], to_from_here: &DPose3) -> Vec<Sphere> {
    let moved = |sphere: &Sphere| Sphere {
        center: (*to_from_here * sphere.center.as_dvec3()).as_vec3(),
        ..*sphere
    };
    spheres.iter().map(moved).collect()
}
