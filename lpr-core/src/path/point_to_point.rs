//! Motions from one state to rest in another without a path between them: `rsruckig`, after
//! Berscheid and Kröger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
//! States" (2021).
//!
//! Cube roots, cosines and arc cosines of the solver are those of the platform wherever another
//! crate asks `num-traits` for `std`; natively and in wasm the last bits may differ.

use super::trajectory::{Motion, Trajectory};
use super::{JointState, MotionLimits};
use crate::error::Error;
use crate::robot::{DOF, JointConfig};
use rsruckig::prelude::{
    DataArrayOrVec, InputParameter, RuckigError, RuckigResult, ThrowErrorHandler,
};
use thiserror::Error as ThisError;

/// Longest motion that the solver says it computes exactly, seconds; it checks this with several
/// joints only.
const MAX_DURATION: f64 = 7.6e3;

/// Why there is no motion from point to point.
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits, NoMotion, point_to_point};
/// use lpr_core::robot::JointConfig;
///
/// let rest = JointState::at_rest(&JointConfig::new([0.0; 7]));
/// let motion = |goal: f32, velocity: f64| {
///     let limits = MotionLimits { velocity: [velocity; 7], acceleration: [1.0; 7], jerk: None };
///     point_to_point(&rest, &JointConfig::new([goal; 7]), &limits)
/// };
/// assert!(matches!(motion(1.0, -1.0), Err(NoMotion::Input(_))));
/// assert_eq!(motion(1.0, 1e-4).unwrap_err(), NoMotion::TooLong, "10000 s");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, ThisError)]
#[non_exhaustive]
pub enum NoMotion {
    /// Broken input: a limit that is no positive number, a state that is not finite.
    #[error(transparent)]
    Input(#[from] Error),
    /// The motion would take longer than the solver computes with, 7600 s.
    #[error("point to point: longer than the solver computes with")]
    TooLong,
    /// The solver found no profile for a joint.
    #[error("point to point: the solver found no profile")]
    NoProfile,
    /// The solver found profiles for the joints, but not of one duration.
    #[error("point to point: the solver found no common duration")]
    NotSynchronized,
}

/// The solver's profiles.
#[derive(Debug, Clone)]
pub(super) enum Ruckig {
    /// One, of the length along a straight line.
    Line {
        /// Where the line starts, rad.
        start: [f64; DOF],
        /// What every joint moves per unit of the length.
        direction: [f64; DOF],
        /// Of the length, rad.
        profile: Profiles<1>,
    },
    /// One of every joint.
    Joints(Profiles<DOF>),
}

type Profiles<const N: usize> = rsruckig::prelude::Trajectory<N>;

/// The fastest motion from `start` to rest at `goal` within `limits`, whose joints all arrive at
/// one time.
///
/// From rest it is the straight line in joint space; from a moving state it is in general not. A
/// start that is faster than its limits brakes first. Without a jerk limit accelerations jump.
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits, NoMotion, point_to_point};
/// use lpr_core::robot::JointConfig;
///
/// let (start, goal) = (JointConfig::new([0.0; 7]), JointConfig::new([1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]));
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: None };
/// let motion = point_to_point(&JointState::at_rest(&start), &goal, &limits)?;
/// // A quarter of a second to speed up, as long to slow down, and 0.75 rad between at 1 rad/s.
/// assert!((motion.duration_secs() - 1.25).abs() < 1e-6);
/// let middle = motion.at(0.5 * motion.duration_secs());
/// assert!((middle.angles[0] - 0.5).abs() < 1e-6 && (middle.velocities[1] - 0.5).abs() < 1e-6);
/// # Ok::<(), NoMotion>(())
/// ```
///
/// # Errors
///
/// [`NoMotion::Input`] for a state or limit that makes no sense; the others when the solver gives
/// up.
pub fn point_to_point(
    start: &JointState,
    goal: &JointConfig,
    limits: &MotionLimits,
) -> Result<Trajectory, NoMotion> {
    limits.check()?;
    check_finite(start, goal)?;
    let angles = goal.to_array::<DOF>().map(f64::from);
    let (duration, motion) = if *start == JointState::standing(start.angles) {
        line(start.angles, angles, limits)?
    } else {
        joints(start, angles, limits)?
    };
    Ok(Trajectory::new(*start, angles, duration, motion)?)
}

/// The straight line: the solver moves the joint with the longest way, and the others keep their
/// share of it.
fn line(
    start: [f64; DOF],
    goal: [f64; DOF],
    limits: &MotionLimits,
) -> Result<(f64, Motion), NoMotion> {
    let ways: [f64; DOF] = core::array::from_fn(|j| goal[j] - start[j]);
    let length = ways.iter().fold(0.0_f64, |longest, way| longest.max(way.abs()));
    if length == 0.0 {
        return Ok((0.0, Motion::Rest));
    }
    let direction = ways.map(|way| way / length);
    let tightest = |limits: &[f64; DOF]| {
        [limits
            .iter()
            .zip(direction)
            .map(|(limit, share)| limit / share.abs())
            .fold(f64::INFINITY, f64::min)]
    };
    let mut input = InputParameter::new(None);
    input.target_position = DataArrayOrVec::Stack([length]);
    input.max_velocity = DataArrayOrVec::Stack(tightest(&limits.velocity));
    input.max_acceleration = DataArrayOrVec::Stack(tightest(&limits.acceleration));
    input.max_jerk =
        DataArrayOrVec::Stack(limits.jerk.map_or([f64::INFINITY], |jerk| tightest(&jerk)));
    let profile = solve(&input)?;
    Ok((
        profile.get_duration(),
        Motion::PointToPoint(Box::new(Ruckig::Line { start, direction, profile })),
    ))
}

/// Every joint for itself, slowed to arrive with the last.
fn joints(
    start: &JointState,
    goal: [f64; DOF],
    limits: &MotionLimits,
) -> Result<(f64, Motion), NoMotion> {
    let mut input = InputParameter::new(None);
    input.current_position = DataArrayOrVec::Stack(start.angles);
    input.current_velocity = DataArrayOrVec::Stack(start.velocities);
    input.current_acceleration = DataArrayOrVec::Stack(start.accelerations);
    input.target_position = DataArrayOrVec::Stack(goal);
    input.max_velocity = DataArrayOrVec::Stack(limits.velocity);
    input.max_acceleration = DataArrayOrVec::Stack(limits.acceleration);
    input.max_jerk = DataArrayOrVec::Stack(limits.jerk.unwrap_or([f64::INFINITY; DOF]));
    let profiles = solve(&input)?;
    Ok((profiles.get_duration(), Motion::PointToPoint(Box::new(Ruckig::Joints(profiles)))))
}

fn solve<const N: usize>(input: &InputParameter<N>) -> Result<Profiles<N>, NoMotion> {
    let mut profiles = Profiles::new(None);
    let mut solver = rsruckig::prelude::Ruckig::<N, ThrowErrorHandler>::new(None, 1.0);
    match solver.calculate(input, &mut profiles) {
        Ok(RuckigResult::Working | RuckigResult::Finished)
            if profiles.get_duration() <= MAX_DURATION =>
        {
            Ok(profiles)
        }
        Ok(RuckigResult::Working | RuckigResult::Finished) => Err(NoMotion::TooLong),
        Ok(result) => Err(no_motion(&result)),
        Err(RuckigError::ValidationError(message)) => Err(Error::Config(message).into()),
        Err(RuckigError::CalculatorError(_)) => Err(NoMotion::NoProfile),
    }
}

impl Ruckig {
    /// The state at `t_secs`, within the duration.
    pub(super) fn at(&self, t_secs: f64) -> JointState {
        match self {
            Self::Joints(profiles) => {
                let [angles, velocities, accelerations] = state(profiles, t_secs);
                JointState { angles, velocities, accelerations }
            }
            Self::Line { start, direction, profile } => {
                let [[length], [speed], [acceleration]] = state(profile, t_secs);
                JointState {
                    angles: core::array::from_fn(|j| start[j] + direction[j] * length),
                    velocities: direction.map(|share| share * speed),
                    accelerations: direction.map(|share| share * acceleration),
                }
            }
        }
    }
}

/// Positions, velocities and accelerations at a time.
fn state<const N: usize>(profiles: &Profiles<N>, t_secs: f64) -> [[f64; N]; 3] {
    let [mut at, mut speed, mut rate] = [(); 3].map(|()| DataArrayOrVec::Stack([0.0; N]));
    profiles.at_time(
        t_secs,
        &mut Some(&mut at),
        &mut Some(&mut speed),
        &mut Some(&mut rate),
        &mut None,
        &mut None,
    );
    [at, speed, rate].map(|values| core::array::from_fn(|j| values[j]))
}

fn check_finite(start: &JointState, goal: &JointConfig) -> Result<(), Error> {
    let expected = || "finite angles, velocities and accelerations".to_owned();
    if !start.is_finite() {
        return Err(Error::Shape {
            what: "start",
            expected: expected(),
            found: format!("{start:?}"),
        });
    }
    if !goal.is_finite() {
        return Err(Error::Shape {
            what: "goal",
            expected: expected(),
            found: format!("{:?}", &goal[..]),
        });
    }
    Ok(())
}

const fn no_motion(result: &RuckigResult) -> NoMotion {
    match result {
        RuckigResult::ErrorTrajectoryDuration => NoMotion::TooLong,
        RuckigResult::ErrorSynchronizationCalculation => NoMotion::NotSynchronized,
        _ => NoMotion::NoProfile,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn config(size: f32) -> impl Strategy<Value = JointConfig> {
        prop::array::uniform7(-size..size).prop_map(JointConfig::new)
    }

    fn limits() -> impl Strategy<Value = MotionLimits> {
        let limit = |low: f64, high: f64| prop::array::uniform7(low..high);
        (limit(0.3, 3.0), limit(0.5, 20.0), limit(5.0, 5000.0)).prop_map(
            |(velocity, acceleration, jerk)| MotionLimits {
                velocity,
                acceleration,
                jerk: Some(jerk),
            },
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

    fn assert_within(trajectory: &Trajectory, limits: &MotionLimits) -> Result<(), TestCaseError> {
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
            let start = JointState { velocities, ..JointState::standing(start) };
            for goal in [JointConfig::new(goal), JointConfig::new([0.5; DOF])] {
                for start in [start, JointState { velocities, ..JointState::standing([0.0; DOF]) }] {
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
            point_to_point(&JointState::at_rest(&at(0.0)), &at(4.0), limits)
                .unwrap()
                .duration_secs()
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
        let is_input =
            |found: Result<Trajectory, NoMotion>| matches!(found, Err(NoMotion::Input(_)));
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
}
