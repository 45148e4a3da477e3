//! The two passes: how fast the path can be driven at most, from the goal back, and how fast it is
//! driven, from the start forth.

use super::envelope::{Constraints, Ray};
use super::grid::Interval;
use super::ramp::Ramp;
use super::spline::SmoothPath;
use crate::path::timing::motion_limits::MotionLimits;

/// The ramps before and after a row of intervals.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ramps {
    pub(super) start: Ramp,
    /// On the reversed curve.
    pub(super) end: Ramp,
}

/// The largest squares of the path's speed at the start of every interval and at the end of the
/// last, (rad/s)².
///
/// Without ramps the path starts and ends at rest. With them it goes on from a ramp, or towards
/// one, at the acceleration that the ramp has there.
pub(super) fn squared_speeds<const N: usize, const G: usize>(
    path: &SmoothPath<N>,
    intervals: &[Interval],
    limits: &MotionLimits<N>,
    ramps: Option<&Ramps>,
) -> Vec<f64> {
    let rays = controllable::<N, G>(path, intervals, limits, ramps);
    let mut squares = Vec::with_capacity(intervals.len() + 1);
    squares.push(ramps.map_or(0.0, |ramps| ramps.start.max_square.min(rays[0].max)));
    for (idx, interval) in intervals.iter().enumerate() {
        let square = squares[idx];
        let is_driven_along_its_ray = idx + 1 == intervals.len() || (idx == 0 && ramps.is_some());
        squares.push(if is_driven_along_its_ray {
            rays[idx].ratio * square
        } else {
            let max_end = rays[idx + 1].max;
            let constraints =
                Constraints::<G>::of(&path.piece(interval.piece), interval, limits, max_end);
            constraints.largest_end(square, rays[idx]).min(max_end)
        });
    }
    squares
}

/// For every interval the largest square at its start from which the rest can be driven, and how it
/// then goes on.
fn controllable<const N: usize, const G: usize>(
    path: &SmoothPath<N>,
    intervals: &[Interval],
    limits: &MotionLimits<N>,
    ramps: Option<&Ramps>,
) -> Vec<Ray> {
    let mut rays = vec![Ray { ratio: 0.0, max: 0.0 }; intervals.len()];
    let mut max_end = ramps.map_or(0.0, |ramps| ramps.end.max_square);
    for (idx, interval) in intervals.iter().enumerate().rev() {
        let constraints =
            Constraints::<G>::of(&path.piece(interval.piece), interval, limits, max_end);
        rays[idx] = match ramps {
            Some(ramps) if idx + 1 == intervals.len() => {
                constraints.ray(1.0 / growth(interval, &ramps.end))
            }
            Some(ramps) if idx == 0 => constraints.ray(growth(interval, &ramps.start)),
            None if idx + 1 == intervals.len() => constraints.ray(0.0),
            _ => constraints.highest_ray(max_end),
        };
        max_end = rays[idx].max;
    }
    rays
}

/// By which factor the squared speed grows on an interval at the acceleration with which a ramp
/// ends.
fn growth(interval: &Interval, ramp: &Ramp) -> f64 {
    1.0 + 4.0 / 3.0 * interval.width / ramp.length
}
