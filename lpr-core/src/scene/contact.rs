//! What the arm touches at a configuration, and how deep: for those who have to know why it is not
//! free.

use super::arm_spheres::ArmSpheres;
use super::contents::Scene;
use super::primitive::Primitive;
use super::proximity::{Near, Placed};
use crate::robot::JointConfig;
use core::fmt;

/// The deepest contact of a configuration.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, Primitive, Scene};
///
/// let around_the_hand = Primitive::Sphere { center: XARM7.grip(&XARM7.start).translation, radius: 0.05 };
/// let (scene, arm) = (Scene::from_primitives(vec![around_the_hand]), ArmSpheres::new(&XARM7));
/// let contact = scene.deepest_contact(&arm, &XARM7.start).unwrap();
/// assert_eq!(contact.link, "hand");
/// assert!(contact.depth > 0.01, "{contact}");
/// assert_eq!(Scene::empty().deepest_contact(&arm, &XARM7.start), None);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Name of the link.
    pub link: String,
    /// What it touches.
    pub with: Touched,
    /// How far one is inside the other, metres.
    pub depth: f32,
}

/// Something that a link touches.
#[derive(Debug, Clone, PartialEq)]
pub enum Touched {
    /// Another link, by name.
    Link(String),
    /// A solid of the scene.
    Solid(Primitive),
    /// Points of a cloud.
    Points,
}

impl Scene {
    /// The deepest contact of the arm at `config` with the scene or itself; none where it is free.
    #[must_use]
    pub fn deepest_contact(&self, arm: &ArmSpheres, config: &JointConfig) -> Option<Contact> {
        if !(config.is_finite() && arm.has_joints_of(config)) {
            return None;
        }
        let placed = Placed::new(arm, config);
        let deepest =
            self.nearest(&placed, 0.0).min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        let with = match deepest.near {
            Near::Link(link) => Touched::Link(link.name().to_owned()),
            Near::Solid(solid) => Touched::Solid(solid.clone()),
            Near::Points => Touched::Points,
        };
        Some(Contact { link: deepest.link.name().to_owned(), with, depth: -deepest.distance })
    }
}

impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "link {} and {}, {:.4} m deep", self.link, self.with, self.depth)
    }
}

impl fmt::Display for Touched {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, [x, y, z]) = match self {
            Self::Link(link) => return write!(f, "link {link}"),
            Self::Points => return f.write_str("points of the cloud"),
            Self::Solid(Primitive::Hull { .. }) => return f.write_str("a hull"),
            Self::Solid(Primitive::Sphere { center, .. }) => ("sphere", center.to_array()),
            Self::Solid(Primitive::Cuboid { world_from_box, .. }) => {
                ("cuboid", world_from_box.translation.to_array())
            }
            Self::Solid(Primitive::Capsule { a, b, .. }) => ("capsule", (0.5 * (a + b)).to_array()),
            Self::Solid(Primitive::Cylinder { world_from_cylinder, .. }) => {
                ("cylinder", world_from_cylinder.translation.to_array())
            }
        };
        write!(f, "the {kind} at {x:.3} {y:.3} {z:.3}")
    }
}
