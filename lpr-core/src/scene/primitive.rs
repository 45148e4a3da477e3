//! Primitive obstacles and the distance of a point to them.

use super::shape::Shape;
use crate::error::{Error, Result};
use crate::robot::{PlacedSolid, Solid, Sphere, cover_by_few};
use glamx::{Pose3, Quat, Vec3};

/// A solid obstacle in the world frame. Lengths in metres.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::scene::Primitive;
///
/// let table = Primitive::Cuboid {
///     world_from_box: Pose3::from_translation(Vec3::new(0.5, 0.0, -0.02)),
///     half_extents: Vec3::new(0.4, 0.6, 0.02),
/// };
/// assert!((table.distance(Vec3::new(0.5, 0.3, 0.1)) - 0.1).abs() < 1e-6, "10 cm above it");
/// assert_eq!(table.distance(Vec3::new(0.5, 0.3, -0.01)), 0.0, "inside");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Primitive {
    /// All points within `radius` of `center`.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius.
        radius: f32,
    },
    /// An oriented box.
    Cuboid {
        /// Pose of the box, whose origin is its centre.
        world_from_box: Pose3,
        /// Half the side lengths along its axes.
        half_extents: Vec3,
    },
    /// All points within `radius` of the segment from `a` to `b`.
    Capsule {
        /// One end of the axis.
        a: Vec3,
        /// The other end.
        b: Vec3,
        /// Radius.
        radius: f32,
    },
    /// A cylinder with flat ends along its own z.
    Cylinder {
        /// Pose of the cylinder, whose origin is its centre.
        world_from_cylinder: Pose3,
        /// Radius.
        radius: f32,
        /// Half the length along z.
        half_length: f32,
    },
    /// A convex polyhedron: the points behind all of its faces.
    Hull {
        /// Its faces.
        faces: Vec<Face>,
    },
}

/// A plane; what it bounds lies behind it.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::scene::{Face, Primitive};
///
/// // A slab 2 cm thick: the points behind both of its faces.
/// let faces = vec![Face { normal: Vec3::Z, offset: 0.01 }, Face { normal: Vec3::NEG_Z, offset: 0.01 }];
/// let slab = Primitive::Hull { faces };
/// assert_eq!((slab.distance(Vec3::ZERO), slab.distance(Vec3::new(9.0, 9.0, 0.51))), (0.0, 0.5));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Unit normal, outwards.
    pub normal: Vec3,
    /// Signed distance of the plane from the origin along the normal, metres.
    pub offset: f32,
}

impl Primitive {
    /// The obstacle that `shape` makes at `world_from_shape`; a convex hull of points in a plane
    /// becomes the box around them, and so does every hull without the feature `hulls`.
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Quat, Vec3};
    /// use lpr_core::scene::{Primitive, Shape};
    ///
    /// // A capsule along its own z, laid down along the world's y.
    /// let lying = Pose3::from_parts(Vec3::X, Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
    /// let handle = Primitive::new(&Shape::Capsule { radius: 0.01, half_length: 0.05 }, &lying);
    /// assert!((handle.distance(Vec3::new(1.0, 0.08, 0.0)) - 0.02).abs() < 1e-6);
    ///
    /// // The hull of four corners is bounded by four faces.
    /// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    /// let hull = Primitive::new(&Shape::Convex { points: corners }, &Pose3::IDENTITY);
    /// assert!(matches!(hull, Primitive::Hull { faces } if faces.len() == 4));
    /// ```
    #[must_use]
    pub fn new(shape: &Shape, world_from_shape: &Pose3) -> Self {
        match shape {
            Shape::Sphere { radius } => {
                Self::Sphere { center: world_from_shape.translation, radius: *radius }
            }
            Shape::Cuboid { half_extents } => {
                Self::Cuboid { world_from_box: *world_from_shape, half_extents: *half_extents }
            }
            Shape::Cylinder { radius, half_length } => Self::Cylinder {
                world_from_cylinder: *world_from_shape,
                radius: *radius,
                half_length: *half_length,
            },
            Shape::Capsule { radius, half_length } => {
                let end = *half_length * Vec3::Z;
                Self::Capsule {
                    a: *world_from_shape * -end,
                    b: *world_from_shape * end,
                    radius: *radius,
                }
            }
            Shape::Convex { points } => hull_of(points, world_from_shape)
                .unwrap_or_else(|| box_around(points, world_from_shape)),
        }
    }

    /// A convex solid of a link of the base.
    pub(super) fn of_solid(placed: &PlacedSolid) -> Self {
        let pose = Pose3::from(placed.body_from_solid);
        match &placed.solid {
            Solid::Ball { radius } => {
                Self::Sphere { center: pose.translation, radius: *radius as f32 }
            }
            Solid::Cuboid { half_extents } => {
                Self::Cuboid { world_from_box: pose, half_extents: half_extents.as_vec3() }
            }
            Solid::Cylinder { radius, half_length } => Self::Cylinder {
                world_from_cylinder: pose,
                radius: *radius as f32,
                half_length: *half_length as f32,
            },
            Solid::Capsule { radius, half_length } => {
                let (radius, half_length) = (*radius as f32, *half_length as f32);
                Self::new(&Shape::Capsule { radius, half_length }, &pose)
            }
            Solid::Mesh { triangles } => {
                let points = triangles.as_flattened().iter().map(|it| it.as_vec3()).collect();
                Self::new(&Shape::Convex { points }, &pose)
            }
        }
    }

    /// Spheres that cover the solid, as those of a link cover its geometry: what an arm carries
    /// ([`ArmSpheres::with_attached`](super::ArmSpheres::with_attached)).
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Vec3};
    /// use lpr_core::scene::Primitive;
    ///
    /// let tray = Primitive::Cuboid { world_from_box: Pose3::from_translation(Vec3::Z), half_extents: Vec3::new(0.1, 0.1, 0.01) };
    /// let spheres = tray.covering_spheres()?;
    /// let corner = Vec3::new(0.1, -0.1, 1.01);
    /// assert!(spheres.iter().any(|ball| ball.center.distance(corner) <= ball.radius));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// For a hull, of which only the faces are known, and for a solid with numbers that are not
    /// finite or sizes below 0.
    pub fn covering_spheres(&self) -> Result<Vec<Sphere>> {
        if !self.is_sound() {
            return Err(Error::Environment(format!("{self:?}: expected finite sizes from 0 up")));
        }
        let (solid, pose) = match self {
            Self::Sphere { center, radius } => {
                return Ok(vec![Sphere { center: *center, radius: *radius }]);
            }
            Self::Cuboid { world_from_box, half_extents } => {
                (Solid::Cuboid { half_extents: half_extents.as_dvec3() }, *world_from_box)
            }
            Self::Capsule { a, b, radius } => {
                let axis = *b - *a;
                let rotation = Quat::from_rotation_arc(Vec3::Z, axis.normalize_or(Vec3::Z));
                let half_length = f64::from(0.5 * length(axis));
                let solid = Solid::Capsule { radius: f64::from(*radius), half_length };
                (solid, Pose3::from_parts(0.5 * (*a + *b), rotation))
            }
            Self::Cylinder { world_from_cylinder, radius, half_length } => {
                let (radius, half_length) = (f64::from(*radius), f64::from(*half_length));
                (Solid::Cylinder { radius, half_length }, *world_from_cylinder)
            }
            Self::Hull { .. } => {
                return Err(Error::Environment("a hull: it cannot be covered".to_owned()));
            }
        };
        let spheres = cover_by_few(&solid).map_err(Error::Environment)?.spheres;
        let placed = |ball: Sphere| Sphere { center: pose * ball.center, radius: ball.radius };
        Ok(spheres.into_iter().map(placed).collect())
    }

    /// Distance from `point` to the solid, metres; 0 inside.
    ///
    /// Of a hull it is the distance to the plane of its furthest face: less than the true one
    /// beyond edges and corners, never more.
    #[must_use]
    pub fn distance(&self, point: Vec3) -> f32 {
        match self {
            Self::Sphere { center, radius } => (length(point - *center) - radius).max(0.0),
            Self::Cuboid { world_from_box, half_extents } => {
                let local = world_from_box.inverse_transform_point(point);
                length((local.abs() - *half_extents).max(Vec3::ZERO))
            }
            Self::Capsule { a, b, radius } => {
                (length(from_segment(point, *a, *b)) - radius).max(0.0)
            }
            Self::Cylinder { world_from_cylinder, radius, half_length } => {
                let local = world_from_cylinder.inverse_transform_point(point);
                let radial = (libm::sqrtf(local.x * local.x + local.y * local.y) - radius).max(0.0);
                let axial = (local.z.abs() - half_length).max(0.0);
                libm::sqrtf(radial * radial + axial * axial)
            }
            Self::Hull { faces } => faces
                .iter()
                .fold(0.0, |most: f32, face| most.max(face.normal.dot(point) - face.offset)),
        }
    }
}

impl Primitive {
    /// True if every number is finite and no size is below 0.
    pub(super) fn is_sound(&self) -> bool {
        let is_size = |size: f32| size.is_finite() && size >= 0.0;
        match self {
            Self::Sphere { center, radius } => center.is_finite() && is_size(*radius),
            Self::Cuboid { world_from_box, half_extents } => {
                world_from_box.is_finite() && half_extents.to_array().into_iter().all(is_size)
            }
            Self::Capsule { a, b, radius } => a.is_finite() && b.is_finite() && is_size(*radius),
            Self::Cylinder { world_from_cylinder, radius, half_length } => {
                world_from_cylinder.is_finite() && is_size(*radius) && is_size(*half_length)
            }
            Self::Hull { faces } => {
                faces.iter().all(|face| face.normal.is_finite() && face.offset.is_finite())
            }
        }
    }
}

/// None, without the feature `hulls`.
#[cfg(not(feature = "hulls"))]
const fn hull_of(_points: &[Vec3], _world_from_shape: &Pose3) -> Option<Primitive> {
    None
}

/// The convex hull of points; none for points in a plane.
#[cfg(feature = "hulls")]
fn hull_of(points: &[Vec3], world_from_shape: &Pose3) -> Option<Primitive> {
    /// Faces whose normals differ by less lie in one plane.
    const SAME_PLANE: f32 = 1e-5;
    let placed: Vec<Vec3> = points.iter().map(|point| *world_from_shape * *point).collect();
    let (corners, triangles) = parry3d::transformation::try_convex_hull(&placed).ok()?;
    let mut faces: Vec<Face> = Vec::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| corners[corner as usize]);
        let normal = (b - a).cross(c - a);
        if length(normal) == 0.0 {
            continue;
        }
        let normal = normal / length(normal);
        // As far out as the furthest point, so that rounding cuts nothing off.
        let offset =
            placed.iter().fold(f32::NEG_INFINITY, |most, point| most.max(normal.dot(*point)));
        if !faces.iter().any(|face| face.normal.distance(normal) < SAME_PLANE) {
            faces.push(Face { normal, offset });
        }
    }
    (faces.len() >= 4).then_some(Primitive::Hull { faces })
}

/// The box along the shape's axes around `points`.
fn box_around(points: &[Vec3], world_from_shape: &Pose3) -> Primitive {
    let first = points.first().copied().unwrap_or(Vec3::ZERO);
    let low = points.iter().fold(first, |low, point| low.min(*point));
    let high = points.iter().fold(first, |high, point| high.max(*point));
    let world_from_box =
        Pose3::from_parts(*world_from_shape * (0.5 * (low + high)), world_from_shape.rotation);
    Primitive::Cuboid { world_from_box, half_extents: 0.5 * (high - low) }
}

/// Euclidean norm through `libm`, so that wasm agrees.
pub(super) fn length(v: Vec3) -> f32 {
    libm::sqrtf(v.dot(v))
}

/// Offset of `point` from the nearest point of the segment from `a` to `b`, metres.
pub(super) fn from_segment(point: Vec3, a: Vec3, b: Vec3) -> Vec3 {
    let axis = b - a;
    let along = (point - a).dot(axis) / axis.dot(axis).max(f32::MIN_POSITIVE);
    point - a - along.clamp(0.0, 1.0) * axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use glamx::Quat;
    use parry3d::query::PointQuery as _;
    use parry3d::shape::{Ball, Capsule, Cuboid, Cylinder};
    use proptest::prelude::*;

    fn vec3(range: core::ops::Range<f32>) -> impl Strategy<Value = Vec3> {
        [range.clone(), range.clone(), range].prop_map(Vec3::from_array)
    }

    fn pose() -> impl Strategy<Value = Pose3> {
        (vec3(-1.0..1.0), vec3(-3.0..3.0))
            .prop_map(|(at, turn)| Pose3::from_parts(at, Quat::from_scaled_axis(turn)))
    }

    proptest! {
        /// parry3d is the reference; its cylinder and capsule lie along y.
        #[test]
        fn distances_agree_with_parry(pose in pose(), sizes in vec3(0.02..0.5), point in vec3(-1.5..1.5)) {
            let upright = pose * Pose3::from_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
            let Vec3 { x: radius, z: half_length, .. } = sizes;
            let expected = [
                (Shape::Sphere { radius }, Ball::new(radius).distance_to_point(&pose, point, true)),
                (Shape::Cuboid { half_extents: sizes }, Cuboid::new(sizes).distance_to_point(&pose, point, true)),
                (Shape::Cylinder { radius, half_length }, Cylinder::new(half_length, radius).distance_to_point(&upright, point, true)),
                (Shape::Capsule { radius, half_length }, Capsule::new_y(half_length, radius).distance_to_point(&upright, point, true)),
            ];
            for (shape, distance) in expected {
                let found = Primitive::new(&shape, &pose).distance(point);
                prop_assert!((found - distance).abs() < 1e-5, "{shape:?}: {found} instead of {distance}");
            }
        }

        #[test]
        fn a_hull_is_never_further_than_parry_says_and_as_far_before_its_faces(
            pose in pose(),
            points in prop::collection::vec(vec3(-0.3..0.3), 6..20),
            point in vec3(-1.5..1.5),
        ) {
            let hull = Primitive::new(&Shape::Convex { points: points.clone() }, &pose);
            let Some(reference) = parry3d::shape::ConvexPolyhedron::from_convex_hull(&points) else { return Ok(()) };
            prop_assert!(hull.distance(point) < reference.distance_to_point(&pose, point, true) + 1e-4);
            let Primitive::Hull { faces } = &hull else { return Err(TestCaseError::fail("not a hull")) };
            prop_assert_eq!(hull.distance(pose * points[0]) < 1e-5, true);
            for Face { normal, offset } in faces {
                let on_face = points.iter().map(|p| pose * *p).max_by(|a, b| a.dot(*normal).total_cmp(&b.dot(*normal))).unwrap();
                prop_assert!((hull.distance(on_face + 0.1 * *normal) - 0.1).abs() < 1e-4);
                prop_assert!((on_face.dot(*normal) - offset).abs() < 1e-5);
            }
        }

        #[test]
        fn a_convex_hull_holds_its_points(pose in pose(), points in prop::collection::vec(vec3(-0.3..0.3), 4..9)) {
            let hull = Primitive::new(&Shape::Convex { points: points.clone() }, &pose);
            for point in points {
                prop_assert!(hull.distance(pose * point) < 1e-5);
            }
        }
    }
}
