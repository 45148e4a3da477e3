//! Primitives prepared for checks: which of many a ball meets, for every lane at once.

use super::frames::Frames;
use super::link_spheres::{LinkBits, LinkGroup, LinkSpheres};
use super::primitive::{Face, Primitive};
use crate::lanes::Vec3s;
use crate::robot::Sphere;
use fearless_simd::{Simd, SimdBase as _, SimdFloat, SimdMask as _};
use glamx::{Pose3, Quat, Vec3};

/// A direction of a box or cylinder this close to the vertical is vertical.
const UPRIGHT_SLACK: f32 = 1e-6;

/// Solid obstacles by kind, each kind sorted by distance from the base.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Solids {
    primitives: Vec<Primitive>,
    /// Bits of the links that may touch each primitive, as in its tag.
    allowed: Vec<LinkBits>,
    balls: Vec<Ball>,
    upright_boxes: Vec<UprightBox>,
    boxes: Vec<OrientedBox>,
    capsules: Vec<CapsuleAxis>,
    cylinders: Vec<OrientedCylinder>,
    hulls: Vec<HullFaces>,
}

/// Numbers that every kind of solid has.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tag {
    /// Index of the primitive.
    primitive: usize,
    /// Distance of the nearest point from the origin of the world, metres.
    nearest: f32,
    /// Bits of the links that may touch it.
    allowed: LinkBits,
}

#[derive(Debug, Clone, PartialEq)]
struct Ball {
    tag: Tag,
    center: Vec3,
    radius: f32,
}

/// A box whose third axis is vertical.
#[derive(Debug, Clone, PartialEq)]
struct UprightBox {
    tag: Tag,
    center: Vec3,
    /// The box's first axis in the horizontal plane.
    cos: f32,
    sin: f32,
    half_extents: Vec3,
}

#[derive(Debug, Clone, PartialEq)]
struct OrientedBox {
    tag: Tag,
    center: Vec3,
    axes: [Vec3; 3],
    half_extents: Vec3,
}

#[derive(Debug, Clone, PartialEq)]
struct CapsuleAxis {
    tag: Tag,
    a: Vec3,
    axis: Vec3,
    inverse_squared_length: f32,
    radius: f32,
}

#[derive(Debug, Clone, PartialEq)]
struct OrientedCylinder {
    tag: Tag,
    center: Vec3,
    axes: [Vec3; 3],
    radius: f32,
    half_length: f32,
}

#[derive(Debug, Clone, PartialEq)]
struct HullFaces {
    tag: Tag,
    faces: Vec<Face>,
}

impl FromIterator<Primitive> for Solids {
    fn from_iter<I: IntoIterator<Item = Primitive>>(primitives: I) -> Self {
        let mut solids = Self::default();
        primitives.into_iter().for_each(|primitive| solids.push(primitive));
        solids.balls.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids.upright_boxes.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids.boxes.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids.capsules.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids.cylinders.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids.hulls.sort_by(|a, b| a.tag.nearest.total_cmp(&b.tag.nearest));
        solids
    }
}

impl Solids {
    fn push(&mut self, primitive: Primitive) {
        /// Rounding of coordinates up to ten metres.
        const MARGIN: f32 = 1e-5;
        let tag = Tag {
            primitive: self.primitives.len(),
            nearest: primitive.distance(Vec3::ZERO) - MARGIN,
            allowed: 0,
        };
        match &primitive {
            _ if !primitive.is_sound() => self.fill_space(),
            Primitive::Sphere { center, radius } => {
                self.balls.push(Ball { tag, center: *center, radius: *radius });
            }
            Primitive::Cuboid { world_from_box, half_extents } => {
                self.push_box(tag, world_from_box, *half_extents);
            }
            Primitive::Capsule { a, b, radius } => {
                let axis = *b - *a;
                let inverse_squared_length = 1.0 / axis.dot(axis).max(f32::MIN_POSITIVE);
                self.capsules.push(CapsuleAxis {
                    tag,
                    a: *a,
                    axis,
                    inverse_squared_length,
                    radius: *radius,
                });
            }
            Primitive::Cylinder { world_from_cylinder, radius, half_length } => {
                self.cylinders.push(OrientedCylinder {
                    tag,
                    center: world_from_cylinder.translation,
                    axes: axes(world_from_cylinder.rotation),
                    radius: *radius,
                    half_length: *half_length,
                });
            }
            Primitive::Hull { faces } => self.hulls.push(HullFaces { tag, faces: faces.clone() }),
        }
        self.primitives.push(primitive);
        self.allowed.push(0);
    }

    /// Puts something everywhere: of what makes no sense nobody knows where it is.
    pub(super) fn fill_space(&mut self) {
        let tag = Tag { primitive: usize::MAX, nearest: f32::NEG_INFINITY, allowed: 0 };
        self.balls.insert(0, Ball { tag, center: Vec3::ZERO, radius: f32::INFINITY });
    }

    fn push_box(&mut self, tag: Tag, world_from_box: &Pose3, half_extents: Vec3) {
        let (center, axes) = (world_from_box.translation, axes(world_from_box.rotation));
        if axes[2].x.abs().max(axes[2].y.abs()) < UPRIGHT_SLACK {
            let (cos, sin) = (axes[0].x, axes[0].y);
            self.upright_boxes.push(UprightBox { tag, center, cos, sin, half_extents });
        } else {
            self.boxes.push(OrientedBox { tag, center, axes, half_extents });
        }
    }

    /// Lets the links of `bits` touch a primitive.
    pub(super) fn allow(&mut self, primitive: usize, bits: LinkBits) {
        let tags = self.balls.iter_mut().map(|solid| &mut solid.tag);
        let tags = tags.chain(self.upright_boxes.iter_mut().map(|solid| &mut solid.tag));
        let tags = tags.chain(self.boxes.iter_mut().map(|solid| &mut solid.tag));
        let tags = tags.chain(self.capsules.iter_mut().map(|solid| &mut solid.tag));
        let tags = tags.chain(self.cylinders.iter_mut().map(|solid| &mut solid.tag));
        let tags = tags.chain(self.hulls.iter_mut().map(|solid| &mut solid.tag));
        tags.filter(|tag| tag.primitive == primitive).for_each(|tag| tag.allowed |= bits);
        self.allowed[primitive] |= bits;
    }

    /// The solids.
    pub(super) fn primitives(&self) -> impl Iterator<Item = &Primitive> {
        self.primitives.iter()
    }

    /// The solids that the link of `bit` must not touch, with their indices.
    pub(super) fn forbidden(&self, bit: LinkBits) -> impl Iterator<Item = (usize, &Primitive)> {
        let solids = self.primitives.iter().enumerate();
        solids.filter(move |(idx, _)| self.allowed[*idx] & bit == 0)
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.primitives.is_empty()
    }

    /// True if in any lane a solid meets a sphere of one of the links of `group`, whose bounding
    /// sphere has its centre at `bound`.
    ///
    /// Of the group, indices into `arm`, those in `links` are looked at; solids that a link may touch
    /// are passed over.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        links: LinkBits,
        group: &LinkGroup,
        arm: &[LinkSpheres],
        frame: &Frames<S>,
        bound: Vec3s<S>,
    ) -> bool {
        let radius = group.bound.radius;
        let furthest = bound.length_squared().reduce_max();
        macro_rules! meet {
            ($kind:expr) => {
                for solid in &$kind {
                    let nearest = solid.tag.nearest - radius;
                    if nearest > 0.0 && nearest * nearest > furthest {
                        break;
                    }
                    let tested = links & !solid.tag.allowed;
                    if tested == 0 || !solid.touches(bound, radius) {
                        continue;
                    }
                    for link in group.links(arm, tested) {
                        let Sphere { center, radius } = link.bound;
                        if !group.is_single() && !solid.touches(frame.point(center), radius) {
                            continue;
                        }
                        for cluster in &link.clusters {
                            let Sphere { center, radius } = cluster.bound;
                            if !solid.touches(frame.point(center), radius) {
                                continue;
                            }
                            for sphere in &cluster.spheres {
                                if solid.touches(frame.point(sphere.center), sphere.radius) {
                                    return true;
                                }
                            }
                        }
                    }
                }
            };
        }
        meet!(self.upright_boxes);
        meet!(self.capsules);
        meet!(self.boxes);
        meet!(self.cylinders);
        meet!(self.balls);
        meet!(self.hulls);
        false
    }
}

// `touches` is true if a ball meets the solid in any lane, for every kind of solid.
impl Ball {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        is_within(center.minus(self.center).length_squared(), radius + self.radius)
    }
}

impl UprightBox {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        let offset = center.minus(self.center);
        let local = [
            offset.x * self.cos + offset.y * self.sin,
            offset.y * self.cos - offset.x * self.sin,
            offset.z,
        ];
        is_within(squared_gap(local, self.half_extents), radius)
    }
}

impl OrientedBox {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        let offset = center.minus(self.center);
        let local = [offset.dot(self.axes[0]), offset.dot(self.axes[1]), offset.dot(self.axes[2])];
        is_within(squared_gap(local, self.half_extents), radius)
    }
}

impl CapsuleAxis {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        let offset = center.minus(self.a);
        let along = (offset.dot(self.axis) * self.inverse_squared_length).max(0.0).min(1.0);
        let nearest =
            Vec3s { x: along * self.axis.x, y: along * self.axis.y, z: along * self.axis.z };
        is_within(offset.sub(nearest).length_squared(), radius + self.radius)
    }
}

impl OrientedCylinder {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        let offset = center.minus(self.center);
        let (x, y, z) =
            (offset.dot(self.axes[0]), offset.dot(self.axes[1]), offset.dot(self.axes[2]));
        let radial = ((x * x + y * y).sqrt() - self.radius).max(0.0);
        let axial = (z.abs() - self.half_length).max(0.0);
        is_within(radial * radial + axial * axial, radius)
    }
}

impl HullFaces {
    #[inline(always)]
    fn touches<S: Simd>(&self, center: Vec3s<S>, radius: f32) -> bool {
        let Some((first, others)) = self.faces.split_first() else { return false };
        let mut furthest = center.dot(first.normal) - first.offset;
        for face in others {
            furthest = furthest.max(center.dot(face.normal) - face.offset);
        }
        furthest.simd_le(radius).any_true()
    }
}

#[inline(always)]
fn is_within<F: SimdFloat<S, Element = f32>, S: Simd>(squared_distance: F, reach: f32) -> bool {
    squared_distance.simd_le(reach * reach).any_true()
}

/// Squared distance of a point in a box's own axes from the box.
#[inline(always)]
fn squared_gap<F: SimdFloat<S, Element = f32>, S: Simd>([x, y, z]: [F; 3], half: Vec3) -> F {
    let (x, y, z) =
        ((x.abs() - half.x).max(0.0), (y.abs() - half.y).max(0.0), (z.abs() - half.z).max(0.0));
    x * x + y * y + z * z
}

/// Axes of a rotated frame in the world.
fn axes(rotation: Quat) -> [Vec3; 3] {
    Vec3::AXES.map(|axis| rotation * axis)
}
