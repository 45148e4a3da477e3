//! Paths of the baselines that rank nothing.

use super::candidates::goal_configs;
use super::{CandidatePath, CandidateSettings, CandidateStreams, JointPath, PathQuery, Rejection, Source, linear_path};
use crate::scene::{ArmSpheres, MotionChecker};

/// The path of C2F-ARM without ranking: the straight line of the grip, else the shortest straight joint-space motion to a goal
/// configuration (what `RRTConnect` finds with collision checking off).
///
/// # Errors
///
/// [`Rejection::Unreachable`] when the goal pose has no solution.
pub fn c2farm_path(
    query: &PathQuery<'_>,
    settings: &CandidateSettings,
    streams: CandidateStreams,
) -> Result<CandidatePath, Rejection> {
    linear_candidate(query, settings).or_else(|_| {
        let goals = goal_configs(query, settings, streams);
        let nearest = goals.into_iter().min_by(|a, b| query.start.distance(a).total_cmp(&query.start.distance(b)));
        let path = JointPath(vec![query.start, nearest.ok_or(Rejection::Unreachable)?]);
        Ok(candidate(query, settings, Source::Planner, path.subdivide(settings.path_len)))
    })
}

/// The straight line of the grip alone.
///
/// # Errors
///
/// When the arm cannot follow the line: [`Rejection::CurveUnreachable`] or [`Rejection::BranchJump`].
pub fn linear_candidate(query: &PathQuery<'_>, settings: &CandidateSettings) -> Result<CandidatePath, Rejection> {
    let path = linear_path(query.robot, &query.start, &query.goal)?;
    Ok(candidate(query, settings, Source::Linear, path.resample(settings.path_len)))
}

fn candidate(query: &PathQuery<'_>, settings: &CandidateSettings, source: Source, path: JointPath) -> CandidatePath {
    let arm = ArmSpheres::new(query.robot);
    let collides = !MotionChecker::new(query.scene, &arm, settings.rrt.checks_per_radian).path_is_free(path.configs());
    CandidatePath { source, path, collides }
}
