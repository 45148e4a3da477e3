//! Robot arms: two as constants ([`Robot`]: joints, limits, gripper, collision spheres and drawable
//! parts), any other from its description at run time ([`Chain`]: joints, limits and collision
//! spheres).
//!
//! The base is the world frame, z up, table top at z = 0. Joints of the constants are modified-DH
//! rows as in `T = Rx(alpha) Tx(a) Rz(q) Tz(d)`.

mod chain;
mod fit;
mod geometry;
#[cfg(test)]
mod golden;
mod ik;
mod joint_config;
mod kinematics;
mod mesh;
#[cfg(test)]
mod mistake;
mod panda;
mod recognise;
mod srdf;
mod urdf;
mod xarm7;
mod xml;

use crate::error::{Error, Result};

use glamx::{DPose3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

pub use chain::{Chain, ChainJoint, ChainLink, Motion};
pub use fit::MAX_SPHERES;
pub use geometry::{Finger, GripperBox, MAX_OVERSHOOT};
pub use ik::{IkBranches, MAX_STEP_CHANGE};
pub use joint_config::{JointConfig, JointRanges, MAX_JOINTS};
pub use mesh::MeshReader;
pub use panda::PANDA;
pub use xarm7::XARM7;

/// Number of joints of both arms.
pub const DOF: usize = 7;

/// One revolute joint: its modified-DH row and limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// Twist before the joint, radians (a multiple of π/2 for both arms).
    pub alpha: f64,
    /// Offset along the previous x, metres.
    pub a: f64,
    /// Offset along the joint's z, metres.
    pub d: f64,
    /// Lower limit, radians.
    pub lower: f32,
    /// Upper limit, radians.
    pub upper: f32,
    /// Velocity limit, rad/s.
    pub max_velocity: f32,
    /// Acceleration limit, rad/s².
    pub max_acceleration: f32,
}

/// A two-finger gripper whose pads move symmetrically along the grip frame's y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripperSpec {
    /// Distance between the pads when fully open, metres.
    pub max_width: f32,
    /// Half extents of one pad block in the grip frame (x along the pad's width, y its thickness, z
    /// along the finger).
    pub pad_half_extents: Vec3,
    /// Centre of the pads along the grip frame's z, metres (0: pads centred on `grip`).
    pub pad_offset_z: f32,
    /// Half extents of the finger behind a pad, axes as for the pad.
    pub finger_half_extents: Vec3,
    /// Centre of the fingers along the grip frame's z, metres.
    pub finger_offset_z: f32,
}

/// A command to the gripper: the last part of a macro action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gripper {
    /// Open fully.
    Open,
    /// Close until the pads meet resistance.
    Close,
}

/// A sphere fixed to a frame of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre in the frame it belongs to, metres.
    pub center: Vec3,
    /// Radius, metres.
    pub radius: f32,
}

/// Frames that carry geometry: link 0 (base) … link 7, then the hand; the fingers are derived from
/// [`GripperSpec`].
pub const N_LINKS: usize = DOF + 2;

/// Index of the hand among the [`N_LINKS`] frames; its geometry is given in the flange frame.
pub const HAND: usize = DOF + 1;

/// A serial arm with seven revolute joints, a spherical shoulder and a gripper.
///
/// The frame that poses and curves are of is `grip`, between the finger pads; the flange is that
/// far behind it:
///
/// ```
/// use lpr_core::robot::{PANDA, XARM7};
///
/// for robot in [&XARM7, &PANDA] {
///     let behind = robot.flange(&robot.start).translation - robot.grip_f64(&robot.start).translation;
///     assert!((behind.length() - robot.flange_from_grip.translation.z).abs() < 1e-9);
/// }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name on the command line.
    pub name: &'static str,
    /// Joints from the base.
    pub joints: [Joint; DOF],
    /// Flange in the frame of link 7.
    pub link7_from_flange: DPose3,
    /// `grip` (between the pads, z approach, y opening) in the flange frame.
    pub flange_from_grip: DPose3,
    /// The gripper.
    pub gripper: GripperSpec,
    /// Configuration in which episodes start.
    pub start: JointConfig,
    /// Centre of the workspace on the table, metres.
    pub workspace_center: Vec2,
    /// Physical and drawn geometry per frame: base, links 1–7, hand without fingers (those are
    /// boxes: [`GripperSpec::fingers`]).
    pub capsules: [&'static [Capsule]; N_LINKS],
    /// Collision spheres per frame: they cover the capsules, the hand's the open fingers too, by at
    /// most [`MAX_OVERSHOOT`].
    pub spheres: [&'static [Sphere]; N_LINKS],
    /// Pairs of frames (the lower first) that are never tested against each other: neighbours,
    /// pairs that overlap in every configuration and pairs that cannot meet.
    pub allowed_self_collisions: &'static [(usize, usize)],
}

/// A capsule of a link between two points of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// One end of the axis, metres.
    pub a: Vec3,
    /// The other end, metres.
    pub b: Vec3,
    /// Radius, metres.
    pub radius: f32,
}

/// The built-in robots; the first is the default.
///
/// ```
/// use lpr_core::robot::ROBOTS;
///
/// assert_eq!(ROBOTS.map(|robot| robot.name), ["xarm7", "panda"]);
/// assert!(ROBOTS.iter().all(|robot| robot.within_limits(&robot.start) && !robot.self_collides(&robot.start)));
/// ```
pub const ROBOTS: [&Robot; 2] = [&XARM7, &PANDA];
