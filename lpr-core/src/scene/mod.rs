//! What the arm must not hit: primitives and the point cloud of a camera, against the robot's spheres.
//!
//! Checks run in f32 without fused operations, so that native code and wasm decide alike. The base link is never tested against
//! the scene, since it does not move.

mod arm_spheres;
mod cloud;
mod motion;
mod obstacles;
mod primitive;
mod shape;
mod solids;
#[cfg(test)]
pub(crate) mod stick_arm;

pub use arm_spheres::ArmSpheres;
pub use cloud::{PointCloud, downsample};
pub use motion::MotionChecker;
pub use obstacles::{
    CONTACT_DISTANCE, HELD_BOX, Holding, ObstacleQuery, POINT_RADIUS, SELF_FILTER_INFLATION, VOXEL, obstacle_scene,
};
pub use primitive::Primitive;
pub use shape::{Part, Shape};

use crate::robot::{HAND, JointConfig, N_LINKS};
use arm_spheres::{Frame, LinkSpheres};
use glamx::Vec3;
use solids::Solids;

/// Obstacles in the world frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    solids: Solids,
    /// Points that links 1–7 must not meet.
    arm_points: PointCloud,
    /// Points that the hand and its fingers must not meet.
    hand_points: PointCloud,
}

impl Scene {
    /// A scene without obstacles.
    #[must_use]
    pub fn empty() -> Self {
        Self::from_primitives(Vec::new())
    }

    /// A scene of solid obstacles.
    #[must_use]
    pub fn from_primitives(primitives: Vec<Primitive>) -> Self {
        let no_points = PointCloud::new(&[], 0.0);
        Self { solids: primitives.into_iter().collect(), arm_points: no_points.clone(), hand_points: no_points }
    }

    /// A scene of balls of `point_radius` (metres) around `points`.
    #[must_use]
    pub fn from_points(points: &[Vec3], point_radius: f32) -> Self {
        Self::empty().with_points(points, point_radius)
    }

    /// The same solids among balls of `point_radius` (metres) around `points`.
    #[must_use]
    pub fn with_points(self, points: &[Vec3], point_radius: f32) -> Self {
        let cloud = PointCloud::new(points, point_radius);
        Self { arm_points: cloud.clone(), hand_points: cloud, ..self }
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

    /// Whether the arm at `config` meets neither the scene nor itself.
    #[must_use]
    pub fn is_free(&self, arm: &ArmSpheres, config: &JointConfig) -> bool {
        let frames = arm.frames(config);
        // From the hand inwards: what sticks out furthest hits first.
        let meets_scene = (1..N_LINKS).rev().any(|link| self.meets_link(link, &frames[link], arm.link(link)));
        !meets_scene && !arm.self_collides(&frames)
    }

    fn meets_link(&self, link: usize, frame: &Frame, LinkSpheres { bound, spheres }: &LinkSpheres) -> bool {
        let points = if link == HAND { &self.hand_points } else { &self.arm_points };
        let center = frame.point(bound.center);
        !points.is_surely_clear(center, bound.radius)
            && spheres.iter().any(|sphere| points.touches(frame.point(sphere.center), sphere.radius))
            || self.solids.any_near(center, bound.radius, |solid| {
                spheres.iter().any(|sphere| solid.touches(frame.point(sphere.center), sphere.radius))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::stick_arm::{is_free_by_brute_force, stick_arm};
    use super::*;
    use glamx::{Pose3, Quat};
    use proptest::prelude::*;

    fn config() -> impl Strategy<Value = JointConfig> {
        prop::array::uniform7(-2.5_f32..2.5).prop_map(JointConfig)
    }

    fn obstacle() -> impl Strategy<Value = Vec3> {
        [-0.9_f32..0.9, -0.9..0.9, 0.0..1.2].prop_map(Vec3::from_array)
    }

    /// Left out: configurations that are decided by less than the f32 kinematics resolve.
    fn check(scene: &Scene, config: &JointConfig) -> Result<(), TestCaseError> {
        const ROUNDING: f32 = 2e-5;
        let robot = stick_arm();
        let expected = is_free_by_brute_force(&robot, scene, config, 0.0);
        prop_assume!([-ROUNDING, ROUNDING].iter().all(|&m| is_free_by_brute_force(&robot, scene, config, m) == expected));
        prop_assert_eq!(scene.is_free(&ArmSpheres::new(&robot), config), expected);
        Ok(())
    }

    proptest! {
        #[test]
        fn checks_agree_with_brute_force_in_clouds(config in config(), points in prop::collection::vec(obstacle(), 0..40)) {
            let mut scene = Scene::from_points(&points, 0.02);
            scene.hand_points = PointCloud::new(&points[points.len() / 2..], 0.02);
            check(&scene, &config)?;
        }

        #[test]
        fn checks_agree_with_brute_force_among_primitives(
            config in config(),
            at in prop::collection::vec(obstacle(), 4),
            turn in prop::array::uniform3(-3.0_f32..3.0),
            size in 0.03_f32..0.2,
        ) {
            let rotation = Quat::from_scaled_axis(Vec3::from_array(turn));
            let shapes = [
                Shape::Sphere { radius: size },
                Shape::Cuboid { half_extents: Vec3::new(size, 0.05, 0.5 * size) },
                Shape::Cylinder { radius: size, half_length: 0.1 },
                Shape::Capsule { radius: 0.5 * size, half_length: size },
            ];
            let placed = shapes.iter().zip(at).map(|(shape, at)| Primitive::new(shape, &Pose3::from_parts(at, rotation)));
            check(&Scene::from_primitives(placed.collect()), &config)?;
        }
    }

    #[test]
    fn the_arm_that_folds_into_itself_is_not_free_and_its_start_is() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        assert!(Scene::empty().is_free(&arm, &robot.start));
        let folded = JointConfig([0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]);
        assert!(!Scene::empty().is_free(&arm, &folded));
    }
}
