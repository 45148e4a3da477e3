//! The world that an agent acts in: the simulator, the real arm, or a toy.

use crate::error::Result;
use crate::path::JointPath;
use crate::perception::Observation;
use crate::q_attention::NextBestPose;
use crate::robot::{Gripper, Robot};
use core::fmt;
use std::sync::Arc;

/// Macro actions of one episode at most.
pub const EPISODE_LENGTH: usize = 10;

/// What an agent can see of a world and do in it.
pub trait Environment {
    /// The arm.
    fn robot(&self) -> &Arc<Robot>;

    /// Starts the episode of scene `seed`.
    ///
    /// # Errors
    ///
    /// When the scene cannot be built or placed.
    fn reset(&mut self, seed: u64) -> Result<()>;

    /// What the cameras and the arm report now.
    fn observe(&mut self) -> Observation;

    /// One macro action: times the path, follows it, then gives the command to the gripper.
    fn step(&mut self, path: &JointPath, gripper: Gripper) -> StepResult;

    /// The demonstrator's next keyframe, for experiments that replace Q-attention
    /// (`--oracle-poses`); an agent never asks.
    fn demonstrated_goal(&self) -> Option<NextBestPose>;
}

/// Why an action ended early: a value with a reason that users see.
///
/// ```
/// use lpr_core::env::InvalidAction;
///
/// let reason = InvalidAction::JointSpeed { joint: 0 };
/// assert_eq!(reason.name(), "joint_speed", "for counting");
/// assert_eq!(reason.to_string(), "joint 1 exceeded its velocity limit", "for reading");
/// ```
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
    /// A joint is asked for more than its velocity limit.
    JointSpeed {
        /// Joint index.
        joint: usize,
    },
    /// The path leaves the joint limits.
    OutsideLimits,
    /// The path takes longer than any task needs.
    TooLong {
        /// How long it would take, seconds.
        seconds: f32,
    },
    /// The path does not start where the arm is.
    StartMismatch,
    /// No candidate path exists for the pose.
    NoPath,
}

impl InvalidAction {
    /// A fixed word for counting reasons.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Collision { .. } => "collision",
            Self::Force { .. } => "force",
            Self::JointSpeed { .. } => "joint_speed",
            Self::OutsideLimits => "outside_limits",
            Self::TooLong { .. } => "too_long",
            Self::StartMismatch => "start_mismatch",
            Self::NoPath => "no_path",
        }
    }
}

impl fmt::Display for InvalidAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Collision { link, body } => write!(f, "{link} went into fixed body {body}"),
            Self::Force { link, newtons } => write!(f, "{link} pressed with {newtons:.0} N"),
            Self::JointSpeed { joint } => {
                write!(f, "joint {} exceeded its velocity limit", joint + 1)
            }
            Self::OutsideLimits => f.write_str("the path leaves the joint limits"),
            Self::TooLong { seconds } => write!(f, "the path takes {seconds:.0} s"),
            Self::StartMismatch => f.write_str("the path does not start where the arm is"),
            Self::NoPath => f.write_str("no candidate path reaches the pose"),
        }
    }
}

/// What an action led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepResult {
    /// 1 when the task is done, else 0.
    pub reward: f32,
    /// The episode ended by success or by an invalid action.
    pub terminated: bool,
    /// The episode ended because it took [`EPISODE_LENGTH`] steps.
    pub truncated: bool,
    /// Why the action ended early.
    pub invalid: Option<InvalidAction>,
}
