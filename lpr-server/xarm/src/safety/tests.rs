//! Every rule with a path that breaks it.

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
        assert_eq!(check(&points, &limits()), Err(SafetyError::NotFinite { index: 1, joint: 3 }));
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
                assert_eq!(index, at);
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
