//! Starts whose acceleration grows from nothing at a constant rate.
//!
//! On a ramp the chord length is `s = j t³ / 6`. With `u` the path's acceleration where the ramp
//! ends at the length `l`, its squared speed there is `3 l u / 2` and `u³ = 6 j² l`; a joint's jerk
//! is `j (q' + 9 s q'' + 9/2 s² q''')`, its acceleration at most `u |q' + 3/2 s q''|`. Both factors
//! are parabolas on a piece of the curve, so that every limit bounds `u` from above by Bernstein
//! coefficients. Ends are the starts of the reversed curve.

use super::grid::Interval;
use super::spline::{Piece, SmoothPath};
use crate::path::timing::motion_limits::MotionLimits;

/// A ramp that would end later than this within an interval ends with it, so that what is left is
/// no sliver.
const LATE: f64 = 0.8;

/// Rounds by which the end of a ramp is found within an interval: to 2⁻⁴⁰ of it.
const ROUNDS: usize = 40;

/// A ramp over the first intervals of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ramp {
    /// Chord length, rad.
    pub(super) length: f64,
    /// Intervals that lie on it as a whole.
    pub(super) n_whole: usize,
    /// Share of the interval after them that lies on it.
    pub(super) share: f64,
    /// Largest square of the path's speed at its end, (rad/s)².
    pub(super) max_square: f64,
}

impl Ramp {
    /// The shortest ramp to an acceleration at which another limit than that of the jerk decides;
    /// where there is none on `intervals`, the one to the highest acceleration.
    pub(super) fn over<const N: usize>(
        path: &SmoothPath<N>,
        intervals: &[Interval],
        limits: &MotionLimits<N>,
        jerk: &[f64; N],
    ) -> Self {
        let mut highest = (0.0, None);
        let mut demand = Demand::default();
        let mut length = 0.0;
        for (idx, interval) in intervals.iter().enumerate() {
            let piece = path.piece(interval.piece);
            let add = |share: f64| {
                let part = interval.before(share);
                (demand.with(&piece, &part, length, limits, jerk), length + part.width)
            };
            let (whole, end) = add(1.0);
            if whole.jerk_decides_no_more(end) {
                return Self::at_crossing(idx, add);
            }
            if whole.by_jerk(end) > highest.0 {
                highest = (whole.by_jerk(end), Some(Self::new(idx + 1, 0.0, end, &whole)));
            }
            (demand, length) = (whole, end);
        }
        highest.1.expect("a curve has an interval in its half, and a ramp over it an acceleration")
    }

    /// The ramp that ends within interval `idx`, where the jerk ceases to decide.
    fn at_crossing(idx: usize, add: impl Fn(f64) -> (Demand, f64)) -> Self {
        let (mut before, mut after) = (0.0, 1.0);
        for _ in 0..ROUNDS {
            let middle = 0.5 * (before + after);
            let (demand, length) = add(middle);
            if demand.jerk_decides_no_more(length) {
                after = middle;
            } else {
                before = middle;
            }
        }
        let share = if after > LATE { 1.0 } else { after };
        let (demand, length) = add(share);
        if share < 1.0 {
            Self::new(idx, share, length, &demand)
        } else {
            Self::new(idx + 1, 0.0, length, &demand)
        }
    }

    fn new(n_whole: usize, share: f64, length: f64, demand: &Demand) -> Self {
        let acceleration = demand.by_jerk(length).min(demand.by_others(length));
        Self { length, n_whole, share, max_square: 1.5 * length * acceleration }
    }
}

/// Demand of joints and grip on a ramp, as shares of their limits.
#[derive(Debug, Clone, Copy, Default)]
struct Demand {
    /// Of jerk, per jerk of the path.
    jerk: f64,
    /// Of acceleration, per acceleration of the path at the ramp's end.
    acceleration: f64,
    /// Of squared speed, per squared speed of the path.
    square: f64,
}

impl Demand {
    /// With that of an interval at the chord length `at`.
    fn with<const N: usize>(
        self,
        piece: &Piece<N>,
        interval: &Interval,
        at: f64,
        limits: &MotionLimits<N>,
        jerk: &[f64; N],
    ) -> Self {
        let (first, second, third) =
            (piece.first(interval.offset), piece.second(interval.offset), piece.third());
        let (end, half_width) = (at + interval.width, 0.5 * interval.width);
        let mut demand = Self { square: self.square.max(interval.grip.max()), ..self };
        for j in 0..N {
            let second_at_end = second[j] + interval.width * third[j];
            let slopes = parabola(first[j], second[j], second_at_end, half_width);
            let for_acceleration = parabola(
                first[j] + 1.5 * at * second[j],
                2.5 * second[j] + 1.5 * at * third[j],
                2.5 * second_at_end + 1.5 * end * third[j],
                half_width,
            );
            let for_jerk = parabola(
                first[j] + at * (9.0 * second[j] + 4.5 * at * third[j]),
                10.0 * second[j] + 18.0 * at * third[j],
                10.0 * second_at_end + 18.0 * end * third[j],
                half_width,
            );
            let speed = slopes / limits.velocity[j];
            demand.square = demand.square.max(speed * speed);
            demand.acceleration =
                demand.acceleration.max(for_acceleration / limits.acceleration[j]);
            demand.jerk = demand.jerk.max(for_jerk / jerk[j]);
        }
        demand
    }

    /// Acceleration of the path at the end of a ramp of that length with the largest jerk.
    fn by_jerk(&self, length: f64) -> f64 {
        libm::cbrt(6.0 * length / (self.jerk * self.jerk))
    }

    /// The largest acceleration of the path that the other limits allow there.
    fn by_others(&self, length: f64) -> f64 {
        (1.0 / self.acceleration).min(1.0 / (1.5 * length * self.square))
    }

    fn jerk_decides_no_more(&self, length: f64) -> bool {
        self.by_jerk(length) >= self.by_others(length)
    }
}

/// Bound to the size of a parabola on an interval, from its value at the start and its slopes at
/// both ends.
fn parabola(start: f64, slope: f64, slope_at_end: f64, half_width: f64) -> f64 {
    let middle = start + half_width * slope;
    let end = middle + half_width * slope_at_end;
    start.abs().max(middle.abs()).max(end.abs())
}

#[cfg(test)]
mod tests {
    use super::super::grid::grid;
    use super::*;
    use crate::path::joint_path::JointPath;
    use crate::robot::{DOF, JointConfig};

    const LIMITS: MotionLimits =
        MotionLimits { velocity: [2.0; DOF], acceleration: [10.0; DOF], jerk: None };

    fn straight(length: f32) -> SmoothPath {
        let ends = [0.0, length].map(|x| JointConfig::new([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        <SmoothPath>::through(&JointPath::new(ends.to_vec()).unwrap())
    }

    fn ramp(path: &SmoothPath, jerk: f64) -> Ramp {
        let intervals = grid(path);
        Ramp::over(path, &intervals[..intervals.len() / 2], &LIMITS, &[jerk; DOF])
    }

    #[test]
    fn on_a_line_a_ramp_takes_the_time_of_acceleration_over_jerk() {
        // 0.1 s at 100 rad/s³: 1/60 rad, and 0.5 rad/s at its end.
        let ramp = ramp(&straight(3.0), 100.0);
        assert!((ramp.length - 1.0 / 60.0).abs() < 1e-9, "{ramp:?}");
        assert!((ramp.max_square - 0.25).abs() < 1e-7, "{ramp:?}");
    }

    #[test]
    fn a_way_too_short_for_the_acceleration_is_half_a_ramp() {
        let ramp = ramp(&straight(0.01), 10.0);
        assert_eq!((ramp.n_whole, ramp.share), (64, 0.0));
        // s = j t³ / 6, v = j t² / 2.
        let time = libm::cbrt(6.0 * 0.005 / 10.0);
        assert!((libm::sqrt(ramp.max_square) - 5.0 * time * time).abs() < 1e-8, "{ramp:?}");
    }
}
