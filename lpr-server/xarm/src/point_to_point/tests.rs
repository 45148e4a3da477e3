//! Motions of all kinds of starts and limits, against their limits and their ends.

use super::*;
use proptest::prelude::*;

fn config(size: f32) -> impl Strategy<Value = JointConfig> {
    prop::array::uniform7(-size..size).prop_map(JointConfig::new)
}

fn limits() -> impl Strategy<Value = MotionLimits> {
    let limit = |low: f64, high: f64| prop::array::uniform7(low..high);
    (limit(0.3, 3.0), limit(0.5, 20.0), limit(5.0, 5000.0)).prop_map(
        |(velocity, acceleration, jerk)| MotionLimits { velocity, acceleration, jerk: Some(jerk) },
    )
}

/// Shares of what a state may have without leaving its limits later on: speeds that go on
/// growing while the acceleration falls.
fn moving(config: &JointConfig, limits: &MotionLimits, shares: &[[f64; DOF]; 2]) -> JointState {
    let jerk = limits.jerk.unwrap();
    let most =
        |j: usize| limits.acceleration[j].min(libm::sqrt(0.8 * jerk[j] * limits.velocity[j]));
    JointState {
        velocities: core::array::from_fn(|j| 0.5 * shares[0][j] * limits.velocity[j]),
        accelerations: core::array::from_fn(|j| shares[1][j] * most(j)),
        ..JointState::at_rest(config)
    }
}

fn assert_within(trajectory: &PointToPoint, limits: &MotionLimits) -> Result<(), TestCaseError> {
    let step = trajectory.duration_secs() / 500.0;
    for i in 1..500_u16 {
        let t = f64::from(i) * step;
        let (before, state) = (trajectory.at(t - step), trajectory.at(t));
        for j in 0..DOF {
            let jerk = (state.accelerations[j] - before.accelerations[j]) / step;
            prop_assert!(state.velocities[j].abs() <= limits.velocity[j] * (1.0 + 1e-6));
            prop_assert!(state.accelerations[j].abs() <= limits.acceleration[j] * (1.0 + 1e-6));
            prop_assert!(jerk.abs() <= limits.jerk.unwrap()[j] * (1.0 + 1e-6) + 1e-6 / step);
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn from_rest_the_way_is_straight_and_within_limits(start in config(3.0), goal in config(3.0), limits in limits()) {
        let trajectory = point_to_point(&JointState::at_rest(&start), &goal, &limits).unwrap();
        assert_within(&trajectory, &limits)?;
        prop_assert_eq!(trajectory.at(0.0), JointState::at_rest(&start));
        prop_assert_eq!(trajectory.at(trajectory.duration_secs()), JointState::at_rest(&goal));
        for i in 0..=50 {
            let config = trajectory.at(trajectory.duration_secs() * f64::from(i) / 50.0).config();
            let detour = start.distance(&config) + config.distance(&goal) - start.distance(&goal);
            prop_assert!(detour < 1e-5, "{detour}");
        }
    }

    #[test]
    fn a_moving_start_goes_on_and_comes_to_rest(
        start in config(3.0), goal in config(3.0), limits in limits(),
        shares in prop::array::uniform2(prop::array::uniform7(-1.0..1.0_f64)),
    ) {
        let start = moving(&start, &limits, &shares);
        let trajectory = point_to_point(&start, &goal, &limits).unwrap();
        assert_within(&trajectory, &limits)?;
        prop_assert_eq!(trajectory.at(0.0), start);
        let (just_after, just_before) = (trajectory.at(1e-9), trajectory.at(trajectory.duration_secs() * (1.0 - 1e-9)));
        for j in 0..DOF {
            prop_assert!((just_after.velocities[j] - start.velocities[j]).abs() < 1e-6);
            prop_assert!((just_after.angles[j] - start.angles[j]).abs() < 1e-6);
            prop_assert!((just_before.angles[j] - f64::from(goal[j])).abs() < 1e-6);
            prop_assert!(just_before.velocities[j].abs() < 1e-5);
        }
    }

    #[test]
    fn whatever_is_asked_for_is_answered(
        start in prop::array::uniform7(prop::num::f64::ANY), goal in prop::array::uniform7(prop::num::f32::ANY),
        velocities in prop::array::uniform7(-1e6..1e6_f64), exponents in prop::array::uniform3(-9..=12_i32),
    ) {
        let [velocity, acceleration, jerk] = exponents.map(|exponent| [libm::pow(10.0, f64::from(exponent)); DOF]);
        let limits = MotionLimits { velocity, acceleration, jerk: Some(jerk) };
        let start = JointState { velocities, ..standing(start) };
        for goal in [JointConfig::new(goal), JointConfig::new([0.5; DOF])] {
            for start in [start, JointState { velocities, ..standing([0.0; DOF]) }] {
                if let Ok(trajectory) = point_to_point(&start, &goal, &limits) {
                    prop_assert!(trajectory.at(0.5 * trajectory.duration_secs()).is_finite());
                }
            }
        }
    }
}

const LIMITS: MotionLimits =
    MotionLimits { velocity: [2.0; DOF], acceleration: [10.0; DOF], jerk: Some([100.0; DOF]) };

#[test]
fn a_long_way_takes_the_time_of_seven_phases() {
    let at = |x| JointConfig::new([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let duration = |limits| {
        point_to_point(&JointState::at_rest(&at(0.0)), &at(4.0), limits).unwrap().duration_secs()
    };
    // Way over speed, speed over acceleration, acceleration over jerk.
    assert!((duration(&LIMITS) - (2.0 + 0.2 + 0.1)).abs() < 1e-9);
    assert!((duration(&MotionLimits { jerk: None, ..LIMITS }) - (2.0 + 0.2)).abs() < 1e-9);
}

#[test]
fn staying_takes_no_time() {
    let rest = JointConfig::new([0.3; DOF]);
    let trajectory = point_to_point(&JointState::at_rest(&rest), &rest, &LIMITS).unwrap();
    assert_eq!(trajectory.duration_secs(), 0.0);
    assert_eq!(trajectory.at(1.0), JointState::at_rest(&rest));
}

#[test]
fn broken_input_is_told_from_motions_that_are_too_long() {
    let rest = JointState::at_rest(&JointConfig::new([0.3; DOF]));
    let goal = JointConfig::new([0.1; DOF]);
    let is_input = |found: Result<PointToPoint, NoMotion>| matches!(found, Err(NoMotion::Input(_)));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(is_input(point_to_point(
            &rest,
            &goal,
            &MotionLimits { velocity: [bad; DOF], ..LIMITS }
        )));
    }
    assert!(is_input(point_to_point(&rest, &JointConfig::new([f32::NAN; DOF]), &LIMITS)));
    assert!(is_input(point_to_point(
        &JointState { velocities: [f64::INFINITY; DOF], ..rest },
        &goal,
        &LIMITS
    )));
    assert_eq!(
        point_to_point(&rest, &JointConfig::new([1e6; DOF]), &LIMITS).unwrap_err(),
        NoMotion::TooLong
    );
}
