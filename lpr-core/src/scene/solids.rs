//! Primitives prepared for checks: which of many a ball meets.

use super::Primitive;
use super::primitive::from_segment;
use glamx::{Quat, Vec3};

/// Boxes compared at once. The loops over an array of this size compile to vector instructions, in one order on every machine.
const LANES: usize = 8;

/// Solid obstacles, behind boxes along the world's axes that rule most of them out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Solids {
    list: Vec<Solid>,
    boxes: Vec<Boxes>,
}

/// Boxes around [`LANES`] solids: for every axis the lower and upper ends.
#[derive(Debug, Clone, PartialEq)]
struct Boxes {
    low: [[f32; LANES]; 3],
    high: [[f32; LANES]; 3],
}

impl FromIterator<Primitive> for Solids {
    fn from_iter<I: IntoIterator<Item = Primitive>>(primitives: I) -> Self {
        let list: Vec<Solid> = primitives.into_iter().map(Solid::from).collect();
        let boxes = list.chunks(LANES).map(Boxes::around).collect();
        Self { list, boxes }
    }
}

impl Solids {
    /// The solids.
    pub(super) fn primitives(&self) -> impl Iterator<Item = &Primitive> {
        self.list.iter().map(|solid| &solid.primitive)
    }

    /// Whether any solid that meets the ball around `center` also fulfils `is_hit`.
    pub(super) fn any_near(&self, center: Vec3, radius: f32, is_hit: impl Fn(&Solid) -> bool) -> bool {
        self.boxes.iter().zip(self.list.chunks(LANES)).any(|(boxes, solids)| {
            let gaps = boxes.squared_gaps(center);
            solids.iter().zip(gaps).any(|(solid, gap)| gap <= radius * radius && solid.touches(center, radius) && is_hit(solid))
        })
    }
}

impl Boxes {
    /// Lanes without a solid hold a box at infinity.
    fn around(solids: &[Solid]) -> Self {
        let mut boxes = Self { low: [[f32::INFINITY; LANES]; 3], high: [[f32::INFINITY; LANES]; 3] };
        for (lane, solid) in solids.iter().enumerate() {
            let (center, half) = solid.extent();
            for axis in 0..3 {
                boxes.low[axis][lane] = center[axis] - half[axis];
                boxes.high[axis][lane] = center[axis] + half[axis];
            }
        }
        boxes
    }

    /// Squared distances from `point` to the boxes.
    fn squared_gaps(&self, point: Vec3) -> [f32; LANES] {
        let mut squares = [0.0; LANES];
        for axis in 0..3 {
            let ends = self.low[axis].iter().zip(&self.high[axis]);
            for (square, (low, high)) in squares.iter_mut().zip(ends) {
                let (below, above) = (low - point[axis], point[axis] - high);
                let gap = if below > above { below } else { above };
                let gap = if gap > 0.0 { gap } else { 0.0 };
                *square += gap * gap;
            }
        }
        squares
    }
}

/// A primitive prepared for the question whether a ball meets it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Solid {
    primitive: Primitive,
    /// Axes of a box or cylinder in the world: the dot products with them are quicker than its pose.
    axes: [Vec3; 3],
}

impl From<Primitive> for Solid {
    fn from(primitive: Primitive) -> Self {
        let rotation = match &primitive {
            Primitive::Cuboid { world_from_box: pose, .. } | Primitive::Cylinder { world_from_cylinder: pose, .. } => {
                pose.rotation
            }
            Primitive::Sphere { .. } | Primitive::Capsule { .. } => Quat::IDENTITY,
        };
        Self { primitive, axes: Vec3::AXES.map(|axis| rotation * axis) }
    }
}

impl Solid {
    /// Centre and half extents of the box around the solid along the world's axes, metres.
    fn extent(&self) -> (Vec3, Vec3) {
        /// Rounding of coordinates up to ten metres.
        const MARGIN: f32 = 1e-5;
        let oriented = |half: Vec3| self.axes[0].abs() * half.x + self.axes[1].abs() * half.y + self.axes[2].abs() * half.z;
        let (center, half) = match &self.primitive {
            Primitive::Sphere { center, radius } => (*center, Vec3::splat(*radius)),
            Primitive::Cuboid { world_from_box, half_extents } => (world_from_box.translation, oriented(*half_extents)),
            Primitive::Capsule { a, b, radius } => (0.5 * (*a + *b), 0.5 * (*a - *b).abs() + Vec3::splat(*radius)),
            Primitive::Cylinder { world_from_cylinder, radius, half_length } => {
                (world_from_cylinder.translation, oriented(Vec3::new(*radius, *radius, *half_length)))
            }
        };
        (center, half + MARGIN)
    }

    /// Whether a ball meets the solid. Metres.
    pub(super) fn touches(&self, center: Vec3, ball_radius: f32) -> bool {
        match &self.primitive {
            Primitive::Sphere { center: other, radius } => is_within(center - *other, ball_radius + radius),
            Primitive::Cuboid { world_from_box, half_extents } => {
                let local = self.local(center - world_from_box.translation);
                is_within((local.abs() - *half_extents).max(Vec3::ZERO), ball_radius)
            }
            Primitive::Capsule { a, b, radius } => is_within(from_segment(center, *a, *b), ball_radius + radius),
            Primitive::Cylinder { world_from_cylinder, radius, half_length } => {
                let local = self.local(center - world_from_cylinder.translation);
                let radial = (libm::sqrtf(local.x * local.x + local.y * local.y) - radius).max(0.0);
                is_within(Vec3::new(radial, 0.0, (local.z.abs() - half_length).max(0.0)), ball_radius)
            }
        }
    }

    fn local(&self, offset: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(offset), self.axes[1].dot(offset), self.axes[2].dot(offset))
    }
}

fn is_within(offset: Vec3, reach: f32) -> bool {
    offset.length_squared() <= reach * reach
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use glamx::Pose3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solids_that_a_ball_meets_are_those_within_its_radius(
            placed in prop::collection::vec((prop::array::uniform3(-0.8_f32..0.8), prop::array::uniform3(-3.0_f32..3.0), 0..4_usize), 0..20),
            at in prop::array::uniform3(-1.0_f32..1.0),
            radius in 0.01_f32..0.5,
        ) {
            let shapes = [
                Shape::Sphere { radius: 0.1 },
                Shape::Cuboid { half_extents: Vec3::new(0.3, 0.02, 0.1) },
                Shape::Cylinder { radius: 0.1, half_length: 0.2 },
                Shape::Capsule { radius: 0.05, half_length: 0.2 },
            ];
            let place = |(at, turn, shape): ([f32; 3], [f32; 3], usize)| {
                let pose = Pose3::from_parts(Vec3::from_array(at), Quat::from_scaled_axis(Vec3::from_array(turn)));
                Primitive::new(&shapes[shape], &pose)
            };
            let solids: Solids = placed.into_iter().map(place).collect();
            let center = Vec3::from_array(at);
            let distances: Vec<f32> = solids.primitives().map(|primitive| primitive.distance(center)).collect();
            prop_assume!(distances.iter().all(|distance| (distance - radius).abs() > 1e-5));
            let met = core::cell::RefCell::new(Vec::new());
            solids.any_near(center, radius, |solid| {
                met.borrow_mut().push(solid.primitive.clone());
                false
            });
            let expected: Vec<Primitive> =
                solids.primitives().zip(distances).filter(|(_, distance)| *distance < radius).map(|(p, _)| p.clone()).collect();
            prop_assert_eq!(met.into_inner(), expected);
        }
    }
}
