//! Signed distances to primitives: how deep a point lies inside one, and which way is out.

use super::primitive::{Primitive, from_segment, length};
use glamx::Vec3;

/// Distance from a point to a surface, negative inside.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::scene::{Primitive, SignedDistance};
///
/// let ball = Primitive::Sphere { center: Vec3::ZERO, radius: 0.5 };
/// let inside = ball.signed_distance(Vec3::new(0.25, 0.0, 0.0));
/// assert_eq!(inside, SignedDistance { distance: -0.25, normal: Vec3::X });
/// // The way out: as far as the point is deep, along the normal.
/// assert_eq!(ball.signed_distance(Vec3::new(0.25, 0.0, 0.0) - inside.distance * inside.normal).distance, 0.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignedDistance {
    /// Distance from the surface, metres; negative inside.
    pub distance: f32,
    /// Unit vector along which the distance grows fastest.
    pub normal: Vec3,
}

impl SignedDistance {
    /// From the surface of a ball: `offset` from its centre.
    pub(super) fn from_ball(offset: Vec3, radius: f32) -> Self {
        let from_center = length(offset);
        // At the very centre every direction leads out.
        let normal = if from_center > 0.0 { offset / from_center } else { Vec3::Z };
        Self { distance: from_center - radius, normal }
    }
}

impl Primitive {
    /// Signed distance from `point` to the surface of the solid: [`Self::distance`] outside.
    ///
    /// Inside it is that to the nearest face, side or end.
    #[must_use]
    pub fn signed_distance(&self, point: Vec3) -> SignedDistance {
        match self {
            Self::Sphere { center, radius } => SignedDistance::from_ball(point - *center, *radius),
            Self::Capsule { a, b, radius } => {
                SignedDistance::from_ball(from_segment(point, *a, *b), *radius)
            }
            Self::Cuboid { world_from_box, half_extents } => {
                let local = world_from_box.inverse_transform_point(point);
                let (distance, normal) = out_of_corner(local.abs() - *half_extents);
                let signs = Vec3::new(sign(local.x), sign(local.y), sign(local.z));
                SignedDistance { distance, normal: world_from_box.rotation * (normal * signs) }
            }
            Self::Cylinder { world_from_cylinder, radius, half_length } => {
                let local = world_from_cylinder.inverse_transform_point(point);
                let side = SignedDistance::from_ball(Vec3::new(local.x, local.y, 0.0), *radius);
                let (distance, normal) = out_of_corner(Vec3::new(
                    side.distance,
                    local.z.abs() - half_length,
                    f32::NEG_INFINITY,
                ));
                let normal = normal.x * level(side.normal) + normal.y * sign(local.z) * Vec3::Z;
                SignedDistance { distance, normal: world_from_cylinder.rotation * normal }
            }
            Self::Hull { faces } => {
                let nowhere = SignedDistance { distance: f32::INFINITY, normal: Vec3::Z };
                let from_faces = faces.iter().map(|face| SignedDistance {
                    distance: face.normal.dot(point) - face.offset,
                    normal: face.normal,
                });
                from_faces.max_by(|a, b| a.distance.total_cmp(&b.distance)).unwrap_or(nowhere)
            }
        }
    }
}

/// Signed distance and unit direction from the region in which no coordinate of `beyond` is
/// positive.
fn out_of_corner(beyond: Vec3) -> (f32, Vec3) {
    let outside = beyond.max(Vec3::ZERO);
    let distance = length(outside);
    if distance > 0.0 {
        (distance, outside / distance)
    } else {
        (beyond.max_element(), Vec3::AXES[beyond.max_position()])
    }
}

const fn sign(value: f32) -> f32 {
    if value < 0.0 { -1.0 } else { 1.0 }
}

/// A direction from the axis of a cylinder; on the axis every level one leads out.
fn level(normal: Vec3) -> Vec3 {
    if normal.z == 0.0 { normal } else { Vec3::X }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use glamx::{Pose3, Quat};
    use parry3d::query::PointQuery as _;
    use parry3d::shape::{Ball, Capsule, Cuboid, Cylinder};
    use proptest::prelude::*;

    fn vec3(range: core::ops::Range<f32>) -> impl Strategy<Value = Vec3> {
        [range.clone(), range.clone(), range].prop_map(Vec3::from_array)
    }

    fn pose() -> impl Strategy<Value = Pose3> {
        (vec3(-0.3..0.3), vec3(-3.0..3.0))
            .prop_map(|(at, turn)| Pose3::from_parts(at, Quat::from_scaled_axis(turn)))
    }

    fn shapes(sizes: Vec3) -> Vec<Shape> {
        let Vec3 { x: radius, z: half_length, .. } = sizes;
        let corners =
            (0..8_u8).map(|i| sizes * Vec3::new(sign_of(i, 1), sign_of(i, 2), sign_of(i, 4)));
        vec![
            Shape::Sphere { radius },
            Shape::Cuboid { half_extents: sizes },
            Shape::Cylinder { radius, half_length },
            Shape::Capsule { radius, half_length },
            Shape::Convex { points: corners.collect() },
        ]
    }

    fn sign_of(corner: u8, bit: u8) -> f32 {
        if corner & bit == 0 { -1.0 } else { 1.0 }
    }

    proptest! {
        #[test]
        fn outside_it_is_the_distance_and_inside_it_is_negative(pose in pose(), sizes in vec3(0.05..0.5), point in vec3(-0.8..0.8)) {
            for shape in shapes(sizes) {
                let solid = Primitive::new(&shape, &pose);
                let (signed, distance) = (solid.signed_distance(point).distance, solid.distance(point));
                prop_assert!((signed.max(0.0) - distance).abs() < 1e-6, "{shape:?}: {signed} instead of {distance}");
            }
        }

        /// parry3d is the reference inside; its cylinder and capsule lie along y.
        #[test]
        fn depths_agree_with_parry(pose in pose(), sizes in vec3(0.05..0.5), share in vec3(-1.0..1.0)) {
            let point = pose * (share * sizes);
            let upright = pose * Pose3::from_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2));
            let Vec3 { x: radius, z: half_length, .. } = sizes;
            let expected = [
                Ball::new(radius).distance_to_point(&pose, point, false),
                Cuboid::new(sizes).distance_to_point(&pose, point, false),
                Cylinder::new(half_length, radius).distance_to_point(&upright, point, false),
                Capsule::new_y(half_length, radius).distance_to_point(&upright, point, false),
                Cuboid::new(sizes).distance_to_point(&pose, point, false),
            ];
            for (shape, expected) in shapes(sizes).iter().zip(expected) {
                let found = Primitive::new(shape, &pose).signed_distance(point).distance;
                prop_assert!((found - expected).abs() < 1e-5, "{shape:?}: {found} instead of {expected}");
            }
        }

        #[test]
        fn a_step_along_the_normal_leads_out_by_its_length(pose in pose(), sizes in vec3(0.05..0.5), point in vec3(-0.8..0.8)) {
            /// Metres.
            const STEP: f32 = 1e-3;
            for shape in shapes(sizes) {
                let solid = Primitive::new(&shape, &pose);
                let here = solid.signed_distance(point);
                prop_assert!((length(here.normal) - 1.0).abs() < 1e-5);
                let out = solid.signed_distance(point + STEP * here.normal).distance;
                prop_assert!((out - here.distance - STEP).abs() < 1e-5, "{shape:?}: {}", out - here.distance);
            }
        }
    }

    #[test]
    fn in_the_middle_of_a_solid_some_way_leads_out() {
        for shape in shapes(Vec3::new(0.3, 0.2, 0.1)) {
            let middle = Primitive::new(&shape, &Pose3::IDENTITY).signed_distance(Vec3::ZERO);
            assert!(
                middle.distance < -0.05 && (length(middle.normal) - 1.0).abs() < 1e-6,
                "{shape:?}: {middle:?}"
            );
        }
    }
}
