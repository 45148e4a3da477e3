//! The world that an agent acts in: the simulator, the real arm, or a toy.

use crate::error::Result;
use crate::path::JointPath;
use crate::robot::{Gripper, Robot};

/// Why a macro action ended early: a value with a reason that users see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InvalidAction {
    /// A link was pushed into a fixed body.
    Collision {
        /// The link.
        link: &'static str,
        /// Body index in the scene.
        body: usize,
    },
    /// A link pressed harder than the abort force.
    Force {
        /// The link.
        link: &'static str,
        /// The force, newtons.
        newtons: f32,
    },
    /// The path asks a joint for more than its velocity limit.
    JointSpeed {
        /// Joint index.
        joint: usize,
    },
    /// The path does not start where the arm is.
    StartMismatch,
    /// No candidate path exists for the pose.
    NoPath,
}

/// What a macro action led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepResult {
    /// 1 when the task is done, else 0.
    pub reward: f32,
    /// The episode ended by success or by an invalid action.
    pub terminated: bool,
    /// The episode ended because it took too many steps.
    pub truncated: bool,
    /// Why the action ended early.
    pub invalid: Option<InvalidAction>,
}
