//! The straight line of the grip: the first try of the C2F-ARM baseline.

use super::bezier::BezierCurve;
use super::follow::follow;
use super::{JointPath, Rejection};
use crate::robot::{JointConfig, Robot};
use glamx::Pose3;

/// Steps of inverse kinematics along the line, as in the authors' stack.
pub const LINEAR_STEPS: usize = 50;

/// The joint path that moves the grip from `start` straight to `goal` (`world_from_grip`), turning at constant speed.
///
/// # Errors
///
/// When the arm cannot follow to the end: [`Rejection::CurveUnreachable`] or [`Rejection::BranchJump`].
pub fn linear_path(robot: &Robot, start: &JointConfig, goal: &Pose3) -> Result<JointPath, Rejection> {
    let from = robot.grip(start);
    // The curve whose middle control point lies in the middle is the straight line at constant speed.
    let line = BezierCurve::new(&from, 0.5 * (from.translation + goal.translation), goal);
    follow(robot, start, LINEAR_STEPS, |t| line.pose(t))
}
