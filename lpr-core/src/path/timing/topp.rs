//! The fastest motion along a smooth curve that keeps the limits of joints and grip.
//!
//! Reachability analysis after Pham and Pham, "A New Approach to Time-Optimal Path Parameterization
//! Based on Reachability Analysis" (2018): from the goal back, every grid point gets the highest
//! speed from which the rest of the path can be driven; from the start forth, the path is driven as
//! fast as these allow.
//!
//! # Differences from the paper
//!
//! - Limits are kept on all of the path, not at grid points: see `envelope.rs`.
//! - All limits are symmetric, so that standing still is always allowed and every controllable set
//!   begins at 0.
//! - With a jerk limit the accelerations grow from 0 on a ramp at the start and fall to 0 on one at
//!   the end; each joins the motion between them without a jump. Between the ramps accelerations
//!   may jump, as time-optimal ones do. Where the curve is too short or too bent for a ramp to
//!   reach the largest acceleration, the jump stands after the interval that follows the ramp.

mod envelope;
mod grid;
mod grip;
mod grip_bound;
mod motion;
mod passes;
mod ramp;
mod spline;
mod trajectory;

pub use spline::SmoothPath;
pub use trajectory::Trajectory;

use super::motion_limits::{GripSpeedLimit, MotionLimits};
use crate::error::Result;
use crate::robot::DOF;
use envelope::{FEW, MANY};
use grid::{Interval, grid, reversed};
use grip::limit_grip;
use motion::PathMotion;
use passes::{Ramps, squared_speeds};
use ramp::Ramp;

/// The fastest motion from rest at the start of `path` to rest at its goal.
///
/// The same bits natively and in wasm. A path that stays takes no time.
///
/// ```
/// use lpr_core::path::{JointPath, MotionLimits, SmoothPath, time_optimal};
/// use lpr_core::robot::JointConfig;
///
/// let configs = [0.0, 0.4, 1.0].map(|q| JointConfig::new([q, q * q, 0.0, 0.0, 0.0, 0.0, 0.0]));
/// let path = SmoothPath::through(&JointPath::new(configs.to_vec())?);
/// let limits = MotionLimits { velocity: [1.0; 7], acceleration: [4.0; 7], jerk: None };
/// let motion = time_optimal(&path, &limits, None)?;
/// for (_, state) in motion.samples(0.01)? {
///     let fastest = state.velocities.iter().fold(0.0_f64, |most, speed| most.max(speed.abs()));
///     assert!(fastest < 1.0 + 1e-6, "rad/s");
/// }
/// let slower = MotionLimits { velocity: [0.5; 7], ..limits };
/// assert!(time_optimal(&path, &slower, None)?.duration_secs() > motion.duration_secs());
/// # Ok::<(), lpr_core::Error>(())
/// ```
///
/// # Errors
///
/// When a limit is not a positive number, or so small that the duration is none.
pub fn time_optimal<const N: usize>(
    path: &SmoothPath<N>,
    limits: &MotionLimits<N>,
    grip: Option<&GripSpeedLimit<'_>>,
) -> Result<Trajectory<N>> {
    limits.check()?;
    grip.map_or(Ok(()), GripSpeedLimit::check)?;
    let (start, goal) = (path.angles_at(0.0), path.angles_at(path.chord_length()));
    // Arrays of the built-in arms' size stay as small as they can be.
    let fastest = if N <= DOF { fastest::<N, FEW> } else { fastest::<N, MANY> };
    let motion = (path.n_pieces() > 0).then(|| fastest(path, limits, grip));
    Trajectory::new(start, goal, motion)
}

fn fastest<const N: usize, const G: usize>(
    path: &SmoothPath<N>,
    limits: &MotionLimits<N>,
    grip: Option<&GripSpeedLimit<'_>>,
) -> PathMotion<N> {
    let mut intervals = grid(path);
    if let Some(limit) = grip {
        limit_grip(path, &mut intervals, limit);
    }
    let ramps = limits.jerk.map(|jerk| {
        // Less than half of the curve for each ramp, so that an interval is left between them.
        let half = intervals.len() / 2 - 1;
        let start = Ramp::over(path, &intervals[..half], limits, &jerk);
        let end = Ramp::over(&path.reversed(), &reversed(path, &intervals)[..half], limits, &jerk);
        Ramps { start, end }
    });
    let between =
        ramps.map_or_else(|| intervals.clone(), |ramps| without_ramps(&intervals, &ramps));
    let squares = squared_speeds::<N, G>(path, &between, limits, ramps.as_ref());
    PathMotion::new(path.clone(), &between, &squares, ramps.as_ref())
}

/// The intervals between the ramps.
fn without_ramps(intervals: &[Interval], Ramps { start, end }: &Ramps) -> Vec<Interval> {
    let mut between = intervals[start.n_whole..intervals.len() - end.n_whole].to_vec();
    let last = between.len() - 1;
    if start.share > 0.0 {
        between[0] = between[0].after(start.share);
    }
    if end.share > 0.0 {
        between[last] = between[last].before(1.0 - end.share);
    }
    between
}

#[cfg(test)]
mod golden;
#[cfg(test)]
mod tests;
