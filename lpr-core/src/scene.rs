//! Obstacles of the arm: primitives and the point cloud of a camera, checked against the robot's
//! spheres.
//!
//! Checks run in f32 without fused operations, so that native code and wasm decide alike. The base
//! link is never tested against the scene, since it does not move.

mod arm_spheres;
mod block;
mod close_pair;
mod cloud;
mod contact;
mod contents;
mod frames;
mod geometry;
mod link_spheres;
mod motion;
mod obstacles;
mod overlaps;
mod primitive;
mod proximity;
mod reach;
mod shape;
mod signed_distance;
mod solids;
#[cfg(test)]
pub(crate) mod stick_arm;
mod sweep;

pub use arm_spheres::ArmSpheres;
pub use cloud::{PointCloud, downsample};
pub use contact::{Contact, Touched};
pub use contents::Scene;
pub use link_spheres::MAX_LINKS;
pub use motion::MotionChecker;
pub use obstacles::{
    CONTACT_DISTANCE, HELD_BOX, Held, ObstacleQuery, POINT_RADIUS, SELF_FILTER_INFLATION, VOXEL,
    observed_obstacles, obstacle_scene,
};
pub use overlaps::{Overlap, OverlapKind, overlaps};
pub use primitive::{Face, Primitive};
pub use proximity::Proximity;
pub use shape::{Part, Shape};
pub use signed_distance::SignedDistance;

#[cfg(test)]
mod tests;
