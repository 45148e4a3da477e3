//! Primitive shapes: the same values build colliders, pictures and drawings.

use glamx::{Pose3, Vec3};
use serde::{Deserialize, Serialize};

/// A convex primitive around its own origin. Lengths in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius.
        radius: f32,
    },
    /// A box.
    Cuboid {
        /// Half the side lengths along x, y, z.
        half_extents: Vec3,
    },
    /// A cylinder along its local z.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Half the length along z.
        half_length: f32,
    },
    /// A capsule along its local z: all points within `radius` of the segment ±`half_length`.
    Capsule {
        /// Radius.
        radius: f32,
        /// Half the length of the segment.
        half_length: f32,
    },
    /// The convex hull of a few points.
    Convex {
        /// Points whose hull it is.
        points: Vec<Vec3>,
    },
}

/// A shape placed in the frame of the body or link that it belongs to, with its colour.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::scene::{Part, Primitive, Shape};
///
/// // A knob 3 cm in front of its drawer, which stands half a metre ahead.
/// let knob = Part::new(Shape::Sphere { radius: 0.01 }, Pose3::translation(-0.03, 0.0, 0.0), [200, 160, 40]);
/// let world_from_drawer = Pose3::translation(0.5, 0.0, 0.2);
/// let solid = Primitive::new(&knob.shape, &(world_from_drawer * knob.pose));
/// assert!((solid.distance(Vec3::new(0.4, 0.0, 0.2)) - 0.06).abs() < 1e-6);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// The geometry.
    pub shape: Shape,
    /// Pose of the shape in the frame of its owner (`owner_from_shape`).
    pub pose: Pose3,
    /// Colour, sRGB.
    pub rgb: [u8; 3],
}

impl Part {
    /// A part from its shape, pose and colour.
    #[must_use]
    pub const fn new(shape: Shape, pose: Pose3, rgb: [u8; 3]) -> Self {
        Self { shape, pose, rgb }
    }
}
