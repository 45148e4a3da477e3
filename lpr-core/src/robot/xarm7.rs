//! The UFACTORY xArm7 with its two-finger gripper.
//!
//! Kinematics and limits are those of the vendor's robot description (`xarm7.urdf.xacro`), as
//! modified-DH rows; link geometry is our own capsules and spheres.

use super::built_in::{BuiltIn, BuiltInJoint};
use super::geometry::{capsule, cover};
use super::{Capsule, DhRow, GripperSpec, JointConfig, Robot};
use core::f64::consts::FRAC_PI_2;
use glamx::{DPose3, DQuat, DVec3, Vec2, Vec3};
use std::sync::{Arc, LazyLock};

/// Velocity limit of every joint: the vendor's `MoveIt` configuration, rad/s.
const MAX_VELOCITY: f32 = 2.14;
/// Acceleration limit of every joint; the vendor publishes none, so this is our choice, rad/s².
const MAX_ACCELERATION: f32 = 10.0;
const TWO_PI: f32 = core::f32::consts::TAU;

const fn joint(alpha: f64, a: f64, d: f64, lower: f32, upper: f32) -> BuiltInJoint {
    BuiltInJoint {
        row: DhRow { alpha, a, d },
        lower,
        upper,
        max_velocity: MAX_VELOCITY,
        max_acceleration: MAX_ACCELERATION,
    }
}

// Capsules in metres, each in the frame of its link; rough dimensions of the housings.

const BASE: &[Capsule] = &[capsule([0.0, 0.0, 0.075], [0.0, 0.0, 0.12], 0.063)];
const LINK1: &[Capsule] = &[capsule([0.0, 0.0, -0.07], [0.0, 0.0, 0.0], 0.06)];
const LINK2: &[Capsule] = &[
    capsule([0.0, 0.0, -0.02], [0.0, 0.0, 0.02], 0.06),
    capsule([0.0, -0.06, 0.0], [0.0, -0.17, 0.0], 0.055),
];
const LINK3: &[Capsule] = &[
    capsule([0.0, 0.0, -0.08], [0.0, 0.0, -0.05], 0.053),
    capsule([0.0, 0.0, -0.01], [0.0525, 0.0, 0.0], 0.053),
];
const LINK4: &[Capsule] = &[
    capsule([0.0, 0.0, 0.0], [0.0775, -0.07, 0.0], 0.05),
    capsule([0.0775, -0.11, 0.0], [0.0775, -0.17, 0.0], 0.048),
];
const LINK5: &[Capsule] = &[capsule([0.0, 0.0, -0.14], [0.0, 0.0, 0.0], 0.045)];
const LINK6: &[Capsule] = &[
    capsule([0.0, 0.0, 0.0], [0.06, 0.0, 0.0], 0.045),
    capsule([0.076, 0.02, 0.0], [0.076, 0.05, 0.0], 0.04),
];
const LINK7: &[Capsule] = &[capsule([0.0, 0.0, -0.03], [0.0, 0.0, -0.025], 0.036)];
const HAND: &[Capsule] = &[
    capsule([0.0, 0.0, 0.03], [0.0, 0.0, 0.05], 0.038),
    capsule([0.0, -0.045, 0.075], [0.0, 0.045, 0.075], 0.028),
];
const HAND_WITH_FINGERS: &[Capsule] = &[
    HAND[0],
    HAND[1],
    capsule([0.0, 0.0525, 0.105], [0.0, 0.0525, 0.1655], 0.016),
    capsule([0.0, -0.0525, 0.105], [0.0, -0.0525, 0.1655], 0.016),
];

/// Neighbours, link 6 with the hand on its flange, and the pairs that the vendor's `MoveIt`
/// configuration lists as never meeting.
const ALLOWED_SELF_COLLISIONS: [(usize, usize); 19] = [
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 4),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 8),
    (6, 8),
    (0, 2),
    (0, 3),
    (1, 3),
    (1, 4),
    (3, 5),
    (3, 6),
    (3, 7),
    (4, 6),
    (4, 7),
    (5, 7),
];

/// UFACTORY xArm7.
pub static XARM7: LazyLock<Arc<Robot>> = LazyLock::new(|| {
    BuiltIn {
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
        flange_from_grip: DPose3 {
            rotation: DQuat::IDENTITY,
            translation: DVec3::new(0.0, 0.0, 0.172),
        },
        gripper: GripperSpec {
            max_width: 0.085,
            pad_half_extents: Vec3::new(0.011, 0.004, 0.0095),
            pad_offset_z: 0.0,
            finger_half_extents: Vec3::new(0.0125, 0.006, 0.038),
            finger_offset_z: -0.0285,
        },
        start: JointConfig::new([0.0, -0.6, 0.0, 0.9, 0.0, 1.5, 0.0]),
        workspace_center: Vec2::new(0.38, 0.0),
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
