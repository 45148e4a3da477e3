//! The agent: from an observation to the path that runs (Algorithm 1, lines 6–12), and the run of
//! that path (line 13).
//!
//! [`Agent::decide`] is lines 6–12: [`Agent::goal`] looks and chooses the next-best pose (lines 6
//! and 7), [`Agent::act`] proposes paths to it and ranks them (lines 8–12). Trainer, evaluation,
//! page and arm all act through these.
//!
//! The agent sees an [`Observation`] and nothing else, but without Q-attention
//! ([`PoseSource::Oracle`]): then it asks the environment for the demonstrator's pose, and `act`
//! cannot tell the difference.
//!
//! # Differences from the paper
//!
//! - The policy's path is tested for its length in evaluation as in training; the paper speaks of
//!   training alone.
//! - The observation has the time in the episode, and Q-attention sees the cloud thinned to
//!   [`AgentSettings::cloud_spacing`].
//! - Poses may come from the demonstrator, so that paths are learned alone, and they may be chosen by
//!   the target weights of Q-attention ([`ActingNetwork`]), as in the released code.
//! - The policy is asked for a path to the goal configuration nearest to the start, since a pose
//!   has many.

mod decision;
mod exploration;

pub use crate::method::{Method, PoseSource};
pub use crate::networks::{Init, Networks, NetworksSettings};
pub use decision::{Action, Draws, Eyes, Goal};
pub use exploration::Exploration;

use crate::env::{Environment, InvalidAction, StepResult};
use crate::error::{Error, Result};
use crate::path::{
    CandidatePath, CandidateSet, CandidateSettings, JointPath, PathQuery, PathSampler,
    RejectedPath, Rejection, Source, c2farm_path, linear_candidate,
};
use crate::perception::{Observation, Proprio};
use crate::policy::Proposal;
use crate::q_attention::{ActingNetwork, NextBestPose, QAttention, QObservation};
use crate::ranker::{RankedPath, RankerContext, means};
use crate::rng::{Stream, stream};
use crate::robot::Robot;
use crate::scene::{ArmSpheres, Held, MotionChecker, Scene, observed_obstacles};
use exploration::uniform;
use std::sync::Arc;

/// The agent of Algorithm 1: networks, and the settings of everything around them.
#[derive(Debug)]
pub struct Agent {
    robot: Arc<Robot>,
    method: Method,
    settings: AgentSettings,
    /// The networks; the learner changes them.
    pub networks: Networks,
}

/// Settings of acting, beside those of the networks.
#[derive(Debug, Clone, PartialEq)]
pub struct AgentSettings {
    /// The candidate paths.
    pub candidates: CandidateSettings,
    /// Distance of the points of a cloud that Q-attention and its replay see, metres.
    pub cloud_spacing: f32,
    /// Weights of Q-attention that choose poses.
    pub acting_weights: ActingNetwork,
    /// Discount of later rewards: `γ` of the ranker.
    pub discount: f32,
}

impl Agent {
    /// An agent with those networks.
    #[must_use]
    pub fn new(
        settings: AgentSettings,
        robot: &Arc<Robot>,
        method: Method,
        networks: Networks,
    ) -> Self {
        Self { robot: Arc::clone(robot), method, settings, networks }
    }

    /// Algorithm 1, lines 6–12: one decision in `environment`.
    ///
    /// # Errors
    ///
    /// As [`Self::goal`] and [`Self::act`].
    pub fn decide(
        &self,
        environment: &mut impl Environment,
        eyes: Eyes<'_>,
        draws: Draws,
    ) -> Result<Action> {
        // Lines 6 and 7: look, and choose the next-best pose.
        let goal = self.goal(environment, eyes)?;
        // Lines 8–12: propose paths to it, and choose one.
        self.act(goal, draws)
    }

    /// Lines 6 and 7: the observation, and the next-best pose in it.
    ///
    /// # Errors
    ///
    /// When the environment cannot be observed; without Q-attention, when its demonstrator has no
    /// further pose.
    pub fn goal(&self, environment: &mut impl Environment, eyes: Eyes<'_>) -> Result<Goal> {
        // Line 6: o_t ← (b_t, p_t, z_t).
        let observation = environment.observe()?;
        // Line 7: g_t ← Q_θ(o_t).
        match &self.networks.q_attention {
            Some(_) => Ok(self.attend(observation, eyes)),
            None => environment
                .demonstrated_goal()
                .map(|pose| Goal::given(observation, pose))
                .ok_or_else(no_demonstrated_pose),
        }
    }

    /// Lines 8–12: from the next-best pose to the path that runs.
    ///
    /// # Errors
    ///
    /// When the policy's path or a value of the ranker is not finite.
    pub fn act(&self, goal: Goal, draws: Draws) -> Result<Action> {
        let Goal { pose, observation: Observation { proprio, .. }, .. } = &goal;
        let scene = self.obstacles(&goal.observation, pose);
        let query =
            PathQuery { robot: &self.robot, start: proprio.joints, goal: pose.pose, scene: &scene };
        let mut sampler = None;
        let mut set = match self.method {
            // At most one candidate.
            Method::C2fArm => single(
                Source::Planner,
                c2farm_path(&query, self.candidate_settings(), draws.streams),
            ),
            Method::Linear => {
                single(Source::Linear, linear_candidate(&query, self.candidate_settings()))
            }
            Method::Lpr | Method::LprNoPolicy | Method::ShortestFree | Method::Random => {
                let paths = sampler.insert(PathSampler::new(
                    &query,
                    self.candidate_settings(),
                    draws.streams,
                ));
                // Line 8: [ξ^m_1, …, ξ^m_M] ← f_m(z_t, g_t, M).
                let planned = paths.planner_paths();
                // Line 9: [ξ^b_1, …, ξ^b_B] ← f_b(z_t, g_t, B).
                let curved = paths.bezier_paths();
                // Line 10: ξ^π ← π(o_t, g_t); the next line adds it if it is valid.
                let proposed = self.policy_path(proprio, pose)?;
                // Line 11: Ξ ← [ξ^m_1, …, ξ^m_M, ξ^b_1, …, ξ^b_B, ξ^π].
                paths.join(planned, curved, proposed)
            }
        };
        // Line 12: ξ* ← argmax Q^R(Ξ).
        let mut by_critic = self.values(&set.candidates, proprio, *pose)?;
        if let (Some(by_critic), Some(sampler)) = (&mut by_critic, &sampler) {
            self.refine(sampler, &mut set, by_critic, &goal)?;
        }
        let chosen = self.choose(&set, by_critic.as_deref(), draws);
        Ok(Action::new(goal, set, by_critic.as_deref().map(means), chosen))
    }

    /// Line 13: runs the chosen path in `environment`.
    ///
    /// The episode ends when there is no path. With the demonstrator's poses it also ends after the
    /// last of them.
    ///
    /// # Errors
    ///
    /// When the environment fails.
    pub fn execute<E: Environment>(
        &self,
        environment: &mut E,
        action: &Action,
    ) -> Result<StepResult> {
        let path = action.path().map(|candidate| &candidate.path);
        self.execute_with(environment, path, |environment, path| {
            environment.step(path, action.goal.gripper)
        })
    }

    /// [`Self::execute`] with `path`, for callers that run it in a way of their own: the page
    /// records every frame.
    ///
    /// # Errors
    ///
    /// As `run`.
    pub fn execute_with<E: Environment>(
        &self,
        environment: &mut E,
        path: Option<&JointPath>,
        run: impl FnOnce(&mut E, &JointPath) -> Result<StepResult>,
    ) -> Result<StepResult> {
        let Some(path) = path else { return Ok(StepResult::refused(InvalidAction::NoPath)) };
        let result = run(environment, path)?;
        let ends = !result.is_last() && self.is_out_of_poses(environment);
        Ok(StepResult { terminated: result.terminated || ends, ..result })
    }

    /// True if the agent needs poses of the demonstrator, who has none left.
    #[must_use]
    pub fn is_out_of_poses(&self, environment: &impl Environment) -> bool {
        self.poses() == PoseSource::Oracle && environment.demonstrated_goal().is_none()
    }

    /// Line 7 with Q-attention. The start and the obstacles of the paths come from `observation`,
    /// also when `eyes` show other images to Q-attention.
    ///
    /// # Panics
    ///
    /// With the demonstrator's poses: there is no Q-attention.
    #[must_use]
    pub fn attend(&self, observation: Observation, eyes: Eyes<'_>) -> Goal {
        let attention = self.networks.q_attention.as_ref().expect("poses are learned");
        let seen = match eyes {
            Eyes::Open => self.observed(attention, &observation),
            Eyes::Shown(views) => {
                let views = views.to_vec();
                let shown = Observation { views, proprio: observation.proprio };
                self.observed(attention, &shown)
            }
        };
        let decision = attention.act(&seen, self.settings.acting_weights);
        Goal { pose: decision.goal, attention: Some(decision), seen: Some(seen), observation }
    }

    /// The part of an observation that Q-attention and its replay see; none with the
    /// demonstrator's poses.
    #[must_use]
    pub fn attended(&self, observation: &Observation) -> Option<QObservation> {
        let attention = self.networks.q_attention.as_ref()?;
        Some(self.observed(attention, observation))
    }

    fn observed(&self, attention: &QAttention, observation: &Observation) -> QObservation {
        let bounds = attention.codec().scene().bounds();
        QObservation::new(observation, *bounds, self.settings.cloud_spacing)
    }

    /// Obstacles that the cameras see, without the arm and what it holds. Points near the grip at
    /// the start or at `goal` do not block the hand.
    #[must_use]
    pub fn obstacles(&self, observation: &Observation, goal: &NextBestPose) -> Scene {
        let holding = if observation.proprio.holds() { Held::Object } else { Held::Nothing };
        observed_obstacles(&self.robot, observation, Some(&goal.pose), holding)
    }

    /// A demonstrated path in the form that the ranker reads.
    #[must_use]
    pub fn ranked(&self, path: &JointPath, scene: &Scene) -> RankedPath {
        let settings = self.candidate_settings();
        let path = path.resample(settings.path_len);
        let arm = ArmSpheres::new(&self.robot);
        let checker = MotionChecker::new(scene, &arm, settings.rrt.checks_per_radian);
        let collides = !checker.path_is_free(path.configs());
        RankedPath { path, collides }
    }

    /// Line 10: the policy's path to the goal configuration nearest to the start.
    fn policy_path(&self, proprio: &Proprio, goal: &NextBestPose) -> Result<Option<Proposal>> {
        let Some(policy) = &self.networks.policy else { return Ok(None) };
        let start = &proprio.joints;
        let Some(goal_config) = self.robot.ik_nearest(&goal.pose, start) else { return Ok(None) };
        policy.path(start, &goal_config, goal, self.candidate_settings().path_len).map(Some)
    }

    /// Adds curves around the best of `set`, with their values, where they are asked for: a second
    /// round of the cross-entropy method.
    fn refine(
        &self,
        paths: &PathSampler<'_>,
        set: &mut CandidateSet,
        by_critic: &mut [Vec<f32>],
        goal: &Goal,
    ) -> Result<()> {
        let Some(refinement) = self.candidate_settings().refinement else { return Ok(()) };
        let values = means(by_critic);
        let mut order: Vec<_> = (0..values.len()).collect();
        order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        order.truncate(refinement.best);
        set.add(paths.curves_around(set, &order));
        let added = &set.candidates[values.len()..];
        let added = self.values(added, &goal.observation.proprio, goal.pose)?;
        for (values, added) in by_critic.iter_mut().zip(added.into_iter().flatten()) {
            values.extend(added);
        }
        Ok(())
    }

    /// Line 12: value of every candidate by each critic; none without a ranker.
    fn values(
        &self,
        candidates: &[CandidatePath],
        proprio: &Proprio,
        goal: NextBestPose,
    ) -> Result<Option<Vec<Vec<f32>>>> {
        let Some(ranker) = &self.networks.ranker else { return Ok(None) };
        let paths = candidates.iter().map(|candidate| RankedPath {
            path: candidate.path.clone(),
            collides: candidate.collides,
        });
        let values =
            ranker.values_by_critic(&context(proprio, goal), &paths.collect::<Vec<_>>())?;
        match values.iter().flatten().find(|value| !value.is_finite()) {
            Some(value) => {
                Err(Error::NotFinite { network: "ranker", found: format!("value {value}") })
            }
            None => Ok(Some(values)),
        }
    }

    /// Line 12: index of the candidate to run; none when there is no candidate.
    fn choose(
        &self,
        set: &CandidateSet,
        by_critic: Option<&[Vec<f32>]>,
        draws: Draws,
    ) -> Option<usize> {
        let rng = &mut stream(draws.streams.seed, Stream::Explore, draws.streams.step);
        match (self.method, by_critic) {
            (Method::Random, _) => uniform(set.candidates.len(), rng),
            (Method::ShortestFree, _) => {
                let best = set.shortest_free();
                best.and_then(|best| {
                    set.candidates.iter().position(|candidate| core::ptr::eq(candidate, best))
                })
            }
            (_, Some(by_critic)) => draws.exploration.choose(by_critic, rng),
            // C2F-ARM and the straight line: at most one candidate.
            (_, None) => (!set.candidates.is_empty()).then_some(0),
        }
    }
}

impl Agent {
    /// Its way of choosing.
    #[must_use]
    pub const fn method(&self) -> Method {
        self.method
    }

    /// Source of its next-best poses.
    #[must_use]
    pub const fn poses(&self) -> PoseSource {
        self.networks.poses()
    }

    /// The arm that it moves.
    #[must_use]
    pub const fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Settings of its candidate paths.
    #[must_use]
    pub const fn candidate_settings(&self) -> &CandidateSettings {
        &self.settings.candidates
    }

    /// Weights of Q-attention that choose its poses.
    #[must_use]
    pub const fn acting_weights(&self) -> ActingNetwork {
        self.settings.acting_weights
    }

    /// Discount of later rewards: `γ` of the ranker.
    #[must_use]
    pub(crate) const fn discount(&self) -> f32 {
        self.settings.discount
    }
}

/// The situation of paths to `goal`.
pub(crate) fn context(proprio: &Proprio, goal: NextBestPose) -> RankerContext {
    RankerContext { goal, gripper_open: proprio.gripper_open, time: proprio.time }
}

/// The set of a method with one candidate.
fn single(source: Source, path: Result<CandidatePath, Rejection>) -> CandidateSet {
    let mut set = CandidateSet::default();
    match path {
        Ok(candidate) => set.candidates.push(candidate),
        Err(reason) => set.rejected.push(RejectedPath { source, reason }),
    }
    set
}

fn no_demonstrated_pose() -> Error {
    Error::Environment("demonstrated pose: expected one more, found none".to_owned())
}
