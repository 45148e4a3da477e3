//! One speed profile along the length of a path in joint space.
//!
//! The speed rises at constant acceleration to a constant speed and falls back likewise (a
//! trapezoid, or a triangle on short paths). Computed in f64.
//!
//! The direction of the motion changes at once at the configurations of the path, as in the
//! simulator, whose arm is kinematic; a bound on the accelerations there is the business of the
//! real arm's executor.

use crate::check::setting;
use crate::error::Result;
use crate::path::joint_path::JointPath;
use crate::robot::{JointConfig, Robot};
use serde::{Deserialize, Serialize};

/// Numbers of the speed profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingSettings {
    /// Greatest speed along the path in joint space, rad/s.
    pub max_velocity: f32,
    /// Acceleration along the path in joint space, rad/s².
    pub max_acceleration: f32,
}

impl TimingSettings {
    /// Checks that speed and acceleration are positive numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`](crate::Error::Config) naming the first that is not.
    pub fn check(&self) -> Result<()> {
        let Self { max_velocity, max_acceleration } = *self;
        for (name, number) in
            [("timing.max_velocity", max_velocity), ("timing.max_acceleration", max_acceleration)]
        {
            let holds = number.is_finite() && number > 0.0;
            setting(holds, name, "a finite number above 0", number)?;
        }
        Ok(())
    }
}

/// A path with the time at which it reaches every point.
///
/// ```
/// use lpr_core::path::{JointPath, TimedPath, TimingSettings};
/// use lpr_core::robot::XARM7;
///
/// let mut goal = XARM7.start;
/// goal[0] += 1.0;
/// let path = JointPath::new(vec![XARM7.start, goal])?;
/// let timed = TimedPath::new(path, &XARM7, &TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 })?;
/// assert!((timed.duration_secs() - 1.25).abs() < 1e-6);
/// assert!((timed.config_at(0.625)[0] - XARM7.start[0] - 0.5).abs() < 1e-6, "half the way at half the time");
/// assert_eq!((timed.config_at(-1.0), timed.config_at(9.0)), (XARM7.start, goal));
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TimedPath {
    path: JointPath,
    /// Length of the path up to every configuration, radians.
    lengths: Vec<f64>,
    profile: Trapezoid,
}

impl TimedPath {
    /// `path` at the speed of `settings`, slowed so that every joint keeps the robot's velocity and
    /// acceleration limits on the path's segments.
    ///
    /// # Errors
    ///
    /// When a speed or acceleration is not a positive number.
    pub fn new(path: JointPath, robot: &Robot, settings: &TimingSettings) -> Result<Self> {
        settings.check()?;
        let mut lengths = vec![0.0];
        let (mut velocity, mut acceleration) =
            (f64::from(settings.max_velocity), f64::from(settings.max_acceleration));
        for pair in path.configs().windows(2) {
            let moves =
                || pair[0].iter().zip(pair[1].iter()).map(|(a, b)| f64::from(*b) - f64::from(*a));
            let length = libm::sqrt(moves().map(|d| d * d).sum());
            lengths.push(lengths[lengths.len() - 1] + length);
            for (joint, moved) in robot.joints.iter().zip(moves()) {
                if moved != 0.0 {
                    // Along a segment a joint moves by `moved / length` of the path's own motion.
                    let share = length / moved.abs();
                    velocity = velocity.min(f64::from(joint.max_velocity) * share);
                    acceleration = acceleration.min(f64::from(joint.max_acceleration) * share);
                }
            }
        }
        let profile = Trapezoid::new(lengths[lengths.len() - 1], velocity, acceleration);
        Ok(Self { path, lengths, profile })
    }

    /// Time from start to goal, seconds.
    #[must_use]
    pub fn duration_secs(&self) -> f64 {
        self.profile.duration()
    }

    /// The path that is timed.
    #[must_use]
    pub const fn path(&self) -> &JointPath {
        &self.path
    }

    /// The configuration at `t_secs`; the start before 0 and the goal after the end.
    #[must_use]
    pub fn config_at(&self, t_secs: f64) -> JointConfig {
        if t_secs >= self.duration_secs() {
            return *self.path.goal();
        }
        let at = self.profile.length_at(t_secs.max(0.0));
        let next = self.lengths.partition_point(|length| *length <= at).min(self.lengths.len() - 1);
        let (before, after) = (self.lengths[next - 1], self.lengths[next]);
        let fraction =
            if after > before { ((at - before) / (after - before)).min(1.0) } else { 0.0 };
        let (from, to) = (&self.path.configs()[next - 1], &self.path.configs()[next]);
        JointConfig::from_fn(from.dof(), |j| {
            let (from, to) = (f64::from(from[j]), f64::from(to[j]));
            (from + (to - from) * fraction) as f32
        })
    }
}

/// A length covered from rest to rest at constant acceleration, speed and deceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Trapezoid {
    length: f64,
    /// Speed between the ramps.
    velocity: f64,
    acceleration: f64,
}

impl Trapezoid {
    /// A profile that reaches at most `velocity`.
    fn new(length: f64, velocity: f64, acceleration: f64) -> Self {
        // Half the length is covered while accelerating to the top of a triangle.
        Self { length, velocity: velocity.min(libm::sqrt(length * acceleration)), acceleration }
    }

    fn ramp(&self) -> f64 {
        self.velocity / self.acceleration
    }

    /// The ramps cost their time once more than the cruise would.
    fn duration(&self) -> f64 {
        if self.length > 0.0 { self.length / self.velocity + self.ramp() } else { 0.0 }
    }

    /// Length covered after `t` seconds within the profile.
    fn length_at(&self, t: f64) -> f64 {
        let left = self.duration() - t;
        if t < self.ramp() {
            0.5 * self.acceleration * t * t
        } else if left < self.ramp() {
            self.length - 0.5 * self.acceleration * left * left
        } else {
            self.velocity * (t - 0.5 * self.ramp())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{PANDA, ROBOTS};
    use proptest::prelude::*;

    const SETTINGS: TimingSettings = TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 };

    fn path() -> impl Strategy<Value = JointPath> {
        prop::collection::vec(prop::array::uniform7(-1.5_f32..1.5).prop_map(JointConfig::new), 2..8)
            .prop_map(JointPath)
    }

    proptest! {
        #[test]
        fn speeds_and_accelerations_stay_within_their_limits(path in path(), velocity in 0.3_f32..6.0, acceleration in 1.0_f32..30.0) {
            for robot in ROBOTS {
                let settings = TimingSettings { max_velocity: velocity, max_acceleration: acceleration };
                let timed = TimedPath::new(path.clone(), robot, &settings).unwrap();
                let dt = 1e-3;
                let length = |t| timed.profile.length_at(t);
                let n = (timed.duration_secs() / dt) as usize;
                for i in 1..n {
                    let t = i as f64 * dt;
                    let speed = (length(t) - length(t - dt)) / dt;
                    prop_assert!(speed >= 0.0 && speed <= f64::from(velocity) + 1e-6);
                    if i + 1 < n {
                        let change = (length(t + dt) - 2.0 * length(t) + length(t - dt)) / (dt * dt);
                        prop_assert!(change.abs() <= f64::from(acceleration) + 1e-4);
                    }
                    let (from, to) = (timed.config_at(t - dt), timed.config_at(t));
                    for (joint, (a, b)) in robot.joints.iter().zip(from.iter().zip(to.iter())) {
                        prop_assert!((b - a).abs() <= joint.max_velocity * dt as f32 + 1e-5);
                    }
                }
            }
        }

        #[test]
        fn ends_are_exact_and_every_configuration_is_on_the_path(path in path(), share in 0.0..1.0_f64) {
            let timed = TimedPath::new(path.clone(), &PANDA, &SETTINGS).unwrap();
            prop_assert_eq!(timed.config_at(0.0), *path.start());
            prop_assert_eq!(timed.config_at(-1.0), *path.start());
            prop_assert_eq!(timed.config_at(timed.duration_secs()), *path.goal());
            prop_assert_eq!(timed.config_at(1e9), *path.goal());
            let config = timed.config_at(share * timed.duration_secs());
            // A point between a and b has the sum of its distances to them equal to theirs.
            let detour = path.configs().windows(2).map(|pair| {
                pair[0].distance(&config) + config.distance(&pair[1]) - pair[0].distance(&pair[1])
            });
            prop_assert!(detour.fold(f32::INFINITY, f32::min) < 1e-5);
        }
    }

    #[test]
    fn a_long_path_cruises_and_a_short_one_is_a_triangle() {
        let along = |length: f32| {
            let mut goal = JointConfig::new([0.0; 7]);
            goal[0] = length;
            TimedPath::new(JointPath(vec![JointConfig::new([0.0; 7]), goal]), &PANDA, &SETTINGS)
                .unwrap()
                .duration_secs()
        };
        assert!(
            (along(2.0) - 2.25).abs() < 1e-12,
            "2 rad at 1 rad/s and twice 0.25 s at half speed"
        );
        assert!((along(0.16) - 0.4).abs() < 1e-7, "2 √(0.16 rad / 4 rad/s²)");
    }

    #[test]
    fn a_speed_of_nothing_is_refused() {
        let path = JointPath(vec![JointConfig::new([0.0; 7]), JointConfig::new([0.1; 7])]);
        for max_velocity in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(
                TimedPath::new(path.clone(), &PANDA, &TimingSettings { max_velocity, ..SETTINGS })
                    .is_err()
            );
        }
    }

    #[test]
    fn a_path_that_stays_takes_no_time() {
        let rest = JointConfig::new([0.3; 7]);
        let timed = TimedPath::new(JointPath(vec![rest, rest]), &PANDA, &SETTINGS).unwrap();
        assert_eq!(timed.duration_secs(), 0.0);
        assert_eq!(timed.config_at(0.0), rest);
        assert_eq!(timed.config_at(-0.5), rest);
    }
}
