//! What is checked before anything is sent: the whole timed path, against what was measured and
//! what the arm may do.
//!
//! Nothing is clipped: a path is executed as it is or refused with the first rule that it breaks.

use core::f32::consts::PI;
use lpr_core::robot::{JointConfig, Robot};
use std::sync::Arc;
use thiserror::Error;

/// Distance to keep from every joint limit, radians: 2°.
const LIMIT_MARGIN: f32 = 0.035;
/// Largest distance of a joint between where the arm is and where the path starts, radians: 0.5°.
pub const START_TOLERANCE: f32 = 0.5 * PI / 180.0;
/// Fastest joint for learned agents, rad/s: 60°/s, a third of what the controller allows.
const LEARNED_SPEED: f64 = core::f64::consts::FRAC_PI_3;
/// Fastest point of flange or grip, m/s; the controller stops at 1.2 times that.
const TCP_SPEED: f64 = 1.0;
/// Longest step of flange or grip between two points, metres; the vendor's recommendation.
const TCP_STEP: f64 = 0.01;
/// Lowest point between the finger pads, metres above the table top.
const FLOOR: f64 = 0.0;
/// Rounding of `f32` angles of some radians, which speeds and accelerations magnify by the tick.
const ROUNDING: f64 = 1e-6;

/// What a path must keep.
#[derive(Debug, Clone)]
pub struct SafetyLimits {
    /// The arm, with its joint limits, speeds and accelerations.
    pub robot: Arc<Robot>,
    /// Seconds between two points.
    pub tick_secs: f64,
    /// Distance to keep from every joint limit, radians.
    pub limit_margin: f32,
    /// Largest distance of a joint from the measured configuration to the first point, radians.
    pub start_tolerance: f32,
    /// Fastest joint, rad/s; the robot's own limit applies beside it.
    pub max_joint_speed: f64,
    /// Fastest point of flange or grip, m/s.
    pub max_tcp_speed: f64,
    /// Longest step of flange or grip, metres.
    pub max_tcp_step: f64,
    /// Lowest height of the grip, metres.
    pub floor: f64,
}

impl SafetyLimits {
    /// Those for paths that a learned agent chose.
    #[must_use]
    pub fn learned_agent(robot: &Arc<Robot>, tick_secs: f64) -> Self {
        Self {
            robot: Arc::clone(robot),
            tick_secs,
            limit_margin: LIMIT_MARGIN,
            start_tolerance: START_TOLERANCE,
            max_joint_speed: LEARNED_SPEED,
            max_tcp_speed: TCP_SPEED,
            max_tcp_step: TCP_STEP,
            floor: FLOOR,
        }
    }
}

/// The rule that a path breaks first; joints and points count from 1 and 0.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SafetyError {
    /// Nothing to run.
    #[error("the path has no points")]
    Empty,
    /// A joint angle that is no number.
    #[error("point {index}: joint {joint} is not a finite number")]
    NotFinite {
        /// Point.
        index: usize,
        /// Joint.
        joint: usize,
    },
    /// Too near a joint limit.
    #[error(
        "point {index}: joint {joint} at {angle:.4} rad leaves [{lower:.4}, {upper:.4}], its limits less a margin"
    )]
    JointLimit {
        /// Point.
        index: usize,
        /// Joint.
        joint: usize,
        /// Its angle, radians.
        angle: f32,
        /// Least allowed, radians.
        lower: f32,
        /// Greatest allowed, radians.
        upper: f32,
    },
    /// The arm is elsewhere.
    #[error(
        "the path starts with joint {joint} at {start:.4} rad, the arm has it at {measured:.4} rad: more than {tolerance:.4} apart"
    )]
    Start {
        /// Joint.
        joint: usize,
        /// Of the path, radians.
        start: f32,
        /// Of the arm, radians.
        measured: f32,
        /// Allowed difference, radians.
        tolerance: f32,
    },
    /// A joint would be too fast.
    #[error(
        "point {index}: joint {joint} would move at {speed:.3} rad/s, at most {limit:.3} are allowed"
    )]
    JointSpeed {
        /// Point at which the step ends.
        index: usize,
        /// Joint.
        joint: usize,
        /// rad/s.
        speed: f64,
        /// rad/s.
        limit: f64,
    },
    /// A joint would change its speed too fast.
    #[error(
        "point {index}: joint {joint} would accelerate at {acceleration:.2} rad/s², at most {limit:.2} are allowed"
    )]
    JointAcceleration {
        /// Point in the middle.
        index: usize,
        /// Joint.
        joint: usize,
        /// rad/s².
        acceleration: f64,
        /// rad/s².
        limit: f64,
    },
    /// The tool would go too far in one tick.
    #[error(
        "point {index}: the tool would move {step:.4} m in one tick, at most {limit:.4} are allowed"
    )]
    TcpStep {
        /// Point at which the step ends.
        index: usize,
        /// Metres.
        step: f64,
        /// Metres.
        limit: f64,
    },
    /// The tool would be too fast.
    #[error("point {index}: the tool would move at {speed:.3} m/s, at most {limit:.3} are allowed")]
    TcpSpeed {
        /// Point at which the step ends.
        index: usize,
        /// m/s.
        speed: f64,
        /// m/s.
        limit: f64,
    },
    /// The grip would be too low.
    #[error(
        "point {index}: the grip would be at a height of {height:.4} m, at least {floor:.4} is allowed"
    )]
    Floor {
        /// Point.
        index: usize,
        /// Metres.
        height: f64,
        /// Metres.
        floor: f64,
    },
}

/// A timed path that keeps every rule: the only kind that is executed.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPath {
    points: Vec<JointConfig>,
    tick_secs: f64,
    margins: Margins,
}

/// How near a path comes to what is allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Fastest joint, rad/s.
    pub joint_speed: f64,
    /// Greatest acceleration of a joint, rad/s².
    pub joint_acceleration: f64,
    /// Fastest point of flange or grip, m/s.
    pub tcp_speed: f64,
    /// Lowest height of the grip, metres.
    pub height: f64,
    /// Least distance to a joint limit, radians.
    pub limit_distance: f64,
}

impl CheckedPath {
    /// The points, one a tick.
    #[must_use]
    pub fn points(&self) -> &[JointConfig] {
        &self.points
    }

    /// Where it starts.
    #[must_use]
    pub fn start(&self) -> &JointConfig {
        &self.points[0]
    }

    /// Where it ends.
    #[must_use]
    pub fn goal(&self) -> &JointConfig {
        &self.points[self.points.len() - 1]
    }

    /// Seconds between two points.
    #[must_use]
    pub const fn tick_secs(&self) -> f64 {
        self.tick_secs
    }

    /// Seconds from the first point to the last.
    #[must_use]
    pub fn duration_secs(&self) -> f64 {
        (self.points.len() - 1) as f64 * self.tick_secs
    }

    /// How near it comes to what is allowed.
    #[must_use]
    pub const fn margins(&self) -> &Margins {
        &self.margins
    }
}

/// Checks a timed path, from rest at the arm's `measured` configuration to rest at its end.
///
/// # Errors
///
/// The first rule that it breaks, with point and joint.
pub fn check_path(
    points: Vec<JointConfig>,
    measured: &JointConfig,
    limits: &SafetyLimits,
) -> Result<CheckedPath, SafetyError> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return Err(SafetyError::Empty);
    };
    for (index, point) in points.iter().enumerate() {
        check_joints(index, point, limits)?;
    }
    check_start(first, measured, limits.start_tolerance)?;
    let mut margins = Margins {
        joint_speed: 0.0,
        joint_acceleration: 0.0,
        tcp_speed: 0.0,
        height: f64::INFINITY,
        limit_distance: least_limit_distance(&points, &limits.robot),
    };
    check_speeds(&points, limits, &mut margins)?;
    // At rest before the first point and after the last.
    let padded: Vec<_> = core::iter::once(first).chain(&points).chain([last]).collect();
    check_accelerations(&padded, limits, &mut margins)?;
    check_tool(&points, limits, &mut margins)?;
    let tick_secs = limits.tick_secs;
    Ok(CheckedPath { points, tick_secs, margins })
}

/// Whether the arm is where a path starts.
///
/// # Errors
///
/// When a joint is farther away than `tolerance`, radians.
pub fn check_start(
    start: &JointConfig,
    measured: &JointConfig,
    tolerance: f32,
) -> Result<(), SafetyError> {
    for (joint, (start, measured)) in (1..).zip(start.iter().zip(measured.iter())) {
        let difference = (start - measured).abs();
        if difference.is_nan() || difference > tolerance {
            return Err(SafetyError::Start {
                joint,
                start: *start,
                measured: *measured,
                tolerance,
            });
        }
    }
    Ok(())
}

fn check_joints(
    index: usize,
    point: &JointConfig,
    limits: &SafetyLimits,
) -> Result<(), SafetyError> {
    for (number, (joint, &angle)) in (1..).zip(limits.robot.joints.iter().zip(point.iter())) {
        if !angle.is_finite() {
            return Err(SafetyError::NotFinite { index, joint: number });
        }
        let (lower, upper) = (joint.lower + limits.limit_margin, joint.upper - limits.limit_margin);
        if !(lower..=upper).contains(&angle) {
            return Err(SafetyError::JointLimit { index, joint: number, angle, lower, upper });
        }
    }
    Ok(())
}

fn least_limit_distance(points: &[JointConfig], robot: &Robot) -> f64 {
    let distances = points.iter().flat_map(|point| {
        robot
            .joints
            .iter()
            .zip(point.iter())
            .map(|(joint, angle)| (angle - joint.lower).min(joint.upper - angle))
    });
    f64::from(distances.fold(f32::INFINITY, f32::min))
}

fn check_speeds(
    points: &[JointConfig],
    limits: &SafetyLimits,
    margins: &mut Margins,
) -> Result<(), SafetyError> {
    let dt = limits.tick_secs;
    for (index, pair) in (1..).zip(points.windows(2)) {
        for (j, joint) in limits.robot.joints.iter().enumerate() {
            let speed = (f64::from(pair[1][j]) - f64::from(pair[0][j])).abs() / dt;
            let limit = limits.max_joint_speed.min(f64::from(joint.max_velocity));
            if speed > limit + ROUNDING / dt {
                return Err(SafetyError::JointSpeed { index, joint: j + 1, speed, limit });
            }
            margins.joint_speed = margins.joint_speed.max(speed);
        }
    }
    Ok(())
}

/// Accelerations as second differences; `padded` has one more point at either end.
fn check_accelerations(
    padded: &[&JointConfig],
    limits: &SafetyLimits,
    margins: &mut Margins,
) -> Result<(), SafetyError> {
    let dt = limits.tick_secs;
    for (index, three) in padded.windows(3).enumerate() {
        for (j, joint) in limits.robot.joints.iter().enumerate() {
            let [before, at, after] = [0, 1, 2].map(|i| f64::from(three[i][j]));
            let acceleration = (after - 2.0 * at + before).abs() / (dt * dt);
            let limit = f64::from(joint.max_acceleration);
            if acceleration > limit + ROUNDING / (dt * dt) {
                return Err(SafetyError::JointAcceleration {
                    index,
                    joint: j + 1,
                    acceleration,
                    limit,
                });
            }
            margins.joint_acceleration = margins.joint_acceleration.max(acceleration);
        }
    }
    Ok(())
}

/// Steps, speeds and height of flange and grip.
fn check_tool(
    points: &[JointConfig],
    limits: &SafetyLimits,
    margins: &mut Margins,
) -> Result<(), SafetyError> {
    let SafetyLimits { ref robot, tick_secs, max_tcp_speed, max_tcp_step, floor, .. } = *limits;
    let mut before = None;
    for (index, point) in points.iter().enumerate() {
        let (flange, grip) = (robot.flange(point).translation, robot.grip_f64(point).translation);
        if grip.z < floor {
            return Err(SafetyError::Floor { index, height: grip.z, floor });
        }
        margins.height = margins.height.min(grip.z);
        if let Some((last_flange, last_grip)) = before.replace((flange, grip)) {
            let step = (flange - last_flange).length().max((grip - last_grip).length());
            let speed = step / tick_secs;
            if step > max_tcp_step {
                return Err(SafetyError::TcpStep { index, step, limit: max_tcp_step });
            }
            if speed > max_tcp_speed {
                return Err(SafetyError::TcpSpeed { index, speed, limit: max_tcp_speed });
            }
            margins.tcp_speed = margins.tcp_speed.max(speed);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_core::robot::XARM7;

    fn limits() -> SafetyLimits {
        SafetyLimits::learned_agent(&XARM7, 0.01)
    }

    /// The arm at its start with `angle` more in joint `joint`, which counts from 1.
    fn with(joint: usize, angle: f32) -> JointConfig {
        let mut config = XARM7.start;
        config[joint - 1] += angle;
        config
    }

    fn check(points: &[JointConfig], limits: &SafetyLimits) -> Result<CheckedPath, SafetyError> {
        check_path(points.to_vec(), &XARM7.start, limits)
    }

    /// A start that stands still, a step of joint `joint` and rest, without a limit of acceleration
    /// in the way.
    fn step(joint: usize, angle: f32) -> Vec<JointConfig> {
        // Within the acceleration limit of 10 rad/s²: 1 mrad more a tick.
        let n = (angle.abs() / 1e-3) as i32;
        let sign = angle.signum();
        let mut at = 0.0;
        let mut points = vec![XARM7.start];
        for tick in (1..=n).chain((0..n).rev()) {
            at += sign * tick as f32 * 1e-3;
            points.push(with(joint, at));
        }
        points
    }

    #[test]
    fn a_path_that_keeps_every_rule_is_passed_on_as_it_is() {
        let points = step(1, 4e-3);
        let checked = check(&points, &limits()).unwrap();
        assert_eq!(checked.points(), points);
        let margins = checked.margins();
        assert!((margins.joint_speed - 0.4).abs() < 1e-3, "{margins:?}");
        assert!((margins.joint_acceleration - 10.0).abs() < 0.02, "{margins:?}");
        assert!(margins.height > 0.1 && margins.limit_distance > 1.0, "{margins:?}");
    }

    #[test]
    fn a_path_without_points_is_refused() {
        assert_eq!(check(&[], &limits()), Err(SafetyError::Empty));
    }

    #[test]
    fn an_angle_that_is_no_number_is_refused() {
        for angle in [f32::NAN, f32::INFINITY] {
            let points = [XARM7.start, with(3, angle)];
            assert_eq!(
                check(&points, &limits()),
                Err(SafetyError::NotFinite { index: 1, joint: 3 })
            );
        }
    }

    #[test]
    fn a_joint_near_its_limit_is_refused_with_its_number() {
        let mut near = XARM7.start;
        near[3] = XARM7.joints[3].upper - 0.03;
        let refused = check(&[XARM7.start, near], &limits());
        assert!(
            matches!(refused, Err(SafetyError::JointLimit { index: 1, joint: 4, .. })),
            "{refused:?}"
        );
    }

    #[test]
    fn an_arm_that_is_elsewhere_is_refused_with_the_joint() {
        let measured = with(2, 0.02);
        let refused = check_path(vec![XARM7.start], &measured, &limits()).unwrap_err();
        assert!(matches!(refused, SafetyError::Start { joint: 2, .. }), "{refused}");
        assert!(check_path(vec![XARM7.start], &with(2, 0.008), &limits()).is_ok());
        assert!(check_start(&XARM7.start, &with(1, f32::NAN), 1.0).is_err());
    }

    #[test]
    fn a_joint_that_is_too_fast_is_refused() {
        let refused = check(&step(5, 15e-3), &limits());
        assert!(
            matches!(refused, Err(SafetyError::JointSpeed { joint: 5, index: 11, .. })),
            "{refused:?}"
        );
        let faster = SafetyLimits { max_joint_speed: 3.0, ..limits() };
        assert!(check(&step(5, 15e-3), &faster).is_ok());
    }

    #[test]
    fn a_joint_that_jolts_is_refused_also_at_the_ends() {
        let jolt = with(7, 5e-3);
        for (points, at) in [
            (vec![XARM7.start, XARM7.start, jolt, jolt], 1),
            (vec![XARM7.start, jolt, jolt], 0),
            (vec![XARM7.start, with(7, 1e-3), with(7, 2e-3), with(7, 3e-3)], usize::MAX),
            (vec![XARM7.start, with(7, 1e-3), with(7, 3e-3), with(7, 6e-3)], 3),
        ] {
            match check(&points, &limits()) {
                Err(SafetyError::JointAcceleration { index, joint: 7, .. }) => {
                    assert_eq!(index, at)
                }
                other => assert!(at == usize::MAX && other.is_ok(), "{other:?}"),
            }
        }
    }

    #[test]
    fn a_tool_that_is_too_fast_or_goes_too_far_is_refused() {
        let shorter = SafetyLimits { max_tcp_step: 1e-3, ..limits() };
        let refused = check(&step(1, 4e-3), &shorter);
        assert!(matches!(refused, Err(SafetyError::TcpStep { .. })), "{refused:?}");
        let slower = SafetyLimits { max_tcp_speed: 0.1, ..limits() };
        let refused = check(&step(1, 4e-3), &slower);
        assert!(matches!(refused, Err(SafetyError::TcpSpeed { .. })), "{refused:?}");
    }

    #[test]
    fn a_grip_below_the_floor_is_refused_with_its_height() {
        let height = XARM7.grip_f64(&XARM7.start).translation.z;
        let refused = check(&[XARM7.start], &SafetyLimits { floor: height + 0.01, ..limits() });
        assert_eq!(refused, Err(SafetyError::Floor { index: 0, height, floor: height + 0.01 }));
    }
}
