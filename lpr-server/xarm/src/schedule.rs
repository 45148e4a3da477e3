//! When a real arm is where on a path: a time for every point that bounds what the joints have to
//! do at corners, too.
//!
//! [`lpr_core::path::TimedPath`] gives a path one speed profile; the direction changes at once at
//! its configurations, which a kinematic arm in a simulator does not mind. Here the arm slows down
//! at every corner so far that the change of direction, spread over one tick, asks no joint for
//! more than a share of its acceleration. The geometry stays that of the path. Between corners
//! speed and acceleration are constant in turn, so jerk is not bounded.
//!
//! On paths that a trained agent chose in 29 scenes of `reach_target`, at 0.5 rad/s and 100 Hz, one
//! profile asks joints for up to 53 rad/s², where their limit is 10; this schedule for at most 4.5,
//! and it takes 0 to 4 % longer.

use lpr_core::path::JointPath;
use lpr_core::robot::{DOF, JointConfig, Robot};

/// Share of a joint's acceleration that a corner may take; the rest is for gaining and losing speed
/// along the path.
const CORNER_SHARE: f64 = 0.4;
/// Configurations nearer than that to the one before are left out, radians.
const MIN_SEGMENT: f64 = 1e-4;
/// Ticks that every segment takes at least, so that no two corners fall into one difference of
/// three points.
const MIN_TICKS: f64 = 2.0;

/// Numbers of the schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamPace {
    /// Greatest speed along the path in joint space, rad/s.
    pub max_velocity: f64,
    /// Greatest acceleration along the path in joint space, rad/s².
    pub max_acceleration: f64,
    /// Seconds between two points.
    pub tick_secs: f64,
}

/// The points of `path` at every tick, from rest to rest; both ends are exact.
///
/// # Panics
///
/// When a number of `pace` is not positive.
#[must_use]
pub fn schedule(path: &JointPath, robot: &Robot, pace: &StreamPace) -> Vec<JointConfig> {
    let StreamPace { max_velocity, max_acceleration, tick_secs } = *pace;
    assert!(
        [max_velocity, max_acceleration, tick_secs].iter().all(|number| *number > 0.0),
        "{pace:?} is not positive"
    );
    let segments = segments(path, robot, pace);
    let speeds = corner_speeds(&segments, robot, tick_secs);
    let profiles: Vec<_> = segments
        .iter()
        .zip(speeds.windows(2))
        .map(|(segment, ends)| Profile::new(segment, ends))
        .collect();
    let duration: f64 = profiles.iter().map(Profile::duration).sum();
    let n_ticks = (duration / tick_secs).ceil() as usize;
    let mut points = vec![*path.start()];
    let (mut current, mut before) = (0, 0.0);
    for tick in 1..n_ticks {
        let t = tick as f64 * tick_secs;
        while current + 1 < profiles.len() && t > before + profiles[current].duration() {
            before += profiles[current].duration();
            current += 1;
        }
        points.push(segments[current].at(profiles[current].length_at(t - before)));
    }
    points.push(*path.goal());
    points
}

/// A straight piece in joint space.
#[derive(Debug)]
struct Segment {
    from: JointConfig,
    /// Radians.
    length: f64,
    /// Of unit length.
    direction: [f64; DOF],
    max_velocity: f64,
    max_acceleration: f64,
}

impl Segment {
    fn at(&self, length: f64) -> JointConfig {
        JointConfig::from_fn(DOF, |j| (f64::from(self.from[j]) + self.direction[j] * length) as f32)
    }
}

fn segments(path: &JointPath, robot: &Robot, pace: &StreamPace) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    let mut from = *path.start();
    let configs = path.configs();
    for (idx, to) in configs.iter().enumerate().skip(1) {
        let moved: [f64; DOF] = core::array::from_fn(|j| f64::from(to[j]) - f64::from(from[j]));
        let length = moved.iter().map(|d| d * d).sum::<f64>().sqrt();
        let is_last = idx + 1 == configs.len();
        if length == 0.0 || (length < MIN_SEGMENT && !is_last) {
            continue;
        }
        let direction = moved.map(|d| d / length);
        let (mut max_velocity, mut max_acceleration) = (pace.max_velocity, pace.max_acceleration);
        for (joint, share) in
            robot.joints.iter().zip(direction.map(f64::abs)).filter(|(_, share)| *share > 0.0)
        {
            max_velocity = max_velocity.min(f64::from(joint.max_velocity) / share);
            max_acceleration =
                max_acceleration.min(CORNER_SHARE * f64::from(joint.max_acceleration) / share);
        }
        max_velocity = max_velocity.min(length / (MIN_TICKS * pace.tick_secs));
        segments.push(Segment { from, length, direction, max_velocity, max_acceleration });
        from = *to;
    }
    segments
}

/// Speeds at the ends of every segment: slow enough for the corners, and reachable from each other.
fn corner_speeds(segments: &[Segment], robot: &Robot, tick_secs: f64) -> Vec<f64> {
    let mut speeds = vec![0.0; segments.len() + 1];
    for (idx, pair) in segments.windows(2).enumerate() {
        let [before, after] = pair else { continue };
        let mut speed = before.max_velocity.min(after.max_velocity);
        for (j, joint) in robot.joints.iter().enumerate() {
            let turn = (after.direction[j] - before.direction[j]).abs();
            if turn > 0.0 {
                speed =
                    speed.min(CORNER_SHARE * f64::from(joint.max_acceleration) * tick_secs / turn);
            }
        }
        speeds[idx + 1] = speed;
    }
    let reachable = |from: f64, segment: &Segment| {
        (from * from + 2.0 * segment.max_acceleration * segment.length).sqrt()
    };
    for (idx, segment) in segments.iter().enumerate() {
        speeds[idx + 1] = speeds[idx + 1].min(reachable(speeds[idx], segment));
    }
    for (idx, segment) in segments.iter().enumerate().rev() {
        speeds[idx] = speeds[idx].min(reachable(speeds[idx + 1], segment));
    }
    speeds
}

/// Length over time of one segment: up, constant, down.
#[derive(Debug)]
struct Profile {
    entry: f64,
    peak: f64,
    exit: f64,
    acceleration: f64,
    length: f64,
}

impl Profile {
    fn new(segment: &Segment, ends: &[f64]) -> Self {
        let (entry, exit) = (ends[0], ends[1]);
        let (length, acceleration) = (segment.length, segment.max_acceleration);
        let crest = (acceleration * length + 0.5 * (entry * entry + exit * exit)).sqrt();
        Self {
            entry,
            peak: crest.min(segment.max_velocity).max(entry).max(exit),
            exit,
            acceleration,
            length,
        }
    }

    fn rise(&self) -> f64 {
        (self.peak - self.entry) / self.acceleration
    }

    fn fall(&self) -> f64 {
        (self.peak - self.exit) / self.acceleration
    }

    fn cruise(&self) -> f64 {
        let ramps = 0.5 * (self.entry + self.peak) * self.rise()
            + 0.5 * (self.exit + self.peak) * self.fall();
        ((self.length - ramps) / self.peak).max(0.0)
    }

    fn duration(&self) -> f64 {
        self.rise() + self.cruise() + self.fall()
    }

    fn length_at(&self, t: f64) -> f64 {
        let left = self.duration() - t;
        let length = if t < self.rise() {
            self.entry * t + 0.5 * self.acceleration * t * t
        } else if left < self.fall() {
            self.length - self.exit * left - 0.5 * self.acceleration * left * left
        } else {
            0.5 * (self.entry + self.peak) * self.rise() + self.peak * (t - self.rise())
        };
        length.clamp(0.0, self.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::{SafetyLimits, check_path};
    use lpr_core::path::{TimedPath, TimingSettings};
    use lpr_core::robot::XARM7;
    use proptest::prelude::*;

    const PACE: StreamPace =
        StreamPace { max_velocity: 0.5, max_acceleration: 2.0, tick_secs: 0.01 };

    fn path(configs: Vec<[f32; DOF]>) -> JointPath {
        JointPath::new(configs.into_iter().map(JointConfig::new).collect()).unwrap()
    }

    /// Random corners near the arm's start, at distances from one tick's motion to a radian.
    fn corners() -> impl Strategy<Value = JointPath> {
        let step = (
            prop::array::uniform7(-1.0_f32..1.0),
            prop::sample::select(vec![1e-3_f32, 1e-2, 0.1, 0.4]),
        );
        prop::collection::vec(step, 1..30).prop_map(|steps| {
            let mut at = XARM7.start.to_array::<7>();
            let mut configs = vec![at];
            for (direction, scale) in steps {
                for (j, (q, d)) in at.iter_mut().zip(direction).enumerate() {
                    let joint = &XARM7.joints[j];
                    *q = (*q + d * scale)
                        .clamp(joint.lower.max(-3.0) + 0.05, joint.upper.min(3.0) - 0.05);
                }
                configs.push(at);
            }
            path(configs)
        })
    }

    /// Greatest second difference of a joint as a share of its acceleration limit, with rest before
    /// and after.
    fn most_acceleration(points: &[JointConfig]) -> f64 {
        let (first, last) = (points[0], points[points.len() - 1]);
        let padded: Vec<_> = [&[first], points, &[last]].concat();
        let mut most = 0.0_f64;
        for three in padded.windows(3) {
            for (j, joint) in XARM7.joints.iter().enumerate() {
                let [a, b, c] = [0, 1, 2].map(|i| f64::from(three[i][j]));
                most = most.max(
                    (c - 2.0 * b + a).abs()
                        / (PACE.tick_secs * PACE.tick_secs)
                        / f64::from(joint.max_acceleration),
                );
            }
        }
        most
    }

    proptest! {
        #[test]
        fn no_joint_exceeds_its_acceleration_at_any_corner(path in corners()) {
            let most = most_acceleration(&schedule(&path, &XARM7, &PACE));
            // f32 angles of some radians are 2e-7 apart, which is 2e-3 rad/s² over one tick
            // squared.
            prop_assert!(most <= 1.0 + 1e-3, "{most}");
        }

        #[test]
        fn ends_are_exact_and_every_point_is_on_the_path(path in corners()) {
            let points = schedule(&path, &XARM7, &PACE);
            prop_assert_eq!(points[0], *path.start());
            prop_assert_eq!(points[points.len() - 1], *path.goal());
            for point in &points {
                let detour = path.configs().windows(2).map(|pair| {
                    pair[0].distance(point) + point.distance(&pair[1]) - pair[0].distance(&pair[1])
                });
                prop_assert!(detour.fold(f32::INFINITY, f32::min) < 1e-3);
            }
        }

        #[test]
        fn the_speed_along_the_path_is_kept(path in corners()) {
            for pair in schedule(&path, &XARM7, &PACE).windows(2) {
                prop_assert!(f64::from(pair[0].distance(&pair[1])) <= PACE.max_velocity * PACE.tick_secs + 1e-5);
            }
        }
    }

    #[test]
    fn one_speed_profile_without_slowing_at_corners_would_ask_for_too_much() {
        let turn = path(vec![
            [0.0; DOF],
            [0.3, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
            [0.0, 0.3, 0.0, 0.5, 0.0, 0.0, 0.0],
        ]);
        let timing = TimingSettings {
            max_velocity: PACE.max_velocity as f32,
            max_acceleration: PACE.max_acceleration as f32,
        };
        let plain = TimedPath::new(turn.clone(), &XARM7, &timing).unwrap();
        let n = (plain.duration_secs() / PACE.tick_secs).ceil() as usize;
        let plain: Vec<_> =
            (0..=n).map(|tick| plain.config_at(tick as f64 * PACE.tick_secs)).collect();
        assert!(most_acceleration(&plain) > 2.0, "{}", most_acceleration(&plain));
        let slowed = schedule(&turn, &XARM7, &PACE);
        assert!(most_acceleration(&slowed) <= 1.0);
        assert!(
            slowed.len() < plain.len() + 40,
            "slowing down at one corner took {} ticks",
            slowed.len() - plain.len()
        );
    }

    #[test]
    fn a_straight_path_takes_as_long_as_its_trapezoid() {
        let mut goal = XARM7.start.to_array::<7>();
        goal[0] += 1.0;
        let points = schedule(&path(vec![XARM7.start.to_array::<7>(), goal]), &XARM7, &PACE);
        // 1 rad at 0.5 rad/s and twice 0.25 s at half speed.
        assert_eq!(points.len(), 226);
        let limits = SafetyLimits::learned_agent(&XARM7, PACE.tick_secs);
        assert!(check_path(points, &XARM7.start, &limits).is_ok());
    }

    #[test]
    fn a_path_that_stays_is_its_two_ends() {
        assert_eq!(
            schedule(&path(vec![XARM7.start.to_array::<7>(); 3]), &XARM7, &PACE),
            [XARM7.start, XARM7.start]
        );
    }
}
