//! The Franka Emika Panda with its hand.
//!
//! Kinematics and limits are those of the vendor's interface; link geometry is our own capsules and
//! spheres.

use super::built_in::{BuiltIn, BuiltInJoint};
use super::geometry::{capsule, cover};
use super::{Capsule, DhRow, GripperSpec, JointConfig, Robot};
use core::f64::consts::FRAC_PI_2;
use glamx::{DPose3, DQuat, DVec3, Vec2, Vec3};
use std::sync::{Arc, LazyLock};

const fn joint(
    alpha: f64,
    a: f64,
    d: f64,
    limits: (f32, f32),
    max_velocity: f32,
    max_acceleration: f32,
) -> BuiltInJoint {
    BuiltInJoint {
        row: DhRow { alpha, a, d },
        lower: limits.0,
        upper: limits.1,
        max_velocity,
        max_acceleration,
    }
}

/// Sine and cosine of -π/8: the hand is turned by -45° about the flange's z.
const HAND_TURN: DQuat =
    DQuat::from_xyzw(0.0, 0.0, -0.382_683_432_365_089_8, 0.923_879_532_511_286_7);

// Capsules in metres, each in the frame of its link; rough dimensions of the housings.

const BASE: &[Capsule] = &[
    capsule([-0.09, 0.0, 0.07], [0.0, 0.0, 0.07], 0.06),
    capsule([0.0, 0.0, 0.09], [0.0, 0.0, 0.1], 0.06),
];
const LINK1: &[Capsule] = &[capsule([0.0, 0.0, -0.17], [0.0, 0.0, -0.03], 0.06)];
const LINK2: &[Capsule] = &[
    capsule([0.0, 0.0, -0.05], [0.0, 0.0, 0.05], 0.058),
    capsule([0.0, -0.05, 0.0], [0.0, -0.14, 0.0], 0.058),
];
const LINK3: &[Capsule] = &[
    capsule([0.0, 0.0, -0.15], [0.0, 0.0, -0.08], 0.058),
    capsule([0.0, 0.0, -0.07], [0.08, 0.0, 0.0], 0.055),
];
const LINK4: &[Capsule] = &[
    capsule([0.0, 0.0, -0.045], [0.0, 0.0, 0.045], 0.055),
    capsule([-0.01, 0.03, 0.0], [-0.0825, 0.1, 0.0], 0.055),
];
const LINK5: &[Capsule] = &[
    capsule([0.0, 0.0, -0.26], [0.0, 0.0, -0.2], 0.058),
    capsule([0.0, 0.04, -0.19], [0.0, 0.07, -0.01], 0.038),
];
const LINK6: &[Capsule] = &[
    capsule([0.0, 0.0, -0.05], [0.0, 0.0, 0.01], 0.05),
    capsule([0.03, 0.0, 0.0], [0.088, 0.0, 0.0], 0.05),
];
const LINK7: &[Capsule] = &[capsule([0.0, 0.0, 0.02], [0.0, 0.0, 0.07], 0.042)];
/// Along the hand's y, which is turned by -45° about the flange's z.
const HAND: &[Capsule] = &[capsule([-0.049, -0.049, 0.033], [0.049, 0.049, 0.033], 0.034)];
const HAND_WITH_FINGERS: &[Capsule] = &[
    HAND[0],
    capsule([0.0347, 0.0347, 0.063], [0.0347, 0.0347, 0.1], 0.0135),
    capsule([-0.0347, -0.0347, 0.063], [-0.0347, -0.0347, 0.1], 0.0135),
];

/// Neighbours and pairs that never meet within the limits.
const ALLOWED_SELF_COLLISIONS: [(usize, usize); 18] = [
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 4),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 8),
    (0, 2),
    (0, 3),
    (1, 3),
    (1, 4),
    (3, 5),
    (3, 6),
    (4, 6),
    (4, 7),
    (5, 7),
    (6, 8),
];

/// Franka Emika Panda.
pub static PANDA: LazyLock<Arc<Robot>> = LazyLock::new(|| {
    BuiltIn {
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
        link7_from_flange: DPose3 {
            rotation: DQuat::IDENTITY,
            translation: DVec3::new(0.0, 0.0, 0.107),
        },
        flange_from_grip: DPose3 { rotation: HAND_TURN, translation: DVec3::new(0.0, 0.0, 0.1034) },
        gripper: GripperSpec {
            max_width: 0.08,
            pad_half_extents: Vec3::new(0.010, 0.004, 0.010),
            pad_offset_z: 0.0,
            finger_half_extents: Vec3::new(0.010, 0.005, 0.0275),
            finger_offset_z: -0.0175,
        },
        // RLBench's start: (0, 10, 0, -50, 0, 70, 45) degrees.
        start: JointConfig::new([
            0.0,
            0.174_533,
            0.0,
            -0.872_665,
            0.0,
            1.221_73,
            core::f32::consts::FRAC_PI_4,
        ]),
        workspace_center: Vec2::new(0.52, 0.0),
        capsules: [BASE, LINK1, LINK2, LINK3, LINK4, LINK5, LINK6, LINK7, HAND],
        spheres: [
            cover!(BASE),
            cover!(LINK1),
            cover!(LINK2),
            cover!(LINK3),
            cover!(LINK4),
            cover!(LINK5),
            cover!(LINK6),
            cover!(LINK7),
            cover!(HAND_WITH_FINGERS),
        ],
        allowed_self_collisions: &ALLOWED_SELF_COLLISIONS,
    }
    .shared()
});
