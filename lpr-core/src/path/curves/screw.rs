//! Screw motions of the grip: a turn about an axis in space together with a slide along it, as
//! lids, handles and drawers ask for.
//!
//! Beyond the paper, whose curves are quadratic Béziers only.

use super::follow::follow;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::robot::{JointConfig, Robot};
use glamx::{Pose3, Quat, Vec3};

/// Way of the grip between two samples, metres, and its turn, radians.
const SPACING: (f32, f32) = (0.01, 2.5 * core::f32::consts::PI / 180.0);

/// Fewest and most samples.
const SAMPLES: (usize, usize) = (20, 200);

/// A turn of the grip by less is none, radians: the axis would be anywhere.
const LEAST_TURN: f32 = 1e-4;

/// A motion of the grip about and along an axis, at constant speed. World frame.
///
/// Opening a lid: a quarter turn about a hinge 30 cm from the grip.
///
/// ```
/// use core::f32::consts::FRAC_PI_2;
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::path::ScrewMotion;
///
/// let start = Pose3::translation(0.5, 0.0, 0.1);
/// let hinge = Vec3::new(0.8, 0.0, 0.1);
/// let opening = ScrewMotion { start, point: hinge, direction: Vec3::Y, angle: FRAC_PI_2, slide: 0.0 };
/// assert!(opening.pose(1.0).translation.distance(Vec3::new(0.8, 0.0, 0.4)) < 1e-6, "above the hinge");
///
/// // The same motion, from its ends alone.
/// let found = ScrewMotion::between(&start, &opening.pose(1.0));
/// assert!((found.angle - FRAC_PI_2).abs() < 1e-5 && found.direction.distance(Vec3::Y) < 1e-5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScrewMotion {
    /// `world_from_grip` at the start.
    pub start: Pose3,
    /// A point of the axis, metres.
    pub point: Vec3,
    /// Direction of the axis, of length 1.
    pub direction: Vec3,
    /// The whole turn about the direction, radians; more than a half turn is possible.
    pub angle: f32,
    /// The whole way along the direction, metres.
    pub slide: f32,
}

impl ScrewMotion {
    /// The screw motion that leads from one `world_from_grip` to another with a turn of at most
    /// half (Chasles): its axis is the only one that does. A mere shift is a slide.
    #[must_use]
    pub fn between(start: &Pose3, goal: &Pose3) -> Self {
        let turn = goal.rotation * start.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let sine = libm::sqrtf(turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
        let angle = 2.0 * libm::atan2f(sine, turn.w);
        let shift = goal.translation - turn * start.translation;
        if angle < LEAST_TURN {
            let way = goal.translation - start.translation;
            let slide = libm::sqrtf(way.dot(way));
            let direction = if slide > 0.0 { way / slide } else { Vec3::Z };
            return Self { start: *start, point: start.translation, direction, angle: 0.0, slide };
        }
        let direction = Vec3::new(turn.x, turn.y, turn.z) / sine;
        let slide = direction.dot(shift);
        let across = shift - slide * direction;
        // Half of the way across is on one side of the axis, half on the other, seen from it under
        // half of the angle.
        let point = 0.5 * (across + direction.cross(across) * (turn.w / sine));
        Self { start: *start, point, direction, angle, slide }
    }

    /// `world_from_grip` at the share `t` of the motion, 0 to 1.
    #[must_use]
    pub fn pose(&self, t: f32) -> Pose3 {
        let half = 0.5 * self.angle * t;
        let turn = libm::sinf(half) * self.direction;
        let turn = Quat::from_xyzw(turn.x, turn.y, turn.z, libm::cosf(half));
        let from_axis = turn * (self.start.translation - self.point);
        let position = self.point + from_axis + (self.slide * t) * self.direction;
        Pose3::from_parts(position, turn * self.start.rotation)
    }

    /// The joint path that follows the motion from `start`, whose grip is at the motion's start.
    ///
    /// # Errors
    ///
    /// When the arm cannot follow to the end: [`Rejection::CurveUnreachable`] or
    /// [`Rejection::BranchJump`].
    pub fn to_joints(&self, robot: &Robot, start: &JointConfig) -> Result<JointPath, Rejection> {
        follow(robot, start, self.n_steps(), |t| self.pose(t))
    }

    fn n_steps(&self) -> usize {
        let lever = (self.start.translation - self.point).cross(self.direction);
        let arc = self.angle * libm::sqrtf(lever.dot(lever));
        let way = libm::sqrtf(arc * arc + self.slide * self.slide);
        let steps = libm::ceilf((way / SPACING.0).max(self.angle.abs() / SPACING.1));
        (steps as usize).clamp(SAMPLES.0, SAMPLES.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::ROBOTS;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose3> {
        (prop::array::uniform3(-1.0_f32..1.0), prop::array::uniform3(-2.0_f32..2.0)).prop_map(
            |(at, turn)| {
                Pose3::from_parts(
                    Vec3::from_array(at),
                    Quat::from_scaled_axis(Vec3::from_array(turn)),
                )
            },
        )
    }

    proptest! {
        #[test]
        fn it_leads_from_start_to_goal_about_and_along_one_axis(start in pose(), goal in pose(), t in 0.0_f32..1.0) {
            let screw = ScrewMotion::between(&start, &goal);
            prop_assume!(screw.angle > 0.05 && screw.angle < 3.0);
            let end = screw.pose(1.0);
            prop_assert!(end.translation.distance(goal.translation) < 1e-4);
            prop_assert!(end.rotation.angle_between(goal.rotation) < 2e-3);
            prop_assert!(screw.pose(0.0).translation.distance(start.translation) < 1e-6);
            // The distance from the axis stays, the way along it and the turn grow evenly.
            let from_axis = |pose: &Pose3| (pose.translation - screw.point).cross(screw.direction).length();
            let along = |pose: &Pose3| (pose.translation - start.translation).dot(screw.direction);
            let middle = screw.pose(t);
            prop_assert!((from_axis(&middle) - from_axis(&start)).abs() < 1e-4);
            prop_assert!((along(&middle) - t * screw.slide).abs() < 1e-4);
            prop_assert!((middle.rotation.angle_between(start.rotation) - t * screw.angle).abs() < 2e-3);
        }

        #[test]
        fn a_mere_shift_is_a_straight_slide(start in pose(), way in prop::array::uniform3(-1.0_f32..1.0), t in 0.0_f32..1.0) {
            let way = Vec3::from_array(way);
            let screw = ScrewMotion::between(&start, &Pose3::from_parts(start.translation + way, start.rotation));
            prop_assert!(screw.pose(t).translation.distance(start.translation + t * way) < 1e-5);
            prop_assert_eq!(screw.pose(t).rotation, start.rotation);
        }
    }

    #[test]
    fn joints_follow_a_door_about_its_hinge() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let hinge = start.translation + Vec3::new(0.0, 0.25, 0.0);
            let screw =
                ScrewMotion { start, point: hinge, direction: -Vec3::Z, angle: 0.6, slide: 0.0 };
            let path = screw.to_joints(robot, &robot.start).unwrap();
            for config in path.configs() {
                let grip = robot.grip(config);
                assert!((grip.translation.distance(hinge) - 0.25).abs() < 2e-4, "{}", robot.name);
                assert!((grip.translation.z - start.translation.z).abs() < 2e-4);
            }
            let turned = robot.grip(path.goal()).rotation.angle_between(start.rotation);
            assert!((turned - 0.6).abs() < 2e-3, "{}: {turned}", robot.name);
        }
    }

    #[test]
    fn a_motion_out_of_reach_is_rejected() {
        for robot in ROBOTS {
            let start = robot.grip(&robot.start);
            let away = ScrewMotion {
                start,
                point: start.translation,
                direction: Vec3::X,
                angle: 0.0,
                slide: 2.0,
            };
            assert!(
                matches!(
                    away.to_joints(robot, &robot.start),
                    Err(Rejection::CurveUnreachable { .. })
                ),
                "{}",
                robot.name
            );
        }
    }
}
