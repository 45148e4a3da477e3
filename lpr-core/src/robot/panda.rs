//! The Franka Emika Panda with its hand.
//!
//! Kinematics and limits are those of the vendor's interface; link geometry is our own capsules and spheres.

use super::{Capsule, GripperSpec, Joint, JointConfig, Robot, Sphere};
use core::f64::consts::FRAC_PI_2;
use glamx::{DPose3, DQuat, DVec3, Vec2, Vec3};

const fn joint(alpha: f64, a: f64, d: f64, limits: (f32, f32), max_velocity: f32, max_acceleration: f32) -> Joint {
    Joint { alpha, a, d, lower: limits.0, upper: limits.1, max_velocity, max_acceleration }
}

/// Sine and cosine of -π/8: the hand is turned by -45° about the flange's z.
const HAND_TURN: DQuat = DQuat::from_xyzw(0.0, 0.0, -0.382_683_432_365_089_8, 0.923_879_532_511_286_7);

/// Franka Emika Panda.
pub static PANDA: Robot = Robot {
    name: "panda",
    joints: [
        joint(0.0, 0.0, 0.333, (-2.8973, 2.8973), 2.175, 15.0),
        joint(-FRAC_PI_2, 0.0, 0.0, (-1.7628, 1.7628), 2.175, 7.5),
        joint(FRAC_PI_2, 0.0, 0.316, (-2.8973, 2.8973), 2.175, 10.0),
        joint(FRAC_PI_2, 0.0825, 0.0, (-3.0718, -0.0698), 2.175, 12.5),
        joint(-FRAC_PI_2, -0.0825, 0.384, (-2.8973, 2.8973), 2.61, 15.0),
        joint(FRAC_PI_2, 0.0, 0.0, (-0.0175, 3.7525), 2.61, 20.0),
        joint(FRAC_PI_2, 0.088, 0.0, (-2.8973, 2.8973), 2.61, 20.0),
    ],
    link7_from_flange: DPose3 { rotation: DQuat::IDENTITY, translation: DVec3::new(0.0, 0.0, 0.107) },
    flange_from_grip: DPose3 { rotation: HAND_TURN, translation: DVec3::new(0.0, 0.0, 0.1034) },
    gripper: GripperSpec { max_width: 0.08, pad_half_extents: Vec3::new(0.010, 0.004, 0.010), pad_offset_z: 0.0 },
    // RLBench's start: (0, 10, 0, -50, 0, 70, 45) degrees.
    start: JointConfig([0.0, 0.174_533, 0.0, -0.872_665, 0.0, 1.221_73, 0.785_398]),
    workspace_center: Vec2::new(0.52, 0.0),
    spheres: [&[]; 9],
    capsules: [&[]; 9],
    allowed_self_collisions: &[],
};
