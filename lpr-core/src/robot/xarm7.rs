//! The UFACTORY xArm7 with its two-finger gripper.
//!
//! Kinematics and limits are those of the vendor's robot description (`xarm7.urdf.xacro`), as modified-DH rows; link geometry is
//! our own capsules and spheres.

use super::{Capsule, GripperSpec, Joint, JointConfig, Robot, Sphere};
use core::f64::consts::FRAC_PI_2;
use glamx::{DPose3, DQuat, DVec3, Vec2, Vec3};

/// Velocity limit of every joint: MoveIt's configuration of the vendor, rad/s.
const MAX_VELOCITY: f32 = 2.14;
/// Acceleration limit of every joint; the vendor publishes none, so this is our choice, rad/s².
const MAX_ACCELERATION: f32 = 10.0;
const TWO_PI: f32 = core::f32::consts::TAU;

const fn joint(alpha: f64, a: f64, d: f64, lower: f32, upper: f32) -> Joint {
    Joint { alpha, a, d, lower, upper, max_velocity: MAX_VELOCITY, max_acceleration: MAX_ACCELERATION }
}

/// UFACTORY xArm7.
pub static XARM7: Robot = Robot {
    name: "xarm7",
    joints: [
        joint(0.0, 0.0, 0.267, -TWO_PI, TWO_PI),
        joint(-FRAC_PI_2, 0.0, 0.0, -2.059, 2.0944),
        joint(FRAC_PI_2, 0.0, 0.293, -TWO_PI, TWO_PI),
        joint(FRAC_PI_2, 0.0525, 0.0, -0.191_98, 3.927),
        joint(FRAC_PI_2, 0.0775, 0.3425, -TWO_PI, TWO_PI),
        joint(FRAC_PI_2, 0.0, 0.0, -1.692_97, core::f32::consts::PI),
        joint(-FRAC_PI_2, 0.076, 0.097, -TWO_PI, TWO_PI),
    ],
    link7_from_flange: DPose3::IDENTITY,
    flange_from_grip: DPose3 { rotation: DQuat::IDENTITY, translation: DVec3::new(0.0, 0.0, 0.172) },
    gripper: GripperSpec { max_width: 0.085, pad_half_extents: Vec3::new(0.011, 0.004, 0.0095), pad_offset_z: 0.0 },
    start: JointConfig([0.0, -0.6, 0.0, 0.9, 0.0, 1.5, 0.0]),
    workspace_center: Vec2::new(0.42, 0.0),
    spheres: [&[]; 9],
    capsules: [&[]; 9],
    allowed_self_collisions: &[],
};
