//! A curve and when it is where.

use super::grid::Interval;
use super::passes::Ramps;
use super::spline::SmoothPath;
use crate::path::timing::joint_state::JointState;

/// A curve driven at a chord length that is a cubic of time on every stretch.
#[derive(Debug, Clone)]
pub(super) struct PathMotion<const N: usize> {
    path: SmoothPath<N>,
    pub(super) stretches: Vec<Stretch>,
}

/// A part of the motion with constant jerk of the path: 0 but on ramps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stretch {
    /// When it starts, seconds.
    pub(super) since: f64,
    /// Duration, seconds.
    pub(super) duration: f64,
    /// Chord length at its start, rad.
    at: f64,
    /// Chord length at its end, rad.
    end: f64,
    /// Speed of the path at its start, rad/s.
    speed: f64,
    /// Acceleration of the path at its start, rad/s².
    acceleration: f64,
    /// Jerk of the path, rad/s³.
    pub(super) jerk: f64,
}

impl<const N: usize> PathMotion<N> {
    /// The motion with the squared speeds `squares` around `intervals`, (rad/s)², and with `ramps`
    /// before and after them.
    pub(super) fn new(
        path: SmoothPath<N>,
        intervals: &[Interval],
        squares: &[f64],
        ramps: Option<&Ramps>,
    ) -> Self {
        let mut stretches = Vec::with_capacity(intervals.len() + 2);
        stretches.extend(ramps.map(|ramps| Stretch::first(ramps.start.length, squares[0])));
        for (interval, pair) in intervals.iter().zip(squares.windows(2)) {
            let at = path.knots[interval.piece].at + interval.offset;
            stretches.push(Stretch::between(at, interval.width, pair[0], pair[1]));
        }
        let last = squares[squares.len() - 1];
        stretches
            .extend(ramps.map(|ramps| Stretch::last(path.chord_length(), ramps.end.length, last)));
        let mut since = 0.0;
        for stretch in &mut stretches {
            stretch.since = since;
            since += stretch.duration;
        }
        Self { path, stretches }
    }

    /// Seconds.
    pub(super) fn duration(&self) -> f64 {
        let last = self.stretches[self.stretches.len() - 1];
        last.since + last.duration
    }

    /// The state at `t_secs`, within the duration.
    pub(super) fn at(&self, t_secs: f64) -> JointState<N> {
        let next = self.stretches.partition_point(|stretch| stretch.since <= t_secs);
        let (at, speed, acceleration) = self.stretches[next.max(1) - 1].at(t_secs);
        let idx = self.path.piece_at(at);
        let piece = self.path.piece(idx);
        let offset = at - self.path.knots[idx].at;
        let (first, second) = (piece.first(offset), piece.second(offset));
        JointState {
            angles: piece.angles(offset),
            velocities: first.map(|slope| slope * speed),
            accelerations: core::array::from_fn(|j| {
                first[j] * acceleration + second[j] * speed * speed
            }),
        }
    }
}

impl Stretch {
    /// From rest at the curve's start to the squared speed `square` at constant jerk.
    fn first(length: f64, square: f64) -> Self {
        let speed = libm::sqrt(square);
        let duration = 3.0 * length / speed;
        let jerk = 2.0 * speed / (duration * duration);
        Self { since: 0.0, duration, at: 0.0, end: length, speed: 0.0, acceleration: 0.0, jerk }
    }

    /// From one squared speed to another at constant acceleration.
    fn between(at: f64, width: f64, square: f64, square_at_end: f64) -> Self {
        let speed = libm::sqrt(square);
        let duration = 2.0 * width / (speed + libm::sqrt(square_at_end));
        let acceleration = (square_at_end - square) / (2.0 * width);
        Self { since: 0.0, duration, at, end: at + width, speed, acceleration, jerk: 0.0 }
    }

    /// From the squared speed `square` to rest at the chord length `end` at constant jerk: the
    /// first one backwards.
    fn last(end: f64, length: f64, square: f64) -> Self {
        let first = Self::first(length, square);
        let acceleration = -first.jerk * first.duration;
        Self { at: end - length, end, speed: libm::sqrt(square), acceleration, ..first }
    }

    /// Chord length (rad), speed and acceleration of the path at a time within the stretch.
    fn at(&self, t_secs: f64) -> (f64, f64, f64) {
        let t = (t_secs - self.since).clamp(0.0, self.duration);
        let at = self.at + t * (self.speed + t * (self.acceleration / 2.0 + t * self.jerk / 6.0));
        let speed = self.speed + t * (self.acceleration + t * self.jerk / 2.0);
        (at.clamp(self.at, self.end), speed.max(0.0), self.acceleration + t * self.jerk)
    }
}
