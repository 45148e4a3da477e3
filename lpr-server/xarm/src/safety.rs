//! The check before anything is sent: the whole timed path, against where the arm was measured to
//! be and the limits that it must keep.
//!
//! Nothing is clipped: a path is executed as it is or refused with the first rule that it breaks.

mod error;

pub use error::SafetyError;

use core::f32::consts::PI;
use lpr_core::robot::{JointConfig, Robot};
use std::sync::Arc;

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

/// Limits that a path must keep.
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

/// A timed path that keeps every rule: the only kind that is executed.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPath {
    points: Vec<JointConfig>,
    tick_secs: f64,
    margins: Margins,
}

/// Extremes of a path that the limits bound.
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

    /// Its first configuration.
    #[must_use]
    pub fn start(&self) -> &JointConfig {
        &self.points[0]
    }

    /// Its last configuration.
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

    /// Its extremes that the limits bound.
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

/// Checks that the arm is where a path starts.
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
mod tests;
