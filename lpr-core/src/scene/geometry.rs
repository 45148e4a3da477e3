//! The geometry of the links of an arm from a file, itself: whether two links touch where their
//! spheres do. Slow; for what is asked once of a description.

use crate::robot::{PlacedSolid, Robot, Solid};
use core::cell::OnceCell;
use core::f32::consts::FRAC_PI_2;
use glamx::{Pose3, Quat, Vec3};
use parry3d::query::intersection_test;
use parry3d::shape::SharedShape;

/// A link by its index, and its body's frame in the world.
pub(super) type Body = (usize, Pose3);

/// The geometry of the links of an arm, made ready where it is asked for.
pub(super) struct Geometry<'a> {
    robot: &'a Robot,
    links: Vec<OnceCell<Option<Vec<Part>>>>,
}

/// A solid in the frame of its body.
type Part = (Pose3, SharedShape);

impl<'a> Geometry<'a> {
    pub(super) fn new(robot: &'a Robot) -> Self {
        Self { robot, links: robot.links.iter().map(|_| OnceCell::new()).collect() }
    }

    /// True if the geometry of two links touches, given with the places of their bodies; also where
    /// it is not known of one of them. Meshes are surfaces.
    pub(super) fn touch(&self, (a, world_from_a): Body, (b, world_from_b): Body) -> bool {
        let (Some(parts_a), Some(parts_b)) = (self.parts(a), self.parts(b)) else {
            return true;
        };
        let are_apart = parts_a.iter().all(|(from_a, shape_a)| {
            parts_b.iter().all(|(from_b, shape_b)| {
                let (place_a, place_b) = (world_from_a * *from_a, world_from_b * *from_b);
                intersection_test(&place_a, &**shape_a, &place_b, &**shape_b)
                    .is_ok_and(|found| !found.intersecting)
            })
        });
        !are_apart
    }

    /// The solids of a link; none where it has none, or one of them cannot be asked.
    fn parts(&self, link: usize) -> Option<&[Part]> {
        let solids = &self.robot.links[link].solids;
        let ready = || (!solids.is_empty()).then(|| solids.iter().map(part).collect()).flatten();
        self.links[link].get_or_init(ready).as_deref()
    }
}

fn part(placed: &PlacedSolid) -> Option<Part> {
    let mut place = Pose3::from(placed.body_from_solid);
    let shape = match &placed.solid {
        Solid::Ball { radius } => SharedShape::ball(*radius as f32),
        Solid::Cuboid { half_extents } => {
            let half = half_extents.as_vec3();
            SharedShape::cuboid(half.x, half.y, half.z)
        }
        Solid::Capsule { radius, half_length } => {
            SharedShape::capsule_z(*half_length as f32, *radius as f32)
        }
        Solid::Cylinder { radius, half_length } => {
            // Along y there.
            place *= Pose3::from_parts(Vec3::ZERO, Quat::from_rotation_x(FRAC_PI_2));
            SharedShape::cylinder(*half_length as f32, *radius as f32)
        }
        Solid::Mesh { triangles } => {
            let corners = triangles.as_flattened().iter().map(|corner| corner.as_vec3()).collect();
            let idx = |i: usize| [3 * i, 3 * i + 1, 3 * i + 2].map(|corner| corner as u32);
            SharedShape::trimesh(corners, (0..triangles.len()).map(idx).collect()).ok()?
        }
    };
    Some((place, shape))
}
