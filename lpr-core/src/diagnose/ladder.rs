//! The ladder: whole episodes in the same scenes with ever less taken from the demonstrator. Where
//! success falls from one rung to the next is where it is lost.

use super::reference::{Reference, about_axis};
use crate::agent::{Action, Agent, Draws, Eyes, Goal};
use crate::env::{EPISODE_LENGTH, StepResult};
use crate::error::Result;
use crate::evaluate::{best_candidate, wilson95};
use crate::in_order::map_in_order;
use crate::path::{CandidateStreams, JointPath, Source};
use crate::perception::Proprio;
use crate::q_attention::{NextBestPose, QAttention};
use crate::rng::{Stream, stream};
use crate::sim::SimEnvironment;
use crate::sim::feasibility::KeyframeSnapshot;

use rand::RngExt as _;
use serde::Serialize;

/// Source of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Poses {
    /// The demonstrator's.
    True,
    /// The demonstrator's, moved to the nearest that the action code can say.
    Quantised,
    /// The label that is learned, turned by half a turn where acting turns it: what an agent that
    /// makes no mistake does.
    QuantisedAsActing,
    /// The agent's own.
    Learned,
}

/// Choice among the paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Paths {
    /// Every candidate is executed from a snapshot, and the best is taken.
    BestOfAll,
    /// The agent's ranker.
    Ranker,
    /// Where the demonstrator moves a joint of the scene, the turn about its true axis (or the
    /// slide along it); elsewhere the ranker's path.
    Screw,
    /// The shortest that does not collide.
    ShortestFree,
    /// The policy's.
    Policy,
    /// Any.
    Random,
}

impl Poses {
    /// From the demonstrator's to the agent's.
    pub const ALL: [Self; 4] =
        [Self::True, Self::Quantised, Self::QuantisedAsActing, Self::Learned];

    /// A fixed word for files.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Paths {
    /// In the order of tables.
    pub const ALL: [Self; 6] = [
        Self::BestOfAll,
        Self::Ranker,
        Self::Screw,
        Self::ShortestFree,
        Self::Policy,
        Self::Random,
    ];

    /// A fixed word for files.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    fn is_possible(self, agent: &Agent) -> bool {
        match self {
            Self::BestOfAll | Self::ShortestFree | Self::Random => true,
            Self::Ranker | Self::Screw => agent.networks.ranker.is_some(),
            Self::Policy => agent.networks.policy.is_some(),
        }
    }
}

/// Successes with one source of poses and one choice of paths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rung {
    /// Source of the poses.
    pub poses: Poses,
    /// Choice among the paths.
    pub paths: Paths,
    /// Episodes that ran.
    pub episodes: u64,
    /// Episodes in which the task was done.
    pub successes: u64,
    /// 95 % interval of the share of successes.
    pub wilson95: [f64; 2],
}

impl Rung {
    /// Share of successes.
    #[must_use]
    pub fn success_rate(&self) -> f64 {
        self.successes as f64 / self.episodes.max(1) as f64
    }
}

/// Every rung that `agent` can climb, in the scenes of `references`; best of all, which costs the
/// most, in the first `n_best` of them.
pub(super) fn ladder(agent: &Agent, references: &[Reference], n_best: usize) -> Result<Vec<Rung>> {
    let mut rungs = Vec::new();
    for poses in Poses::ALL {
        if poses != Poses::True && agent.networks.q_attention.is_none() {
            continue;
        }
        for paths in Paths::ALL.into_iter().filter(|paths| paths.is_possible(agent)) {
            let n = if paths == Paths::BestOfAll { n_best } else { references.len() };
            let references = &references[..n.min(references.len())];
            let success = |idx: usize| {
                Ok(run(agent, &references[idx], poses, paths, |_| ())?.is_some_and(is_done))
            };
            let done = map_in_order(references.len(), success);
            let done = done.into_iter().collect::<Result<Vec<bool>>>()?;
            let (episodes, successes) =
                (done.len() as u64, done.iter().filter(|done| **done).count() as u64);
            let wilson95 = wilson95(successes, episodes);
            rungs.push(Rung { poses, paths, episodes, successes, wilson95 });
        }
    }
    Ok(rungs)
}

/// True if the task was done with that result.
pub(super) fn is_done(result: StepResult) -> bool {
    result.reward > 0.0
}

/// A step of an episode.
#[derive(Debug, Clone)]
pub(super) struct TracedStep {
    /// The world before it.
    pub(super) before: SimEnvironment,
    pub(super) action: Action,
    /// The path that ran, if there was one.
    pub(super) path: Option<JointPath>,
    pub(super) result: StepResult,
    /// The world after it.
    pub(super) after: SimEnvironment,
}

/// One episode in the scene of `reference`, and its last result; `on_step` hears of every step.
pub(super) fn run(
    agent: &Agent,
    reference: &Reference,
    poses: Poses,
    paths: Paths,
    mut on_step: impl FnMut(TracedStep),
) -> Result<Option<StepResult>> {
    let mut environment = reference.start.clone();
    let mut last = None;
    for step in 0..EPISODE_LENGTH {
        let before = environment.clone();
        let Some(goal) = goal(agent, reference, &mut environment, poses, step) else { break };
        let streams = CandidateStreams { seed: reference.scene_seed, step: step as u64 };
        let action = agent.act(goal, Draws::greedy(streams))?;
        let path = choose(reference, &environment, &action, paths, streams)?;
        let gripper = action.goal.gripper;
        let result = agent.execute_with(&mut environment, path.as_ref(), |environment, path| {
            Ok(environment.step(path, gripper))
        })?;
        on_step(TracedStep { before, action, path, result, after: environment.clone() });
        last = Some(result);
        if result.is_last() {
            break;
        }
    }
    Ok(last)
}

/// The pose of a step; none when the demonstrator has no further one.
fn goal(
    agent: &Agent,
    reference: &Reference,
    environment: &mut SimEnvironment,
    poses: Poses,
    step: usize,
) -> Option<Goal> {
    let observation = environment.observe();
    if poses == Poses::Learned {
        return Some(agent.attend(observation, Eyes::Open));
    }
    let keyframe = reference.keyframes.get(step)?;
    let pose = match &agent.networks.q_attention {
        Some(attention) => expressed(attention, poses, keyframe, &observation.proprio),
        None => keyframe.goal,
    };
    Some(Goal::given(observation, pose))
}

/// The demonstrator's pose as far as the action code can express it, for a hand as `proprio` says. A
/// pose out of its bounds stays as it is.
fn expressed(
    attention: &QAttention,
    poses: Poses,
    keyframe: &KeyframeSnapshot,
    proprio: &Proprio,
) -> NextBestPose {
    let quantised = |goal| attention.quantise(&goal).unwrap_or(goal);
    match poses {
        Poses::True | Poses::Learned => keyframe.goal,
        Poses::Quantised => quantised(keyframe.goal),
        Poses::QuantisedAsActing => {
            let label = attention.label(keyframe.goal, &keyframe.env.proprio());
            attention.acted(quantised(label), proprio)
        }
    }
}

/// The path to run; none when that choice has none.
fn choose(
    reference: &Reference,
    environment: &SimEnvironment,
    action: &Action,
    paths: Paths,
    streams: CandidateStreams,
) -> Result<Option<JointPath>> {
    let candidates = &action.set.candidates;
    let chosen = match paths {
        Paths::BestOfAll => best_candidate(environment, action)?.map(|idx| &candidates[idx]),
        Paths::Ranker => action.path(),
        Paths::Screw => match screw(reference, environment, action, streams.step as usize) {
            Some(path) => return Ok(path),
            None => action.path(),
        },
        Paths::ShortestFree => action.set.shortest_free(),
        Paths::Policy => candidates.iter().find(|candidate| candidate.source == Source::Policy),
        Paths::Random => {
            let rng = &mut stream(streams.seed, Stream::Explore, streams.step);
            (!candidates.is_empty()).then(|| &candidates[rng.random_range(0..candidates.len())])
        }
    };
    Ok(chosen.map(|candidate| candidate.path.clone()))
}

/// The motion about the demonstrated axis towards the pose, where there is an axis; no path where
/// the arm cannot follow it.
fn screw(
    reference: &Reference,
    environment: &SimEnvironment,
    action: &Action,
    step: usize,
) -> Option<Option<JointPath>> {
    let axis = reference.axis(step)?;
    let world = environment.world();
    let start = world.config();
    let motion = about_axis(&axis, world.robot().grip(start), action.goal.pose.translation);
    Some(motion.to_joints(world.robot(), start).ok())
}
