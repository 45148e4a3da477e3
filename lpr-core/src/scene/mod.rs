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

pub use arm_spheres::ArmSpheres;
pub use cloud::{PointCloud, downsample};
pub use motion::MotionChecker;
pub use obstacles::{
    CONTACT_DISTANCE, HELD_BOX, Holding, ObstacleQuery, POINT_RADIUS, SELF_FILTER_INFLATION, VOXEL, obstacle_scene,
};
pub use primitive::Primitive;
pub use shape::{Part, Shape};

use crate::robot::{HAND, JointConfig, N_LINKS};
use glamx::Vec3;

/// Obstacles in the world frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Solid obstacles.
    pub primitives: Vec<Primitive>,
    /// Points that links 1–7 must not meet.
    pub arm_points: PointCloud,
    /// Points that the hand and its fingers must not meet.
    pub hand_points: PointCloud,
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
        Self { primitives, arm_points: PointCloud::new(&[], 0.0), hand_points: PointCloud::new(&[], 0.0) }
    }

    /// A scene of balls of `point_radius` (metres) around `points`.
    #[must_use]
    pub fn from_points(points: &[Vec3], point_radius: f32) -> Self {
        let cloud = PointCloud::new(points, point_radius);
        Self { primitives: Vec::new(), arm_points: cloud.clone(), hand_points: cloud }
    }

    /// Whether the arm at `config` meets neither the scene nor itself.
    #[must_use]
    pub fn is_free(&self, arm: &ArmSpheres, config: &JointConfig) -> bool {
        let frames = arm.frames(config);
        // From the hand inwards: what sticks out furthest hits first.
        let meets_scene = (1..N_LINKS).rev().any(|link| {
            let (frame, spheres) = (&frames[link], arm.link(link));
            let bound = &spheres.bound;
            !self.is_surely_clear(link, frame.point(bound.center), bound.radius)
                && spheres.spheres.iter().any(|sphere| self.touches(link, frame.point(sphere.center), sphere.radius))
        });
        !meets_scene && !arm.self_collides(&frames)
    }

    const fn points_for(&self, link: usize) -> &PointCloud {
        if link == HAND { &self.hand_points } else { &self.arm_points }
    }

    fn is_surely_clear(&self, link: usize, center: Vec3, radius: f32) -> bool {
        self.points_for(link).is_surely_clear(center, radius)
            && self.primitives.iter().all(|primitive| primitive.distance(center) > radius)
    }

    fn touches(&self, link: usize, center: Vec3, radius: f32) -> bool {
        self.points_for(link).touches(center, radius)
            || self.primitives.iter().any(|primitive| primitive.distance(center) <= radius)
    }
}
