//! Motions from one state to rest in another without a path between them: `rsruckig`, after
//! Berscheid and Kröger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target
//! States" (2021).
//!
//! Cube roots, cosines and arc cosines of the solver are those of the platform wherever another
//! crate asks `num-traits` for `std`; natively and in wasm the last bits may differ.

use lpr_core::Error;
use lpr_core::path::{JointState, MotionLimits};
use lpr_core::robot::{DOF, JointConfig};
use rsruckig::prelude::{
    DataArrayOrVec, InputParameter, RuckigError, RuckigResult, ThrowErrorHandler,
};
use thiserror::Error as ThisError;

/// Longest motion that the solver says it computes exactly, seconds; it checks this with several
/// joints only.
const MAX_DURATION: f64 = 7.6e3;

/// Reason why there is no motion from point to point.
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits};
/// use lpr_core::robot::JointConfig;
/// use lpr_xarm::point_to_point::{NoMotion, point_to_point};
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

/// A motion from a state to rest.
///
/// The targets of a controller at 100 Hz:
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits};
/// use lpr_core::robot::JointConfig;
/// use lpr_xarm::point_to_point::point_to_point;
///
/// let (start, goal) = (JointConfig::new([0.0; 7]), JointConfig::new([0.3; 7]));
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: Some([40.0; 7]) };
/// let motion = point_to_point(&JointState::at_rest(&start), &goal, &limits)?;
/// let n_ticks = (motion.duration_secs() / 0.01).ceil() as u32;
/// let done: Vec<_> = (0..=n_ticks).map(|tick| motion.at(f64::from(tick) * 0.01)).collect();
/// assert_eq!(done[0], JointState::at_rest(&start));
/// assert_eq!(done[n_ticks as usize], JointState::at_rest(&goal), "at the end it stays");
/// # Ok::<(), lpr_xarm::point_to_point::NoMotion>(())
/// ```
#[derive(Debug, Clone)]
pub struct PointToPoint {
    start: JointState,
    /// Radians.
    goal: [f64; DOF],
    /// Seconds.
    duration: f64,
    /// None where nothing moves.
    course: Option<Course>,
}

/// The way between start and goal, in the solver's profiles.
#[derive(Debug, Clone)]
enum Course {
    /// One, of the length along a straight line.
    Line {
        /// Start of the line, rad.
        start: [f64; DOF],
        /// Way of every joint per unit of the length.
        direction: [f64; DOF],
        /// Of the length, rad.
        profile: Box<Profiles<1>>,
    },
    /// One of every joint.
    Joints(Box<Profiles<DOF>>),
}

type Profiles<const N: usize> = rsruckig::prelude::Trajectory<N>;

/// The fastest motion from `start` to rest at `goal` within `limits`, whose joints all arrive at
/// one time.
///
/// From rest it is the straight line in joint space; from a moving state it is in general not. A
/// start that is faster than its limits brakes first. Without a jerk limit accelerations jump.
///
/// ```
/// use lpr_core::path::{JointState, MotionLimits};
/// use lpr_core::robot::JointConfig;
/// use lpr_xarm::point_to_point::{NoMotion, point_to_point};
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
) -> Result<PointToPoint, NoMotion> {
    limits.check()?;
    check_finite(start, goal)?;
    let angles = goal.to_array::<DOF>().map(f64::from);
    let (duration, course) = if *start == standing(start.angles) {
        line(start.angles, angles, limits)?
    } else {
        joints(start, angles, limits)?
    };
    Ok(PointToPoint { start: *start, goal: angles, duration, course })
}

impl PointToPoint {
    /// Time from start to goal, seconds.
    #[must_use]
    pub const fn duration_secs(&self) -> f64 {
        self.duration
    }

    /// The state at `t_secs`: that of the start before 0, at rest at the goal from the end on.
    #[must_use]
    pub fn at(&self, t_secs: f64) -> JointState {
        if t_secs >= self.duration {
            return standing(self.goal);
        }
        match &self.course {
            Some(course) if t_secs > 0.0 => course.at(t_secs),
            _ => self.start,
        }
    }
}

const fn standing(angles: [f64; DOF]) -> JointState {
    JointState { angles, velocities: [0.0; DOF], accelerations: [0.0; DOF] }
}

/// The straight line: the solver moves the joint with the longest way, and the others keep their
/// share of it.
fn line(
    start: [f64; DOF],
    goal: [f64; DOF],
    limits: &MotionLimits,
) -> Result<(f64, Option<Course>), NoMotion> {
    let ways: [f64; DOF] = core::array::from_fn(|j| goal[j] - start[j]);
    let length = ways.iter().fold(0.0_f64, |longest, way| longest.max(way.abs()));
    if length == 0.0 {
        return Ok((0.0, None));
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
    let profile = Box::new(solve(&input)?);
    Ok((profile.get_duration(), Some(Course::Line { start, direction, profile })))
}

/// Every joint for itself, slowed to arrive with the last.
fn joints(
    start: &JointState,
    goal: [f64; DOF],
    limits: &MotionLimits,
) -> Result<(f64, Option<Course>), NoMotion> {
    let mut input = InputParameter::new(None);
    input.current_position = DataArrayOrVec::Stack(start.angles);
    input.current_velocity = DataArrayOrVec::Stack(start.velocities);
    input.current_acceleration = DataArrayOrVec::Stack(start.accelerations);
    input.target_position = DataArrayOrVec::Stack(goal);
    input.max_velocity = DataArrayOrVec::Stack(limits.velocity);
    input.max_acceleration = DataArrayOrVec::Stack(limits.acceleration);
    input.max_jerk = DataArrayOrVec::Stack(limits.jerk.unwrap_or([f64::INFINITY; DOF]));
    let profiles = Box::new(solve(&input)?);
    Ok((profiles.get_duration(), Some(Course::Joints(profiles))))
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

impl Course {
    /// The state at `t_secs`, within the duration.
    fn at(&self, t_secs: f64) -> JointState {
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
mod tests;
