//! The agent: from an observation to the path that runs (Algorithm 1, lines 6–12).
//!
//! It sees an [`Observation`] and nothing else. With the demonstrator's poses instead of
//! Q-attention, the next-best pose is an argument like any other.
//!
//! # Differences from the paper
//!
//! - The policy's path is tested for its length in evaluation as in training; the paper speaks of
//!   training alone.
//! - The policy is asked for a path to the goal configuration nearest to the start, since a pose
//!   has many.

mod method;

pub use method::Method;

use crate::config::Config;
use crate::error::Result;
use crate::nn::Backend;
use crate::path::{
    CandidatePath, CandidateSet, CandidateSettings, CandidateStreams, JointPath, PathQuery,
    RejectedPath, Source, c2farm_path, candidates, linear_candidate,
};
use crate::perception::{Observation, Proprio, VoxelBounds};
use crate::policy::Policy;
use crate::q_attention::{NetworkCost, NextBestPose, QAttention, QDecision, QObservation, Weights};
use crate::ranker::{RankedPath, Ranker, RankerContext};
use crate::replay;
use crate::rng::{Rng, Stream, stream};
use crate::robot::Robot;
use crate::scene::{ArmSpheres, Holding, MotionChecker, ObstacleQuery, Scene, obstacle_scene};
use crate::train::TrainSettings;
use std::sync::Arc;

use glamx::Vec3;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// Opening of a closed gripper above which it holds something, metres: closed on nothing, the pads
/// meet.
const HELD_WIDTH: f32 = 0.002;

/// How a training step departs from the candidate of highest value.
///
/// The paper has no exploration but the randomness of its candidates. On the toy (16 candidates, 3
/// seeds, 30 scenes each), success after 150 steps is 0.94 greedily, 0.99 with ε from 0.2 and 1.00
/// with softmax at 0.1 (`examples/path_study.rs`): a greedy agent settles before it has tried
/// everything.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Exploration {
    /// Never: Algorithm 1 as it stands.
    Greedy,
    /// With a probability that falls linearly, a candidate drawn uniformly.
    Epsilon {
        /// Probability at the first environment step.
        first: f32,
        /// Probability from `steps` on.
        last: f32,
        /// Environment steps over which it falls.
        steps: u64,
    },
    /// A candidate drawn with probability in proportion to `exp(value / temperature)`.
    Softmax {
        /// Difference of values that makes a factor of e.
        temperature: f32,
    },
}

/// Where next-best poses come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// Coarse-to-fine Q-attention, as in the paper.
    Learned,
    /// The demonstrator (`--oracle-poses`): paths are learned alone, and Q-attention is not built.
    Oracle,
}

/// The networks of an agent; those that its method does not use are not built.
#[derive(Debug)]
pub struct Networks {
    /// Next-best poses: `Q_θ` in the paper.
    pub q_attention: Option<QAttention>,
    /// Values of paths: `Q^R_σ` in the paper.
    pub ranker: Option<Ranker>,
    /// One more path: `π_μ` in the paper.
    pub policy: Option<Policy>,
}

/// What chooses paths.
#[derive(Debug)]
pub struct Agent {
    robot: Arc<Robot>,
    method: Method,
    candidates: CandidateSettings,
    cloud_spacing: f32,
    acting_weights: Weights,
    discount: f32,
    /// The networks; the learner changes them.
    pub networks: Networks,
}

/// What the agent came to in one step, with everything that led there.
#[derive(Debug, Clone)]
pub struct Action {
    /// Where the paths lead and what the gripper does there: `g` in the paper.
    pub goal: NextBestPose,
    /// How Q-attention came to the goal; none with the demonstrator's poses.
    pub attention: Option<QDecision>,
    /// The situation in which the paths were ranked.
    pub context: RankerContext,
    /// The candidates (`Ξ` in the paper) and what was rejected.
    pub set: CandidateSet,
    /// Value of every candidate; none without a ranker.
    pub values: Option<Vec<f32>>,
    /// Index of the candidate to run; none when there is no candidate.
    pub chosen: Option<usize>,
}

/// A next-best pose and how it came about.
#[derive(Debug, Clone)]
pub struct Goal {
    /// The pose.
    pub pose: NextBestPose,
    /// The values behind it; none with the demonstrator's poses.
    pub attention: Option<QDecision>,
}

impl From<NextBestPose> for Goal {
    fn from(pose: NextBestPose) -> Self {
        Self { pose, attention: None }
    }
}

/// Which draws a decision takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draws {
    /// Generators of the candidates.
    pub streams: CandidateStreams,
    /// How the choice departs from the highest value.
    pub exploration: Exploration,
}

impl Draws {
    /// The draws of a decision without exploration.
    #[must_use]
    pub const fn greedy(streams: CandidateStreams) -> Self {
        Self { streams, exploration: Exploration::Greedy }
    }
}

impl Networks {
    /// Fresh networks for `method`, each from its own generator (lines 1 and 2 of Algorithm 1).
    ///
    /// # Errors
    ///
    /// When settings cannot work.
    pub fn new(
        config: &Config,
        robot: &Arc<Robot>,
        method: Method,
        poses: PoseSource,
        init: Init,
    ) -> Result<Self> {
        let rng = |network| stream(init.seed, Stream::Init, network);
        let q_attention = (poses == PoseSource::Learned).then(|| {
            QAttention::new(
                config.q_attention.clone(),
                VoxelBounds::scene(robot),
                init.backend,
                &mut rng(0),
            )
        });
        let policy = method
            .has_policy()
            .then(|| Policy::new(&config.policy, robot, init.backend, &mut rng(1)));
        let ranker = method
            .has_ranker()
            .then(|| Ranker::new(&config.ranker, robot, init.backend, &mut rng(2)));
        Ok(Self {
            q_attention: q_attention.transpose()?,
            ranker: ranker.transpose()?,
            policy: policy.transpose()?,
        })
    }
}

/// What fresh networks are made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Init {
    /// What computes them.
    pub backend: Backend,
    /// Seed of the run.
    pub seed: u64,
}

impl Agent {
    /// An agent with those networks.
    #[must_use]
    pub fn new(config: &Config, robot: &Arc<Robot>, method: Method, networks: Networks) -> Self {
        let TrainSettings { cloud_spacing, acting_weights, .. } = config.training;
        let (candidates, discount) = (config.candidates.clone(), config.ranker.discount);
        Self {
            robot: Arc::clone(robot),
            method,
            candidates,
            cloud_spacing,
            acting_weights,
            discount,
            networks,
        }
    }

    /// What a later reward counts for: `γ` of the ranker.
    #[must_use]
    pub(crate) const fn discount(&self) -> f32 {
        self.discount
    }

    /// Every network's name, parameters, and operations of one forward pass of one sample: a scene,
    /// or a path.
    #[must_use]
    pub fn costs(&self) -> Vec<(String, NetworkCost)> {
        let path_len = self.candidates.path_len;
        let depths = self.networks.q_attention.iter().flat_map(QAttention::costs).enumerate();
        let depths = depths.map(|(depth, cost)| (format!("q_attention depth {depth}"), cost));
        let ranker =
            self.networks.ranker.iter().map(|ranker| ("ranker".to_owned(), ranker.cost(path_len)));
        let policy =
            self.networks.policy.iter().map(|policy| ("policy".to_owned(), policy.cost(path_len)));
        depths.chain(ranker).chain(policy).collect()
    }

    /// How it chooses.
    #[must_use]
    pub const fn method(&self) -> Method {
        self.method
    }

    /// Where its next-best poses come from.
    #[must_use]
    pub const fn poses(&self) -> PoseSource {
        if self.networks.q_attention.is_some() { PoseSource::Learned } else { PoseSource::Oracle }
    }

    /// The arm that it moves.
    #[must_use]
    pub const fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// What Q-attention and its replay see of an observation; none with the demonstrator's poses.
    #[must_use]
    pub fn attended(&self, observation: &Observation) -> Option<QObservation> {
        self.networks.q_attention.is_some().then(|| {
            QObservation::new(observation, VoxelBounds::scene(&self.robot), self.cloud_spacing)
        })
    }

    /// The next-best pose (line 7); none with the demonstrator's poses.
    #[must_use]
    pub fn goal(&self, observation: &QObservation) -> Option<Goal> {
        let decision = self.networks.q_attention.as_ref()?.act(observation, self.acting_weights);
        Some(Goal { pose: decision.goal, attention: Some(decision) })
    }

    /// From the next-best pose to the path that runs (lines 8–12).
    ///
    /// # Errors
    ///
    /// When a network answers with something that is not a number.
    pub fn act(&self, observation: &Observation, goal: Goal, draws: Draws) -> Result<Action> {
        let Goal { pose: goal, attention } = goal;
        let scene = self.obstacles(observation, &goal);
        let set = self.candidates(&observation.proprio, &goal, &scene, draws.streams)?;
        let context = context(&observation.proprio, goal);
        let values = self
            .networks
            .ranker
            .as_ref()
            .map(|ranker| ranker.values(&context, &ranked_paths(&set)))
            .transpose()?;
        let rng = &mut stream(draws.streams.seed, Stream::Explore, draws.streams.step);
        let chosen = match self.method {
            // Lines 8–10 without the ranking of line 12: any of the candidates, or the shortest
            // that is free.
            Method::Random => uniform(set.candidates.len(), rng),
            Method::ShortestFree => {
                let best = set.shortest_free();
                best.and_then(|best| {
                    set.candidates.iter().position(|candidate| core::ptr::eq(candidate, best))
                })
            }
            // Line 12.
            _ => values.as_ref().map_or((!set.candidates.is_empty()).then_some(0), |values| {
                draws.exploration.choose(values, rng)
            }),
        };
        Ok(Action { goal, attention, context, set, values, chosen })
    }

    /// What the arm must not hit on its way to `goal`, as far as the cameras see.
    #[must_use]
    pub fn obstacles(&self, observation: &Observation, goal: &NextBestPose) -> Scene {
        let proprio = &observation.proprio;
        let query = ObstacleQuery {
            robot: &self.robot,
            measured: &proprio.joints,
            goal: Some(&goal.pose),
            holding: if is_holding(proprio) { Holding::Object } else { Holding::Nothing },
        };
        let points: Vec<Vec3> = observation.colored_points().map(|(point, _)| point).collect();
        obstacle_scene(&query, &points)
    }

    /// A path that was not drawn here, a demonstrated one, as the ranker sees it.
    #[must_use]
    pub fn ranked(&self, path: &JointPath, scene: &Scene) -> RankedPath {
        let path = path.resample(self.candidates.path_len);
        let arm = ArmSpheres::new(&self.robot);
        let checker = MotionChecker::new(scene, &arm, self.candidates.rrt.checks_per_radian);
        let collides = !checker.path_is_free(path.configs());
        RankedPath { path, collides }
    }

    /// Numbers of the agent's candidates.
    #[must_use]
    pub const fn candidate_settings(&self) -> &CandidateSettings {
        &self.candidates
    }

    /// The candidates of the agent's method (lines 8–11).
    fn candidates(
        &self,
        proprio: &Proprio,
        goal: &NextBestPose,
        scene: &Scene,
        streams: CandidateStreams,
    ) -> Result<CandidateSet> {
        let (robot, start) = (&self.robot, proprio.joints);
        // Line 10: π(o, g); whether it is valid is tested with the other paths at hand.
        let policy_path = self.policy_path(proprio, goal)?;
        let query =
            PathQuery { robot, start, goal: goal.pose, scene, policy_path: policy_path.as_ref() };
        Ok(match self.method {
            Method::C2fArm => {
                single(c2farm_path(&query, &self.candidates, streams), Source::Planner)
            }
            Method::Linear => single(linear_candidate(&query, &self.candidates), Source::Linear),
            // Lines 8, 9 and 11.
            Method::Lpr | Method::LprNoPolicy | Method::ShortestFree | Method::Random => {
                candidates(&query, &self.candidates, streams)
            }
        })
    }

    fn policy_path(&self, proprio: &Proprio, goal: &NextBestPose) -> Result<Option<JointPath>> {
        let Some(policy) = &self.networks.policy else { return Ok(None) };
        let Some(goal_config) = self.robot.ik_nearest(&goal.pose, &proprio.joints) else {
            return Ok(None);
        };
        policy.path(&proprio.joints, &goal_config, goal, self.candidates.path_len).map(Some)
    }
}

impl Action {
    /// The candidate to run.
    #[must_use]
    pub fn path(&self) -> Option<&CandidatePath> {
        self.set.candidates.get(self.chosen?)
    }

    /// Value of the candidate to run.
    #[must_use]
    pub fn chosen_value(&self) -> Option<f32> {
        self.values.as_ref()?.get(self.chosen?).copied()
    }

    /// Number of candidates from `source`.
    #[must_use]
    pub fn n_from(&self, source: Source) -> usize {
        self.set.candidates.iter().filter(|candidate| candidate.source == source).count()
    }

    /// What the replay keeps of it; none when there was no candidate.
    #[must_use]
    pub fn decision(&self) -> Option<replay::Decision> {
        let CandidatePath { source, path, collides } = self.path()?.clone();
        Some(replay::Decision {
            context: self.context,
            taken: RankedPath { path, collides },
            source: Some(source),
        })
    }
}

impl Exploration {
    /// Whether its numbers are in their ranges.
    pub(crate) fn is_valid(self) -> bool {
        match self {
            Self::Greedy => true,
            Self::Epsilon { first, last, .. } => {
                [first, last].iter().all(|p| (0.0..=1.0).contains(p))
            }
            Self::Softmax { temperature } => temperature > 0.0,
        }
    }

    /// The same at environment step `step` of the run: a probability that does not change any more.
    #[must_use]
    pub fn at(self, step: u64) -> Self {
        let Self::Epsilon { first, last, steps } = self else { return self };
        let fraction = if step >= steps { 1.0 } else { step as f32 / steps as f32 };
        let now = first + (last - first) * fraction;
        Self::Epsilon { first: now, last: now, steps: 0 }
    }

    /// Index of the path to run; the first of those with the highest value when greedy.
    fn choose(self, values: &[f32], rng: &mut Rng) -> Option<usize> {
        match self {
            Self::Epsilon { last, .. } if rng.random::<f32>() < last => uniform(values.len(), rng),
            Self::Greedy | Self::Epsilon { .. } => argmax(values),
            Self::Softmax { temperature } => {
                let best = values[argmax(values)?];
                let weights: Vec<f32> =
                    values.iter().map(|value| libm::expf((value - best) / temperature)).collect();
                let mut left = rng.random::<f32>() * weights.iter().sum::<f32>();
                let passed = weights.iter().take_while(|&&weight| {
                    left -= weight;
                    left > 0.0
                });
                Some(passed.count().min(values.len() - 1))
            }
        }
    }
}

/// Index of the first of the highest values.
fn argmax(values: &[f32]) -> Option<usize> {
    // `max_by` gives the last of equals.
    (0..values.len()).rev().max_by(|&a, &b| values[a].total_cmp(&values[b]))
}

fn uniform(n: usize, rng: &mut Rng) -> Option<usize> {
    (n > 0).then(|| rng.random_range(0..n))
}

/// The situation of paths to `goal`.
pub(crate) fn context(proprio: &Proprio, goal: NextBestPose) -> RankerContext {
    RankerContext { goal, gripper_open: proprio.gripper_open, time: proprio.time }
}

/// Whether the gripper closed on something.
fn is_holding(proprio: &Proprio) -> bool {
    proprio.gripper_open < 0.5 && proprio.gripper_width > HELD_WIDTH
}

fn ranked_paths(set: &CandidateSet) -> Vec<RankedPath> {
    let paths = set.candidates.iter();
    paths
        .map(|candidate| RankedPath { path: candidate.path.clone(), collides: candidate.collides })
        .collect()
}

/// The set of a method with one candidate.
fn single(path: Result<CandidatePath, crate::path::Rejection>, source: Source) -> CandidateSet {
    match path {
        Ok(candidate) => CandidateSet { candidates: vec![candidate], rejected: Vec::new() },
        Err(reason) => {
            CandidateSet { candidates: Vec::new(), rejected: vec![RejectedPath { source, reason }] }
        }
    }
}
