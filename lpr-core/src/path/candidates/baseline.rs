//! Paths of the baselines that rank nothing.

use super::query::{CandidateStreams, PathQuery};
use super::sampler::goal_configs;
use super::set::CandidatePath;
use super::settings::CandidateSettings;
use crate::path::curves::linear_path;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::path::source::Source;
use crate::scene::{ArmSpheres, MotionChecker};

/// The path of C2F-ARM without ranking: the straight line of the grip, else the shortest straight
/// joint-space motion to a goal configuration (what `RRTConnect` finds with collision checking
/// off).
///
/// ```
/// use lpr_core::glamx::{Pose3, Quat, Vec3};
/// use lpr_core::path::{CandidateSettings, CandidateStreams, PathQuery, Rejection, Source};
/// use lpr_core::path::{c2farm_path, linear_candidate};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::Scene;
///
/// let settings = CandidateSettings::EXAMPLE;
/// // From one side of the base to the other: the straight line of the grip leads through it.
/// let at = |y: f32| Pose3::from_parts(Vec3::new(0.0, y, 0.1), Quat::from_rotation_x(core::f32::consts::PI));
/// let start = XARM7.ik_nearest(&at(-0.4), &XARM7.start).ok_or(Rejection::Unreachable)?;
/// let scene = Scene::empty();
/// let query = PathQuery { robot: &XARM7, start, goal: at(0.4), scene: &scene };
/// assert!(linear_candidate(&query, &settings).is_err());
/// let path = c2farm_path(&query, &settings, CandidateStreams { seed: 0, step: 0 })?;
/// assert_eq!((path.source, path.path.configs().len()), (Source::Planner, 10));
/// # Ok::<(), Rejection>(())
/// ```
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
        let nearest = goals
            .into_iter()
            .min_by(|a, b| query.start.distance(a).total_cmp(&query.start.distance(b)));
        let path = JointPath(vec![query.start, nearest.ok_or(Rejection::Unreachable)?]);
        Ok(candidate(query, settings, Source::Planner, path.subdivide(settings.path_len)))
    })
}

/// The straight line of the grip alone.
///
/// # Errors
///
/// When the arm cannot follow the line: [`Rejection::CurveUnreachable`] or
/// [`Rejection::BranchJump`].
pub fn linear_candidate(
    query: &PathQuery<'_>,
    settings: &CandidateSettings,
) -> Result<CandidatePath, Rejection> {
    let path = linear_path(query.robot, &query.start, &query.goal)?;
    Ok(candidate(query, settings, Source::Linear, path.resample(settings.path_len)))
}

fn candidate(
    query: &PathQuery<'_>,
    settings: &CandidateSettings,
    source: Source,
    path: JointPath,
) -> CandidatePath {
    let arm = ArmSpheres::new(query.robot);
    let collides = !MotionChecker::new(query.scene, &arm, settings.rrt.checks_per_radian)
        .path_is_free(path.configs());
    CandidatePath { source, path, collides }
}
