//! The set of candidate paths that the ranker sees (Algorithm 1, lines 7–10).
//!
//! What ranks is what runs: every candidate is the `T` configurations that the arm will follow,
//! joined linearly, and `collides` is computed on them.
//!
//! # Differences from the paper
//!
//! - `M` and `B` count admitted paths: a draw that fails is repeated a few times, and every failure
//!   is listed with its reason.
//! - The share of planner paths with collision checking off are straight joint-space motions: what
//!   `RRTConnect` finds when nothing is in the way.
//! - When the goal pose has fewer than `M` distinct configurations, the checked planner paths share
//!   them with other samples of `RRTConnect`; a path that comes out twice is kept once.
//! - A screw motion of the grip can be asked for besides; no preset does.

mod baseline;

pub use baseline::{c2farm_path, linear_candidate};

use crate::error::{Error, Result};
use crate::path::curves::{BezierCurve, BezierSettings, ScrewMotion};
use crate::path::joint_path::JointPath;
use crate::path::planners::{PlannerKind, PlannerSettings, RrtSettings, plan_with, shortcut};
use crate::path::rejection::Rejection;
use crate::path::source::Source;
use crate::rng::{self, Rng, Stream};
use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, MotionChecker, Scene};
use glamx::Pose3;
use serde::{Deserialize, Serialize};

/// Numbers of the candidate set.
///
/// ```
/// use lpr_core::path::{BezierSettings, CandidateSettings, PlannerKind, RrtSettings};
///
/// let settings = CandidateSettings {
///     path_len: 30,
///     planner_paths: 20,
///     bezier_paths: 20,
///     screw_paths: 0,
///     planner_collision_free_fraction: 0.5,
///     draws_per_path: 5,
///     min_goal_distance: 0.2,
///     planner: PlannerKind::RrtConnect,
///     rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
///     bezier: BezierSettings { sigma: 0.25 },
/// };
/// assert_eq!(settings.check(), Ok(()));
/// let too_short = CandidateSettings { path_len: 1, ..settings };
/// assert_eq!(too_short.check().unwrap_err().to_string(), "configuration: path_len: at least 2");
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateSettings {
    /// Configurations of every path (`T` in the paper).
    pub path_len: usize,
    /// Planner paths asked for (`M` in the paper).
    pub planner_paths: usize,
    /// Bézier paths asked for (`B` in the paper).
    pub bezier_paths: usize,
    /// Share of the planner paths that are planned with collision checking on, 0 to 1 ("a portion"
    /// in the paper).
    pub planner_collision_free_fraction: f32,
    /// Screw motions of the grip asked for, 0 or 1: there is one from start to goal. Beyond the
    /// paper; settings files that do not say mean none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub screw_paths: usize,
    /// Draws for every path before it is given up.
    pub draws_per_path: usize,
    /// Two goal configurations differ by more than this in some joint, radians.
    pub min_goal_distance: f32,
    /// Which planner; settings files that name none mean `RRTConnect`, the paper's.
    #[serde(default, skip_serializing_if = "PlannerKind::is_default")]
    pub planner: PlannerKind,
    /// The numbers of `RRTConnect`, and the resolution of all checks; the other planners have their
    /// standard numbers.
    pub rrt: RrtSettings,
    /// The curves.
    pub bezier: BezierSettings,
}

impl CandidateSettings {
    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// Naming the first setting that is out of its range.
    pub fn check(&self) -> Result<()> {
        /// Draws of one set: the numbers of their streams are unique below this.
        const MAX_DRAWS: usize = 1 << DRAW_BITS;
        let n_paths = self.planner_paths.max(self.bezier_paths);
        let rules = [
            (self.path_len >= 2, "path_len: at least 2"),
            (self.screw_paths <= 1, "screw_paths: 0 or 1"),
            (self.draws_per_path >= 1, "draws_per_path: at least 1"),
            (
                n_paths.saturating_mul(self.draws_per_path) <= MAX_DRAWS,
                "paths times draws_per_path: at most 65536",
            ),
            (
                (0.0..=1.0).contains(&self.planner_collision_free_fraction),
                "planner_collision_free_fraction: 0 to 1",
            ),
            (
                self.min_goal_distance.is_finite() && self.min_goal_distance >= 0.0,
                "min_goal_distance: at least 0",
            ),
            (self.rrt.range > 0.0, "rrt.range: above 0"),
            (
                self.rrt.checks_per_radian.is_finite() && self.rrt.checks_per_radian > 0.0,
                "rrt.checks_per_radian: above 0",
            ),
            (self.bezier.sigma.is_finite() && self.bezier.sigma >= 0.0, "bezier.sigma: at least 0"),
        ];
        rules
            .iter()
            .find(|(holds, _)| !holds)
            .map_or(Ok(()), |(_, rule)| Err(Error::Config((*rule).to_owned())))
    }
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands a reference to what decides on skipping"
)]
const fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// What a candidate set is asked for.
#[derive(Debug, Clone, Copy)]
pub struct PathQuery<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// Where it is.
    pub start: JointConfig,
    /// `world_from_grip` where it goes: the next-best pose.
    pub goal: Pose3,
    /// What it must not hit.
    pub scene: &'a Scene,
    /// The path policy's proposal.
    pub policy_path: Option<&'a JointPath>,
}

/// Which generators a candidate set draws from: one for every stream and draw, so that no draw
/// moves another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CandidateStreams {
    /// Seed of the run.
    pub seed: u64,
    /// Number of the environment step that the set is for, counted over the whole run; below 2⁴⁰.
    pub step: u64,
}

/// Bits of a stream's index that count the draws of one set.
const DRAW_BITS: u32 = 16;

impl CandidateStreams {
    fn rng(self, stream: Stream, draw: usize) -> Rng {
        rng::stream(self.seed, stream, (self.step << DRAW_BITS) | draw as u64)
    }
}

/// A path that the arm can follow, for the ranker.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidatePath {
    /// Which generator made it (`m`, `b` or `π` in the paper).
    pub source: Source,
    /// `T` configurations, joined linearly.
    pub path: JointPath,
    /// Whether the arm meets the scene or itself on the way.
    pub collides: bool,
}

/// A draw that gave no path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RejectedPath {
    /// Which generator failed.
    pub source: Source,
    /// Why.
    pub reason: Rejection,
}

/// The candidates (`Ξ` in the paper) and what was rejected, both in the order planner, Bézier,
/// screw, policy.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidateSet {
    /// Paths to rank.
    pub candidates: Vec<CandidatePath>,
    /// Draws that gave none.
    pub rejected: Vec<RejectedPath>,
}

impl CandidateSet {
    /// The shortest candidate that does not collide.
    #[must_use]
    pub fn shortest_free(&self) -> Option<&CandidatePath> {
        let free = self.candidates.iter().filter(|candidate| !candidate.collides);
        free.min_by(|a, b| a.path.length().total_cmp(&b.path.length()))
    }

    fn add(&mut self, source: Source, outcomes: Vec<Outcome>) {
        for outcome in outcomes {
            self.rejected
                .extend(outcome.failures.into_iter().map(|reason| RejectedPath { source, reason }));
            let Some((path, collides)) = outcome.path else { continue };
            if self.candidates.iter().any(|other| other.path == path) {
                self.rejected.push(RejectedPath { source, reason: Rejection::TooFewGoals });
            } else {
                self.candidates.push(CandidatePath { source, path, collides });
            }
        }
    }
}

/// What the draws for one path gave: the path with its `collides` flag, if any, and the failures
/// before it.
#[derive(Debug, Clone, PartialEq)]
struct Outcome {
    path: Option<(JointPath, bool)>,
    failures: Vec<Rejection>,
}

impl From<Rejection> for Outcome {
    fn from(reason: Rejection) -> Self {
        Self { path: None, failures: vec![reason] }
    }
}

/// The candidate paths for `query`, deterministic for its streams and the same for any number of
/// threads.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::path::{BezierSettings, CandidateSettings, CandidateStreams, PathQuery, PlannerKind, RrtSettings};
/// use lpr_core::path::{Source, candidates};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{Primitive, Scene};
///
/// let settings = CandidateSettings {
///     path_len: 10,
///     planner_paths: 4,
///     bezier_paths: 4,
///     screw_paths: 0,
///     planner_collision_free_fraction: 0.5,
///     draws_per_path: 5,
///     min_goal_distance: 0.2,
///     planner: PlannerKind::RrtConnect,
///     rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
///     bezier: BezierSettings { sigma: 0.25 },
/// };
/// let start = XARM7.grip(&XARM7.start);
/// let goal = Pose3::from_parts(start.translation + Vec3::new(0.0, 0.3, 0.0), start.rotation);
/// let post = Primitive::Sphere { center: start.translation + Vec3::new(0.0, 0.15, 0.0), radius: 0.02 };
/// let scene = Scene::from_primitives(vec![post]);
/// let query = PathQuery { robot: &XARM7, start: XARM7.start, goal, scene: &scene, policy_path: None };
/// let set = candidates(&query, &settings, CandidateStreams { seed: 0, step: 0 });
///
/// assert!(set.candidates.iter().all(|candidate| candidate.path.configs().len() == 10));
/// assert!(set.candidates.iter().any(|candidate| candidate.source == Source::Bezier));
/// assert!(set.candidates.iter().any(|candidate| candidate.collides), "half are planned without a look at the post");
/// assert!(set.shortest_free().is_some_and(|shortest| !shortest.collides));
/// ```
///
/// # Panics
///
/// When `path_len` is below 2: [`CandidateSettings::check`] refuses it.
#[must_use]
pub fn candidates(
    query: &PathQuery<'_>,
    settings: &CandidateSettings,
    streams: CandidateStreams,
) -> CandidateSet {
    let generator = Generator { query, settings, streams, arm: &ArmSpheres::new(query.robot) };
    let goals = goal_configs(query, settings, streams);
    let mut set = CandidateSet { candidates: Vec::new(), rejected: Vec::new() };
    set.add(Source::Planner, generator.planner_paths(&goals));
    set.add(Source::Bezier, generator.bezier_paths(&goals));
    set.add(Source::Screw, generator.screw_paths(&goals));
    if let Some(proposal) = query.policy_path {
        let lengths = set.candidates.iter().map(|candidate| candidate.path.length());
        let mean = (!set.candidates.is_empty())
            .then(|| lengths.sum::<f32>() / set.candidates.len() as f32);
        set.add(
            Source::Policy,
            vec![generator.policy_path(proposal, mean).unwrap_or_else(Outcome::from)],
        );
    }
    set
}

/// Distinct goal configurations, as many as planner paths if there are so many; none for a start or
/// goal that is not finite.
pub(super) fn goal_configs(
    query: &PathQuery<'_>,
    settings: &CandidateSettings,
    streams: CandidateStreams,
) -> Vec<JointConfig> {
    if !query.start.is_finite() || !query.goal.is_finite() {
        return Vec::new();
    }
    let n = settings.planner_paths.max(1);
    query.robot.ik_distinct(
        &query.goal,
        n,
        settings.min_goal_distance,
        &query.start,
        &mut streams.rng(Stream::Ik, 0),
    )
}

/// What every generator needs.
struct Generator<'a> {
    query: &'a PathQuery<'a>,
    settings: &'a CandidateSettings,
    streams: CandidateStreams,
    arm: &'a ArmSpheres,
}

impl Generator<'_> {
    /// Planner paths (`M`): those with checks on go to the free goals from the first, those with
    /// checks off to the goals from the last, in turns.
    fn planner_paths(&self, goals: &[JointConfig]) -> Vec<Outcome> {
        let checker = self.checker();
        let free_goals: Vec<JointConfig> =
            goals.iter().copied().filter(|goal| checker.is_free(goal)).collect();
        let start_is_free = checker.is_free(&self.query.start);
        map_in_order(self.settings.planner_paths, |path_idx| {
            let n_checked = |n: usize| {
                (n as f64 * f64::from(self.settings.planner_collision_free_fraction)) as usize
            };
            let checked_idx = n_checked(path_idx);
            let is_checked = n_checked(path_idx + 1) > checked_idx;
            match () {
                () if goals.is_empty() => Rejection::Unreachable.into(),
                () if !is_checked => self.straight_path(goals, path_idx - checked_idx),
                () if !start_is_free => Rejection::StartCollides.into(),
                () if free_goals.is_empty() => Rejection::GoalCollides.into(),
                () => self.checked_path(&free_goals, checked_idx, path_idx),
            }
        })
    }

    /// The straight joint-space motion to the goal number `idx` from the last.
    fn straight_path(&self, goals: &[JointConfig], idx: usize) -> Outcome {
        let Some(goal) = goals.iter().rev().nth(idx) else { return Rejection::TooFewGoals.into() };
        let path = JointPath(vec![self.query.start, *goal]).subdivide(self.settings.path_len);
        self.admitted(path, Vec::new())
    }

    /// A free path to the goal number `goal_idx`, or to the following ones where the planner fails.
    fn checked_path(
        &self,
        free_goals: &[JointConfig],
        goal_idx: usize,
        path_idx: usize,
    ) -> Outcome {
        let checker = self.checker();
        self.first_success(|draw| {
            let goal = free_goals[(goal_idx + draw) % free_goals.len()];
            let rng = &mut self
                .streams
                .rng(Stream::Planner, path_idx * self.settings.draws_per_path + draw);
            let numbers = PlannerSettings::standard(self.settings.rrt.clone());
            let plan = plan_with(
                self.settings.planner,
                &checker,
                &self.query.start,
                &[goal],
                &numbers,
                rng,
            )?;
            Ok(shortcut(&plan.path, &checker).subdivide(self.settings.path_len))
        })
    }

    /// Bézier paths (`B`).
    fn bezier_paths(&self, goals: &[JointConfig]) -> Vec<Outcome> {
        let start_pose = self.query.robot.grip(&self.query.start);
        map_in_order(self.settings.bezier_paths, |path_idx| {
            if goals.is_empty() {
                return Rejection::Unreachable.into();
            }
            self.first_success(|draw| {
                let rng = &mut self
                    .streams
                    .rng(Stream::Bezier, path_idx * self.settings.draws_per_path + draw);
                let curve =
                    BezierCurve::sample(&start_pose, &self.query.goal, &self.settings.bezier, rng);
                let path = curve.to_joints(self.query.robot, &self.query.start)?;
                Ok(path.resample(self.settings.path_len))
            })
        })
    }

    /// The screw motion, if it is asked for.
    fn screw_paths(&self, goals: &[JointConfig]) -> Vec<Outcome> {
        let outcome = || match goals {
            [] => Rejection::Unreachable.into(),
            _ => self.screw_path().unwrap_or_else(Outcome::from),
        };
        (0..self.settings.screw_paths).map(|_| outcome()).collect()
    }

    fn screw_path(&self) -> Result<Outcome, Rejection> {
        let PathQuery { robot, start, goal, .. } = self.query;
        let path = ScrewMotion::between(&robot.grip(start), goal).to_joints(robot, start)?;
        Ok(self.admitted(path.resample(self.settings.path_len), Vec::new()))
    }

    /// The policy's path with its ends moved to the start and the nearest goal configuration;
    /// `mean_length` is that of the other candidates, if there are any (section IV-B).
    fn policy_path(
        &self,
        proposal: &JointPath,
        mean_length: Option<f32>,
    ) -> Result<Outcome, Rejection> {
        let goal = self
            .query
            .robot
            .ik_nearest(&self.query.goal, proposal.goal())
            .ok_or(Rejection::Unreachable)?;
        let mut path = proposal.resample(self.settings.path_len);
        let last = path.0.len() - 1;
        path.0[0] = self.query.start;
        path.0[last] = goal;
        if !path.0.iter().skip(1).all(|config| self.query.robot.within_limits(config)) {
            return Err(Rejection::OutsideLimits);
        }
        if mean_length.is_some_and(|mean| path.length() >= mean) {
            return Err(Rejection::LongerThanMean);
        }
        Ok(self.admitted(path, Vec::new()))
    }

    /// Draws until one gives a path.
    fn first_success(&self, draw_path: impl Fn(usize) -> Result<JointPath, Rejection>) -> Outcome {
        let mut failures = Vec::new();
        for draw in 0..self.settings.draws_per_path {
            match draw_path(draw) {
                Ok(path) => return self.admitted(path, failures),
                Err(reason) => failures.push(reason),
            }
        }
        Outcome { path: None, failures }
    }

    fn admitted(&self, path: JointPath, failures: Vec<Rejection>) -> Outcome {
        let collides = !self.checker().path_is_free(path.configs());
        Outcome { path: Some((path, collides)), failures }
    }

    const fn checker(&self) -> MotionChecker<'_> {
        MotionChecker::new(self.query.scene, self.arm, self.settings.rrt.checks_per_radian)
    }
}

/// `f(0)`, `f(1)`, … in order, computed by any number of threads.
#[cfg(feature = "parallel")]
pub(crate) fn map_in_order<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};
    (0..n).into_par_iter().map(f).collect()
}

/// `f(0)`, `f(1)`, … in order.
#[cfg(not(feature = "parallel"))]
pub(crate) fn map_in_order<T>(n: usize, f: impl Fn(usize) -> T) -> Vec<T> {
    (0..n).map(f).collect()
}

#[cfg(test)]
mod tests;
