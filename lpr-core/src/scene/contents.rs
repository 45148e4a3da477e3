//! A scene: solids and the points of clouds.

use super::arm_spheres::ArmSpheres;
use super::cloud::PointCloud;
use super::primitive::Primitive;
use super::solids::Solids;
use crate::error::{Error, Result};
use glamx::Vec3;

/// Obstacles in the world frame.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, Primitive, Scene};
///
/// let arm = ArmSpheres::new(&XARM7);
/// assert!(Scene::empty().is_free(&arm, &XARM7.start));
///
/// let in_the_hand = XARM7.grip(&XARM7.start).translation;
/// let ball = Primitive::Sphere { center: in_the_hand, radius: 0.05 };
/// assert!(!Scene::from_primitives(vec![ball]).is_free(&arm, &XARM7.start));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub(super) solids: Solids,
    /// Points that links 1–7 must not meet.
    pub(super) arm_points: PointCloud,
    /// Points that the hand and its fingers must not meet.
    pub(super) hand_points: PointCloud,
}

impl Scene {
    /// A scene without obstacles.
    #[must_use]
    pub fn empty() -> Self {
        Self::from_primitives(Vec::new())
    }

    /// A scene of solid obstacles. With one of which a number is not finite, or a size below 0, no
    /// configuration is free.
    #[must_use]
    pub fn from_primitives(primitives: Vec<Primitive>) -> Self {
        let no_points = PointCloud::new(&[], 0.0);
        Self {
            solids: primitives.into_iter().collect(),
            arm_points: no_points.clone(),
            hand_points: no_points,
        }
    }

    /// A scene of balls of `point_radius` (metres) around `points`.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::robot::PANDA;
    /// use lpr_core::scene::{ArmSpheres, Scene};
    ///
    /// let elbow = PANDA.link_frames(&PANDA.start)[4].translation;
    /// let arm = ArmSpheres::new(&PANDA);
    /// assert!(!Scene::from_points(&[elbow], 0.01).is_free(&arm, &PANDA.start));
    /// assert!(Scene::from_points(&[elbow + Vec3::X, Vec3::NAN], 0.01).is_free(&arm, &PANDA.start));
    /// ```
    #[must_use]
    pub fn from_points(points: &[Vec3], point_radius: f32) -> Self {
        Self::empty().with_points(points, point_radius)
    }

    /// The same solids among balls of `point_radius` (metres) around `points`. With a radius that
    /// is not finite, or below 0, no configuration is free.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::scene::{Primitive, Scene};
    ///
    /// let post = Primitive::Capsule { a: Vec3::X, b: Vec3::new(1.0, 0.0, 1.0), radius: 0.05 };
    /// let scene = Scene::from_primitives(vec![post]).with_points(&[Vec3::Y], 0.01);
    /// assert_eq!((scene.primitives().count(), scene.arm_points().points()), (1, &[Vec3::Y][..]));
    /// ```
    #[must_use]
    pub fn with_points(self, points: &[Vec3], point_radius: f32) -> Self {
        let mut solids = self.solids;
        if !(point_radius.is_finite() && point_radius >= 0.0) {
            solids.fill_space();
        }
        let cloud = PointCloud::new(points, point_radius);
        Self { solids, arm_points: cloud.clone(), hand_points: cloud }
    }

    /// Points that links 1–7 must not meet.
    #[must_use]
    pub const fn arm_points(&self) -> &PointCloud {
        &self.arm_points
    }

    /// Points that the hand and its fingers must not meet.
    #[must_use]
    pub const fn hand_points(&self) -> &PointCloud {
        &self.hand_points
    }

    /// The solid obstacles.
    pub fn primitives(&self) -> impl Iterator<Item = &Primitive> {
        self.solids.primitives()
    }

    /// Lets the link of that name touch one of the primitives, counted in the order in which they
    /// were given.
    ///
    /// The scene is then one for `arm`: other arms number their links otherwise.
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    /// use lpr_core::scene::{ArmSpheres, Primitive, Scene};
    ///
    /// let arm = ArmSpheres::new(&XARM7);
    /// let grasped = Primitive::Sphere { center: XARM7.grip(&XARM7.start).translation, radius: 0.05 };
    /// let mut scene = Scene::from_primitives(vec![grasped]);
    /// assert!(!scene.is_free(&arm, &XARM7.start));
    /// scene.allow_contact(&arm, "hand", 0)?;
    /// assert!(scene.is_free(&arm, &XARM7.start));
    ///
    /// let error = scene.allow_contact(&arm, "claw", 0).unwrap_err();
    /// assert_eq!(error.to_string(), "robot: link claw: is none that has spheres");
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When there is no such primitive, or no such link with spheres.
    pub fn allow_contact(&mut self, arm: &ArmSpheres, link: &str, primitive: usize) -> Result<()> {
        let bits = arm.link_bits(link);
        if bits == 0 {
            return Err(Error::Robot(format!("link {link}: is none that has spheres")));
        }
        let n = self.primitives().count();
        if primitive >= n {
            return Err(Error::Environment(format!("primitive {primitive}: the scene has {n}")));
        }
        self.solids.allow(primitive, bits);
        Ok(())
    }
}
