//! The world that an agent acts in: the simulator, the real arm, or a toy.

pub use crate::error::Fault;

use crate::error::Result;
use crate::path::JointPath;
use crate::perception::Observation;
use crate::q_attention::NextBestPose;
use crate::robot::{Gripper, Robot};
use core::fmt;
use std::sync::Arc;

/// Macro actions of one episode at most.
pub const EPISODE_LENGTH: usize = 10;

/// The world of an agent: what it can see and do.
///
/// # Faults
///
/// A world can fail: a camera is gone, an arm has latched. Then nobody knows what the last action
/// led to, so the episode is dropped whole: none of its steps enters the replay, and it counts
/// neither as a success nor as a failure of the agent. [`Trainer::step`](crate::train::Trainer)
/// and the functions of [`evaluate`](crate::evaluate) return the error; the caller may go on with
/// a new episode, or stop with a checkpoint.
pub trait Environment {
    /// The arm.
    fn robot(&self) -> &Arc<Robot>;

    /// Starts the episode of scene `seed`.
    ///
    /// # Errors
    ///
    /// When the scene cannot be built or placed.
    fn reset(&mut self, seed: u64) -> Result<()>;

    /// The report of cameras and arm now.
    ///
    /// # Errors
    ///
    /// [`Error::Fault`](crate::Error::Fault) when a camera or the arm does not report.
    fn observe(&mut self) -> Result<Observation>;

    /// One macro action: times the path, follows it, then gives the command to the gripper.
    ///
    /// # Errors
    ///
    /// [`Error::Fault`](crate::Error::Fault) when nobody can tell what the action led to. An action
    /// that the world refuses or ends early is a result: [`StepResult::invalid`].
    fn step(&mut self, path: &JointPath, gripper: Gripper) -> Result<StepResult>;

    /// The demonstrator's next keyframe, for experiments that replace Q-attention
    /// (`--oracle-poses`); an agent with Q-attention never asks.
    fn demonstrated_goal(&self) -> Option<NextBestPose>;
}

/// Reason why an action ended early: a value that users see.
///
/// ```
/// use lpr_core::env::InvalidAction;
///
/// let reason = InvalidAction::JointSpeed { joint: 0 };
/// assert_eq!(reason.name(), "joint_speed", "for counting");
/// assert_eq!(reason.to_string(), "joint 1 exceeded its velocity limit", "for reading");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
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
        /// Time that it would take, seconds.
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
        self.into()
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

/// Result of an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepResult {
    /// 1 when the task is done, else 0.
    pub reward: f32,
    /// The episode ended by success or by an invalid action.
    pub terminated: bool,
    /// The episode ended because it took [`EPISODE_LENGTH`] steps.
    pub truncated: bool,
    /// Reason why the action ended early.
    pub invalid: Option<InvalidAction>,
}

impl StepResult {
    /// An action that ended the episode before it moved anything.
    #[must_use]
    pub const fn refused(invalid: InvalidAction) -> Self {
        Self { reward: 0.0, terminated: true, truncated: false, invalid: Some(invalid) }
    }

    /// True if the episode is over.
    #[must_use]
    pub const fn is_last(&self) -> bool {
        self.terminated || self.truncated
    }

    /// A fixed word for an episode that ended so without success: the name of an invalid action,
    /// `timeout` or `not_done`; none when the task was done.
    #[must_use]
    pub fn failure(&self) -> Option<&'static str> {
        match self.invalid {
            _ if self.reward > 0.0 => None,
            Some(invalid) => Some(invalid.name()),
            None if self.truncated => Some("timeout"),
            None => Some("not_done"),
        }
    }
}
