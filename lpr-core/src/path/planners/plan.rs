//! Parts that all planners share: their result, the checks of the ends, the second look, samples.

use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::{DOF, JointConfig, JointRanges};
use crate::scene::MotionChecker;
use core::f32::consts::PI;
use core::f64::consts::TAU;
use rand::RngExt as _;

/// Resolution at which a path found is looked at, in resolutions of the search.
pub const FINER: f32 = 2.0;

/// A range for every joint, radians or metres.
pub(super) type Bounds = JointRanges;

/// A path found, and what it took.
///
/// ```
/// use lpr_core::path::{RrtSettings, rrt_connect};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::{JointConfig, PANDA};
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Scene};
///
/// let (scene, arm) = (Scene::empty(), ArmSpheres::new(&PANDA));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let settings = RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 100 };
/// let goal = PANDA.start.map(|q| q + 0.1);
/// let plan = rrt_connect(&checker, &PANDA.start, &[goal], &settings, &mut stream(0, Stream::Planner, 0)).unwrap();
/// assert_eq!((plan.path.configs(), plan.iterations), (&[PANDA.start, goal][..], 0), "nothing is in the straight way");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// A free path, not yet shortened.
    pub path: JointPath,
    /// Samples drawn, or steps of an optimisation; 0 when the straight motion is free.
    pub iterations: u32,
}

/// The straight motion to a goal if one is free, else what `search` finds to the goals that are.
///
/// The edges of the path found, which `search` has checked, are looked at once more half-way
/// between those checks, and closer where something deeper than 1 mm could lie between. Should one
/// turn out to hit something there, the search is repeated at [`FINER`] times the resolution, and
/// with all of its edges looked at that closely.
pub(super) fn search_twice(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    mut search: impl FnMut(&MotionChecker<'_>, &[JointConfig]) -> Result<Plan, Rejection>,
) -> Result<Plan, Rejection> {
    let goals = free_goals(checker, start, goals)?;
    let mut search = |checker: &MotionChecker<'_>| {
        straight(checker, start, &goals).map_or_else(|| search(checker, &goals), Ok)
    };
    let plan = search(checker)?;
    // Only these edges, a few of the thousands that were checked, are worth a second look.
    if plan.path.configs().windows(2).all(|edge| checker.is_free_between(&edge[0], &edge[1])) {
        return Ok(plan);
    }
    let fine = checker.exact(FINER);
    let finer = search(&fine);
    checker.count(&fine);
    finer.map(|finer| Plan { iterations: plan.iterations + finer.iterations, ..finer })
}

/// The goals within the limits that touch nothing. A start may be beyond its limits: arms stop
/// there, and are to come back.
fn free_goals(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
) -> Result<Vec<JointConfig>, Rejection> {
    if goals.is_empty() {
        return Err(Rejection::Unreachable);
    }
    let mut goals: Vec<JointConfig> = unwound(checker.arm().limits(), start, goals)
        .into_iter()
        .filter(|goal| checker.arm().is_within_limits(goal))
        .collect();
    if goals.is_empty() || !start.is_finite() {
        return Err(Rejection::OutsideLimits);
    }
    if !checker.is_free(start) {
        return Err(Rejection::StartCollides);
    }
    goals.retain(|goal| checker.is_free(goal));
    if goals.is_empty() { Err(Rejection::GoalCollides) } else { Ok(goals) }
}

/// The goals in the windings nearest to the start of the joints that turn without end, and after
/// them each the other way round, joint by joint: where something is in the short way.
fn unwound(limits: &[(f32, f32)], start: &JointConfig, goals: &[JointConfig]) -> Vec<JointConfig> {
    let endless: Vec<usize> = (limits.iter().enumerate())
        .filter(|(_, (lower, upper))| upper - lower == f32::INFINITY)
        .map(|(j, _)| j)
        .collect();
    if endless.is_empty() || goals.iter().any(|goal| goal.dof() != start.dof()) {
        return goals.to_vec();
    }
    let turned = |q: f32, turns: f64| (f64::from(q) + TAU * turns) as f32;
    let mut nearest = goals.to_vec();
    for goal in &mut nearest {
        for &j in &endless {
            let away = f64::from(start[j]) - f64::from(goal[j]);
            goal[j] = turned(goal[j], libm::round(away / TAU));
        }
    }
    let others = nearest.iter().flat_map(|goal| {
        endless.iter().map(|&j| {
            let mut other = *goal;
            other[j] = turned(goal[j], if goal[j] > start[j] { -1.0 } else { 1.0 });
            other
        })
    });
    let others: Vec<JointConfig> = others.collect();
    [nearest, others].concat()
}

/// The straight motion to the first goal that it reaches.
fn straight(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
) -> Option<Plan> {
    let goal = goals.iter().find(|goal| checker.motion_is_free(start, goal))?;
    Some(Plan { path: JointPath(vec![*start, *goal]), iterations: 0 })
}

/// Range of every joint that is sampled.
pub(super) fn sampling_bounds(
    limits: &[(f32, f32)],
    start: &JointConfig,
    goals: &[JointConfig],
) -> Bounds {
    let range = |j: usize| {
        let (low, high) = goals
            .iter()
            .fold((start[j], start[j]), |(low, high), goal| (goal[j].min(low), goal[j].max(high)));
        (limits[j].0.max(low - PI), limits[j].1.min(high + PI))
    };
    (0..limits.len()).map(range).collect()
}

/// A configuration anywhere within `bounds`.
///
/// A sample takes at least seven numbers from the generator: plans of arms with fewer joints stay
/// those of their seeds, from when every configuration had seven entries.
pub(super) fn sample_within(bounds: &[(f32, f32)], rng: &mut Rng) -> JointConfig {
    let sample = JointConfig::from_fn(bounds.len(), |j| {
        let (lower, upper) = bounds[j];
        lower + (upper - lower) * rng.random::<f32>()
    });
    for _ in bounds.len()..DOF {
        rng.random::<f32>();
    }
    sample
}

/// The configuration moved into `bounds`.
pub(super) fn clamped(config: &JointConfig, bounds: &[(f32, f32)]) -> JointConfig {
    JointConfig::from_fn(bounds.len(), |j| config[j].max(bounds[j].0).min(bounds[j].1))
}

/// A configuration within `bounds`, or moved there, none of whose joints is further than `distance`
/// (radians) from that of `center`.
pub(super) fn sample_near(
    bounds: &[(f32, f32)],
    center: &JointConfig,
    distance: f32,
    rng: &mut Rng,
) -> JointConfig {
    let center = clamped(center, bounds);
    let near: Bounds = (center.iter().zip(bounds))
        .map(|(q, (lower, upper))| ((q - distance).max(*lower), (q + distance).min(*upper)))
        .collect();
    sample_within(&near, rng)
}
