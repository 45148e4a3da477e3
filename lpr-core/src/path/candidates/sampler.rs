//! The generators of candidates: lines 8–11 of Algorithm 1.

use super::query::{CandidateStreams, PathQuery, SECOND_ROUND};
use super::set::{CandidateSet, Outcome, SampledPaths};
use super::settings::{CandidateSettings, Refinement};
use crate::in_order::map_in_order;
use crate::path::curves::{BezierCurve, ScrewMotion};
use crate::path::joint_path::JointPath;
use crate::path::planners::{PlannerSettings, plan_with, shortcut};
use crate::path::rejection::Rejection;
use crate::path::source::Source;
use crate::rng::{Stream, normal};
use crate::robot::JointConfig;
use crate::scene::{ArmSpheres, MotionChecker};
use glamx::Vec3;

/// The candidate paths for `query` without a policy (lines 8, 9 and 11 of Algorithm 1),
/// deterministic for its streams and the same for any number of threads.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::path::{CandidateSettings, CandidateStreams, PathQuery, Source, candidates};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{Primitive, Scene};
///
/// let start = XARM7.grip(&XARM7.start);
/// let goal = Pose3::from_parts(start.translation + Vec3::new(0.0, 0.3, 0.0), start.rotation);
/// let post = Primitive::Sphere { center: start.translation + Vec3::new(0.0, 0.15, 0.0), radius: 0.02 };
/// let scene = Scene::from_primitives(vec![post]);
/// let query = PathQuery { robot: &XARM7, start: XARM7.start, goal, scene: &scene };
/// let set = candidates(&query, &CandidateSettings::EXAMPLE, CandidateStreams { seed: 0, step: 0 });
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
    let paths = PathSampler::new(query, settings, streams);
    paths.join(paths.planner_paths(), paths.bezier_paths(), None)
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

/// The path generators of Algorithm 1 for one query.
#[derive(Debug)]
pub struct PathSampler<'a> {
    query: &'a PathQuery<'a>,
    settings: &'a CandidateSettings,
    streams: CandidateStreams,
    arm: ArmSpheres,
    /// Goal configurations, which planner and curves share.
    goals: Vec<JointConfig>,
}

impl<'a> PathSampler<'a> {
    /// The generators of `query`: draws the goal configurations.
    #[must_use]
    pub fn new(
        query: &'a PathQuery<'a>,
        settings: &'a CandidateSettings,
        streams: CandidateStreams,
    ) -> Self {
        let goals = goal_configs(query, settings, streams);
        Self { query, settings, streams, arm: ArmSpheres::new(query.robot), goals }
    }

    /// Line 8: [`CandidateSettings::planner_paths`] paths of the planner.
    #[must_use]
    pub fn planner_paths(&self) -> SampledPaths {
        SampledPaths { source: Source::Planner, outcomes: self.planned(&self.goals) }
    }

    /// Line 9: [`CandidateSettings::bezier_paths`] Bézier paths.
    #[must_use]
    pub fn bezier_paths(&self) -> SampledPaths {
        SampledPaths { source: Source::Bezier, outcomes: self.curved(&self.goals) }
    }

    /// Curves around those candidates of `set`, in turns; none where they are not asked for.
    #[must_use]
    pub fn curves_around(&self, set: &CandidateSet, best: &[usize]) -> SampledPaths {
        let refinement = self.settings.refinement.filter(|_| !best.is_empty());
        let start = self.query.robot.grip(&self.query.start);
        let curve = |path_idx: usize, Refinement { sigma, .. }: Refinement| {
            let middle = self.middle(&set.candidates[best[path_idx % best.len()]].path);
            self.first_success(|draw| {
                let number = SECOND_ROUND + path_idx * self.settings.draws_per_path + draw;
                let rng = &mut self.streams.rng(Stream::Bezier, number);
                let offset = Vec3::from_array([0; 3].map(|_| sigma * normal(rng)));
                let curve = BezierCurve::new(&start, middle + offset, &self.query.goal);
                let path = curve.to_joints(self.query.robot, &self.query.start)?;
                Ok(path.resample(self.settings.path_len))
            })
        };
        let outcomes = refinement.map_or_else(Vec::new, |refinement| {
            map_in_order(refinement.paths, |path_idx| curve(path_idx, refinement))
        });
        SampledPaths { source: Source::Bezier, outcomes }
    }

    /// Middle control point of the quadratic curve through the ends and the middle of `path`.
    fn middle(&self, path: &JointPath) -> Vec3 {
        let grip = |idx: usize| self.query.robot.grip(&path.configs()[idx]).translation;
        let last = path.configs().len() - 1;
        // B(1/2) = (P_0 + 2 P_1 + P_2) / 4.
        let half_way = 0.5 * (grip(last / 2) + grip(last.div_ceil(2)));
        2.0 * half_way - 0.5 * (grip(0) + grip(last))
    }

    /// Line 11: the candidates of all generators, with line 10's "if valid" for the path that the
    /// policy proposed.
    #[must_use]
    pub fn join(
        &self,
        planned: SampledPaths,
        curved: SampledPaths,
        proposed: Option<Result<JointPath, Rejection>>,
    ) -> CandidateSet {
        let mut set = CandidateSet::default();
        set.add(planned);
        set.add(curved);
        set.add(SampledPaths { source: Source::Screw, outcomes: self.screws(&self.goals) });
        if let Some(proposal) = proposed {
            let valid =
                proposal.and_then(|proposal| self.valid_policy_path(&proposal, set.mean_length()));
            let outcomes = vec![valid.unwrap_or_else(Outcome::from)];
            set.add(SampledPaths { source: Source::Policy, outcomes });
        }
        set
    }

    /// Planner paths (`M`): those with checks on go to the free goals from the first, those with
    /// checks off to the goals from the last, in turns.
    fn planned(&self, goals: &[JointConfig]) -> Vec<Outcome> {
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
    fn curved(&self, goals: &[JointConfig]) -> Vec<Outcome> {
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
    fn screws(&self, goals: &[JointConfig]) -> Vec<Outcome> {
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
    fn valid_policy_path(
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
        // Resampling rounds; what runs has to begin at the arm and end at `g`, exactly.
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
        MotionChecker::new(self.query.scene, &self.arm, self.settings.rrt.checks_per_radian)
    }
}
