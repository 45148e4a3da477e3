//! The gripper of an arm, and the commands to it.

use glamx::Vec3;
use serde::{Deserialize, Serialize};

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
