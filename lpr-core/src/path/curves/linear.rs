//! The straight line of the grip: the first try of the C2F-ARM baseline.

use super::bezier::BezierCurve;
use super::follow::follow;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::robot::{JointConfig, Robot};
use glamx::Pose3;

/// Steps of inverse kinematics along the line, as in the authors' stack.
pub const LINEAR_STEPS: usize = 50;

/// The joint path that moves the grip from `start` straight to `goal` (`world_from_grip`), turning
/// at constant speed.
///
/// ```
/// use lpr_core::path::{LINEAR_STEPS, Rejection, linear_path};
/// use lpr_core::robot::XARM7;
///
/// let start = XARM7.grip(&XARM7.start);
/// let mut goal = start;
/// goal.translation.z -= 0.1;
/// let path = linear_path(&XARM7, &XARM7.start, &goal)?;
/// assert!(path.configs().len() > LINEAR_STEPS);
/// for config in path.configs() {
///     let aside = XARM7.grip(config).translation - start.translation;
///     assert!(aside.x.abs() < 1e-3 && aside.y.abs() < 1e-3, "straight down");
/// }
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// When the arm cannot follow to the end: [`Rejection::CurveUnreachable`] or
/// [`Rejection::BranchJump`].
pub fn linear_path(
    robot: &Robot,
    start: &JointConfig,
    goal: &Pose3,
) -> Result<JointPath, Rejection> {
    linear_path_in(LINEAR_STEPS, robot, start, goal)
}

/// [`linear_path`] in `n_steps` steps.
pub(crate) fn linear_path_in(
    n_steps: usize,
    robot: &Robot,
    start: &JointConfig,
    goal: &Pose3,
) -> Result<JointPath, Rejection> {
    let from = robot.grip(start);
    // The curve whose middle control point lies in the middle is the straight line at constant
    // speed.
    let line = BezierCurve::new(&from, 0.5 * (from.translation + goal.translation), goal);
    follow(robot, start, n_steps, |t| line.pose(t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::ROBOTS;
    use glamx::Vec3;

    #[test]
    fn the_grip_moves_straight_in_equal_steps() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let way = Vec3::new(-0.1, 0.15, -0.1);
            let path = linear_path(
                robot,
                &robot.start,
                &Pose3::from_parts(start.translation + way, start.rotation),
            )
            .unwrap();
            assert_eq!(path.configs().len(), LINEAR_STEPS + 1);
            for (i, config) in path.configs().iter().enumerate() {
                let expected = start.translation + way * (i as f32 / LINEAR_STEPS as f32);
                assert!(robot.grip(config).translation.distance(expected) < 1e-4);
            }
        }
    }

    #[test]
    fn a_goal_out_of_reach_is_rejected() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let goal = Pose3::from_parts(start.translation + 2.0 * Vec3::X, start.rotation);
            assert!(matches!(
                linear_path(robot, &robot.start, &goal),
                Err(Rejection::CurveUnreachable { .. })
            ));
        }
    }
}
