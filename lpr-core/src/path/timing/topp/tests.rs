//! The motion as a whole, looked at far more densely than it was computed.

use super::envelope::FEW;
use super::grip::Arm;
use super::{SmoothPath, Trajectory, fastest, time_optimal};
use crate::path::joint_path::JointPath;
use crate::path::timing::joint_state::JointState;
use crate::path::timing::motion_limits::{GripSpeedLimit, MotionLimits};
use crate::robot::{DOF, JointConfig, PANDA, ROBOTS};
use proptest::prelude::*;

/// The Panda's, with a tenth of its jerks: ramps of 20 ms.
const LIMITS: MotionLimits = MotionLimits {
    velocity: [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61],
    acceleration: [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
    jerk: Some([750.0, 375.0, 500.0, 625.0, 750.0, 1000.0, 1000.0]),
};

const TOLERANCE: f64 = 1e-6;

/// Angles of a small set beside any: paths with pauses, ways back and lines along one joint.
fn config() -> impl Strategy<Value = JointConfig> {
    let angle = prop_oneof![4 => -2.5_f32..2.5, 1 => Just(0.0), 1 => Just(1.0)];
    prop::array::uniform7(angle).prop_map(JointConfig::new)
}

fn path() -> impl Strategy<Value = JointPath> {
    let anywhere = prop::collection::vec(config(), 2..12);
    let near = (
        config(),
        prop::collection::vec((prop::array::uniform7(-1.0_f32..1.0), -6.0_f32..-0.5), 1..12),
    )
        .prop_map(|(start, steps)| {
            let mut configs = vec![start];
            for (step, exponent) in steps {
                let last = configs[configs.len() - 1];
                let size = libm::powf(10.0, exponent);
                configs.push(JointConfig::from_fn(DOF, |j| last[j] + size * step[j]));
            }
            configs
        });
    let along_a_joint = prop::collection::vec(0..3_u8, 2..9).prop_map(|xs| {
        xs.into_iter()
            .map(|x| JointConfig::new([0.3, f32::from(x), 0.0, -1.0, 0.0, 1.0, 0.0]))
            .collect::<Vec<_>>()
    });
    prop_oneof![4 => anywhere, 2 => near, 1 => along_a_joint]
        .prop_map(|configs| JointPath::new(configs).unwrap())
}

fn limits() -> impl Strategy<Value = MotionLimits> {
    let limit = |low: f64, high: f64| prop::array::uniform7(low..high);
    (limit(0.3, 3.0), limit(0.5, 20.0), prop::option::of(limit(5.0, 5000.0)))
        .prop_map(|(velocity, acceleration, jerk)| MotionLimits { velocity, acceleration, jerk })
}

/// Times of a motion: many within every stretch, both ends of it included.
fn times(path: &SmoothPath, limits: &MotionLimits, grip: Option<&GripSpeedLimit<'_>>) -> Vec<f64> {
    let stretches = fastest::<DOF, FEW>(path, limits, grip).stretches;
    let within = |i: u8| f64::from(i) / 12.0;
    stretches
        .iter()
        .flat_map(|stretch| (0..=12).map(move |i| stretch.since + within(i) * stretch.duration))
        .collect()
}

fn greatest_share(values: &[f64; DOF], limits: &[f64; DOF]) -> f64 {
    values.iter().zip(limits).map(|(value, limit)| value.abs() / limit).fold(0.0, f64::max)
}

fn grip_speed(limit: &GripSpeedLimit<'_>, state: &JointState) -> f64 {
    Arm::of(limit.robot).velocity(&state.angles, &state.velocities).length()
}

/// Rates of the joints' accelerations within a stretch that starts at `since`.
fn jerks(trajectory: &Trajectory, since: f64, duration: f64) -> impl Iterator<Item = [f64; DOF]> {
    let step = duration / 256.0;
    (1..255_u16).map(move |i| {
        let t = since + f64::from(i) * step;
        let (before, after) = (trajectory.at(t - 0.5 * step), trajectory.at(t + 0.5 * step));
        core::array::from_fn(|j| (after.accelerations[j] - before.accelerations[j]) / step)
    })
}

proptest! {
    #[test]
    fn all_limits_hold_everywhere(path in path(), limits in limits(), max_speed in prop::option::of(0.05..2.0_f64)) {
        let smooth = <SmoothPath>::through(&path);
        prop_assume!(smooth.n_pieces() > 0);
        for robot in ROBOTS {
            let grip = max_speed.map(|max_speed| GripSpeedLimit { robot, max_speed });
            let trajectory = time_optimal(&smooth, &limits, grip.as_ref()).unwrap();
            for t in times(&smooth, &limits, grip.as_ref()) {
                let state = trajectory.at(t);
                prop_assert!(state.is_finite());
                prop_assert!(greatest_share(&state.velocities, &limits.velocity) <= 1.0 + TOLERANCE);
                prop_assert!(greatest_share(&state.accelerations, &limits.acceleration) <= 1.0 + TOLERANCE);
                if let Some(grip) = &grip {
                    let speed = grip_speed(grip, &state);
                    prop_assert!(speed <= grip.max_speed * (1.0 + TOLERANCE), "{speed} of {}", grip.max_speed);
                }
            }
        }
    }

    #[test]
    fn with_a_jerk_limit_accelerations_grow_from_nothing_fall_to_nothing_and_do_not_jump_there(
        path in path(), limits in limits(), jerk in prop::array::uniform7(5.0..5000.0_f64),
    ) {
        let smooth = <SmoothPath>::through(&path);
        prop_assume!(smooth.n_pieces() > 0);
        let limits = MotionLimits { jerk: Some(jerk), ..limits };
        let trajectory = time_optimal(&smooth, &limits, None).unwrap();
        let stretches = fastest::<DOF, FEW>(&smooth, &limits, None).stretches;
        let (first, last) = (stretches[0], stretches[stretches.len() - 1]);
        for ramp in [first, last] {
            for jerks in jerks(&trajectory, ramp.since, ramp.duration) {
                let share = greatest_share(&jerks, &jerk);
                prop_assert!(share <= 1.0 + 1e-4, "{share}");
            }
        }
        let jump = |t: f64, step: f64| {
            let (before, after) = (trajectory.at(t - step), trajectory.at(t + step));
            let jump = core::array::from_fn(|j| after.accelerations[j] - before.accelerations[j]);
            greatest_share(&jump, &limits.acceleration)
        };
        let end = trajectory.duration_secs();
        for (t, ramp) in [(0.0, first), (first.duration, first), (last.since, last), (end, last)] {
            let at_step = jump(t, 1e-10 * ramp.duration);
            prop_assert!(at_step < 1e-4, "{at_step} at {t} of {end}");
        }
    }

    #[test]
    fn velocities_and_accelerations_are_those_of_the_angles(path in path(), limits in limits(), share in 0.01..0.99_f64) {
        let smooth = <SmoothPath>::through(&path);
        prop_assume!(smooth.chord_length() > 1e-3);
        let trajectory = time_optimal(&smooth, &limits, None).unwrap();
        let t = share * trajectory.duration_secs();
        let step = 1e-6 * trajectory.duration_secs();
        let (before, state, after) = (trajectory.at(t - step), trajectory.at(t), trajectory.at(t + step));
        for j in 0..DOF {
            let velocity = (after.angles[j] - before.angles[j]) / (2.0 * step);
            prop_assert!((velocity - state.velocities[j]).abs() <= 1e-7 + 2.0 * step * limits.acceleration[j]);
            // Between its jumps the acceleration is the slope of the velocity; across one it is
            // between both.
            let slope = (after.velocities[j] - before.velocities[j]) / (2.0 * step);
            let (low, high) = (before.accelerations[j].min(after.accelerations[j]), before.accelerations[j].max(after.accelerations[j]));
            prop_assert!(slope >= low - 1e-3 * limits.acceleration[j] && slope <= high + 1e-3 * limits.acceleration[j]);
        }
    }

    #[test]
    fn a_motion_starts_and_ends_at_rest_and_goes_along_the_curve_without_turning_back(path in path(), limits in limits()) {
        let smooth = <SmoothPath>::through(&path);
        let trajectory = time_optimal(&smooth, &limits, None).unwrap();
        let end = trajectory.duration_secs();
        prop_assert_eq!(trajectory.at(-1.0), JointState::at_rest(path.start()));
        prop_assert_eq!(trajectory.at(0.0), JointState::at_rest(path.start()));
        for t in [end, end + 1.0, f64::INFINITY] {
            prop_assert_eq!(trajectory.at(t), JointState::at_rest(path.goal()));
        }
        let period = (end / 100.0).max(1e-9);
        let mut samples = 0;
        let mut before = None;
        for (t, state) in trajectory.samples(period).unwrap() {
            prop_assert_eq!(state, trajectory.at(t));
            prop_assert!(before.is_none_or(|before| t > before && t - before <= period * (1.0 + 1e-9)));
            (before, samples) = (Some(t), samples + 1);
        }
        prop_assert_eq!(before, Some(end));
        prop_assert!(samples <= 103);
    }

    #[test]
    fn limits_of_any_size_give_numbers_or_an_error(
        path in path(), exponents in prop::array::uniform4(-9..=12_i32), with_jerk in prop::bool::ANY,
    ) {
        let smooth = <SmoothPath>::through(&path);
        let [velocity, acceleration, jerk, max_speed] = exponents.map(|exponent| libm::pow(10.0, f64::from(exponent)));
        let limits = one_joint(velocity, acceleration, with_jerk.then_some(jerk));
        let grip = GripSpeedLimit { robot: &PANDA, max_speed };
        for grip in [None, Some(&grip)] {
            if let Ok(trajectory) = time_optimal(&smooth, &limits, grip) {
                let end = trajectory.duration_secs();
                prop_assert!((0..=20).all(|i| trajectory.at(end * f64::from(i) / 20.0).is_finite()));
            }
        }
    }

    #[test]
    fn looser_limits_are_never_slower(path in path(), limits in limits(), factor in 1.0..3.0_f64) {
        let smooth = <SmoothPath>::through(&path);
        let limits = MotionLimits { jerk: None, ..limits };
        let looser = MotionLimits { acceleration: limits.acceleration.map(|limit| limit * factor), ..limits };
        let duration = |limits| time_optimal(&smooth, limits, None).unwrap().duration_secs();
        // Where a path turns back, steps of the grid cost a percent or two, more or less by chance.
        prop_assert!(duration(&looser) <= duration(&limits) * 1.05);
        // All rates times a factor: the same motion in another time.
        let faster = MotionLimits {
            velocity: limits.velocity.map(|limit| limit * factor),
            acceleration: limits.acceleration.map(|limit| limit * factor * factor),
            jerk: None,
        };
        prop_assert!((duration(&faster) * factor - duration(&limits)).abs() <= 1e-6 * duration(&limits));
    }
}

fn line(length: f32) -> SmoothPath {
    let ends = [0.0, length].map(|x| JointConfig::new([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    <SmoothPath>::through(&JointPath::new(ends.to_vec()).unwrap())
}

fn one_joint(velocity: f64, acceleration: f64, jerk: Option<f64>) -> MotionLimits {
    MotionLimits {
        velocity: [velocity; DOF],
        acceleration: [acceleration; DOF],
        jerk: jerk.map(|jerk| [jerk; DOF]),
    }
}

#[test]
fn along_a_line_the_duration_is_that_of_a_trapezoid() {
    let duration = |length, velocity, acceleration| {
        time_optimal(&line(length), &one_joint(velocity, acceleration, None), None)
            .unwrap()
            .duration_secs()
    };
    // Peaks that fall within an interval are cut: a 128th of the way at most.
    assert!(
        (duration(2.0, 1.0, 4.0) / 2.25 - 1.0).abs() < 2e-3,
        "2 rad at 1 rad/s and twice 0.25 s at half speed"
    );
    assert!((duration(0.16, 1.0, 4.0) / 0.4 - 1.0).abs() < 2e-3, "2 √(0.16 rad / 4 rad/s²)");
}

#[test]
fn along_a_line_ramps_cost_the_time_in_which_accelerations_grow() {
    // Up in 0.1 s, to 10 rad/s²; 0.5 rad/s at its end, 2 rad/s after 0.15 s more.
    let limits = one_joint(2.0, 10.0, Some(100.0));
    let trajectory = time_optimal(&line(4.0), &limits, None).unwrap();
    let ramps = 2.0 * (0.1 + 0.15);
    let way = 4.0 - 2.0 * (1.0 / 60.0 + 0.15 * 1.25);
    assert!(
        (trajectory.duration_secs() / (ramps + way / 2.0) - 1.0).abs() < 2e-3,
        "{}",
        trajectory.duration_secs()
    );
    assert!((trajectory.at(0.05).accelerations[0] - 5.0).abs() < 1e-3);
    assert!((trajectory.at(0.2).accelerations[0] - 10.0).abs() < 1e-3);
}

#[test]
fn the_grip_goes_at_its_limit_where_that_decides() {
    // The arm turns about its base: the grip goes on a circle.
    let mut goal = PANDA.start;
    goal[0] += 2.0;
    let path = <SmoothPath>::through(&JointPath::new(vec![PANDA.start, goal]).unwrap());
    let grip = GripSpeedLimit { robot: &PANDA, max_speed: 0.1 };
    let trajectory = time_optimal(&path, &LIMITS, Some(&grip)).unwrap();
    let speed = grip_speed(&grip, &trajectory.at(0.5 * trajectory.duration_secs()));
    assert!(speed <= 0.1 * (1.0 + TOLERANCE) && speed > 0.0999, "{speed}");
}

#[test]
fn a_path_that_stays_takes_no_time() {
    let path = <SmoothPath>::through(&JointPath::new(vec![PANDA.start; 5]).unwrap());
    let trajectory = time_optimal(&path, &LIMITS, None).unwrap();
    assert_eq!(trajectory.duration_secs(), 0.0);
    assert_eq!(trajectory.at(0.0), JointState::at_rest(&PANDA.start));
    assert_eq!(
        trajectory.samples(0.01).unwrap().collect::<Vec<_>>(),
        [(0.0, JointState::at_rest(&PANDA.start))]
    );
    assert!(trajectory.samples(0.0).is_err() && trajectory.samples(f64::NAN).is_err());
}

#[test]
fn limits_that_are_no_positive_numbers_are_errors() {
    let path = line(1.0);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(time_optimal(&path, &one_joint(bad, 1.0, None), None).is_err());
        assert!(
            time_optimal(
                &path,
                &one_joint(1.0, 1.0, None),
                Some(&GripSpeedLimit { robot: &PANDA, max_speed: bad })
            )
            .is_err()
        );
    }
}

#[test]
fn lengths_at_the_ends_of_f32_are_timed_or_refused() {
    for length in [f32::from_bits(1), 1e-38, 1e-20, 1e-9, 1e9, 1e20, f32::MAX] {
        for jerk in [None, Some(100.0)] {
            let limits = one_joint(2.0, 10.0, jerk);
            for max_speed in [None, Some(0.5)] {
                let grip = max_speed.map(|max_speed| GripSpeedLimit { robot: &PANDA, max_speed });
                let trajectory = match time_optimal(&line(length), &limits, grip.as_ref()) {
                    Ok(trajectory) => trajectory,
                    Err(error) if !(1e-9..1e9).contains(&length) => {
                        assert!(error.to_string().contains("duration"), "{error}");
                        continue;
                    }
                    Err(error) => panic!("{length}: {error}"),
                };
                assert!(trajectory.duration_secs() > 0.0);
                assert!(
                    (0..=100).all(|i| trajectory
                        .at(trajectory.duration_secs() * f64::from(i) / 100.0)
                        .is_finite()),
                    "{length}"
                );
            }
        }
    }
}

#[test]
fn the_work_grows_with_the_configurations_and_no_faster() {
    let configs = |n: u16| {
        (0..n).map(|i| {
            JointConfig::from_fn(DOF, |j| libm::sinf(0.01 * f32::from(i) * (1.0 + j as f32)))
        })
    };
    let n_stretches = |n| {
        let path = <SmoothPath>::through(&JointPath::new(configs(n).collect()).unwrap());
        fastest::<DOF, FEW>(&path, &LIMITS, None).stretches.len()
    };
    assert_eq!(n_stretches(30_001) - n_stretches(20_001), 10_000);
}
