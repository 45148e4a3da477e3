//! A reason for every failure: what a trained agent gets wrong, against the demonstrator in the same
//! scenes.
//!
//! 1. [`PoseReport`]: the chosen poses at every keyframe, and which of the separate choices (voxel
//!    of each depth, each angle, the gripper) is wrong.
//! 2. [`KeyframeLabels`]: whether the demonstrations teach one answer.
//! 3. [`Rung`]: whole episodes with ever less taken from the demonstrator.
//! 4. [`Ranking`]: what the ranker knows.
//! 5. [`Failure`]: the first cause of each failed episode.
//!
//! [`Finding`]s sum it up, what costs most first.

mod failures;
mod findings;
mod labels;
mod ladder;
mod poses;
mod ranking;
mod reference;

pub use failures::{Cause, Failure};
pub use findings::Finding;
pub use labels::KeyframeLabels;
pub use ladder::{Paths, Poses, Rung};
pub use poses::{KeyframePoses, NEAR, Part, PoseError, PoseReport, Quantiles, TURNED};
pub use ranking::{Ranking, ReliabilityBin};
pub use reference::{Reference, references};

use crate::agent::Agent;
use crate::demo::DemoEpisode;
use crate::error::Result;
use crate::evaluate::wilson95;
use crate::in_order::map_in_order;
use poses::PoseCase;
use serde::Serialize;

/// How much is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiagnosisSettings {
    /// Scenes in which every candidate is executed.
    pub best_of_all_scenes: usize,
    /// Augmentations of each keyframe of a demonstration whose labels are audited.
    pub augmentations: usize,
    /// True for the ladder and the ranker's part: minutes.
    pub whole: bool,
}

impl DiagnosisSettings {
    /// Seconds: without ladder and ranker.
    pub const BRIEF: Self = Self { best_of_all_scenes: 0, augmentations: 200, whole: false };
}

/// What an agent is, and what it learned from.
#[derive(Debug)]
pub struct Subject<'a> {
    /// The agent.
    pub agent: &'a Agent,
    /// Whole chains of the demonstrations that it learned from.
    pub demonstrations: &'a [DemoEpisode],
    /// Agents of the same run at earlier environment steps, and last this one.
    pub snapshots: &'a [(u64, &'a Agent)],
    /// Seed of the run.
    pub seed: u64,
}

/// Everything that was found.
#[derive(Debug, Clone, Serialize)]
pub struct Diagnosis {
    /// Scenes that were looked at.
    pub scenes: usize,
    /// Scenes in which the agent did the task.
    pub successes: usize,
    /// 95 % interval of the share of successes.
    pub wilson95: [f64; 2],
    /// What costs most, first.
    pub findings: Vec<Finding>,
    /// Errors of the poses; empty with the demonstrator's poses.
    pub poses: PoseReport,
    /// Labels of the demonstrations; empty with the demonstrator's poses.
    pub labels: Vec<KeyframeLabels>,
    /// Success by source of the poses and choice among the paths.
    pub ladder: Vec<Rung>,
    /// The ranker at each snapshot, the agent's own last.
    pub rankings: Vec<Ranking>,
    /// The failed episodes.
    pub failures: Vec<Failure>,
}

/// Looks at an agent in the scenes of `references`.
///
/// # Errors
///
/// When the answer of a network is not a number.
pub fn diagnose(
    subject: &Subject<'_>,
    references: &[Reference],
    settings: DiagnosisSettings,
) -> Result<Diagnosis> {
    let Subject { agent, demonstrations, snapshots, seed } = *subject;
    let in_scenes = scene_cases(references);
    let poses = PoseReport {
        scenes: poses::keyframe_poses(agent, &in_scenes, false),
        guided: poses::keyframe_poses(agent, &in_scenes, true),
        demonstrations: poses::keyframe_poses(agent, &demonstration_cases(demonstrations), false),
    };
    let labels = labels::audit(agent, demonstrations, settings.augmentations, seed);
    let outcomes = map_in_order(references.len(), |idx| own_episode(agent, &references[idx]));
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>>>()?;
    let failures: Vec<_> = outcomes.into_iter().flatten().collect();
    let n_best = settings.best_of_all_scenes.min(references.len());
    let (mut rungs, mut rankings) = (Vec::new(), Vec::new());
    if settings.whole {
        rungs = ladder::ladder(agent, references, n_best)?;
        let sets = ranking::ranked_sets(agent, &references[..n_best])?;
        for (env_steps, snapshot) in snapshots {
            if let Some(ranker) = &snapshot.networks.ranker {
                rankings.push(ranking::ranking(ranker, *env_steps, &sets)?);
            }
        }
    }
    let scenes = references.len();
    let successes = scenes - failures.len();
    Ok(Diagnosis {
        scenes,
        successes,
        wilson95: wilson95(successes as u64, scenes as u64),
        findings: findings::findings(scenes, &failures, &poses, &rungs, &rankings, &labels),
        poses,
        labels,
        ladder: rungs,
        rankings,
        failures,
    })
}

/// The failure of the agent's own episode in a scene; none when it did the task.
fn own_episode(agent: &Agent, reference: &Reference) -> Result<Option<Failure>> {
    let poses = if agent.networks.q_attention.is_some() { Poses::Learned } else { Poses::True };
    let mut steps = Vec::new();
    let last = ladder::run(agent, reference, poses, Paths::Ranker, |step| steps.push(step))?;
    if last.is_some_and(ladder::is_done) {
        return Ok(None);
    }
    Ok(failures::first_cause(agent, reference, &steps))
}

/// Every keyframe of the scenes, in the state that the demonstrator leaves.
fn scene_cases(references: &[Reference]) -> Vec<PoseCase> {
    let cases = references.iter().flat_map(|reference| {
        let goals = reference.goals();
        reference.keyframes.iter().enumerate().map(move |(keyframe, snapshot)| PoseCase {
            keyframe,
            observation: snapshot.env.clone().observe(),
            goals: goals.clone(),
        })
    });
    cases.collect()
}

fn demonstration_cases(demonstrations: &[DemoEpisode]) -> Vec<PoseCase> {
    let cases = demonstrations.iter().flat_map(|demo| {
        let goals: Vec<_> = demo.steps.iter().map(|step| step.goal).collect();
        demo.steps.iter().enumerate().map(move |(keyframe, step)| PoseCase {
            keyframe,
            observation: step.observation.clone(),
            goals: goals.clone(),
        })
    });
    cases.collect()
}
