//! A decision of the agent and everything that led to it.

use super::{Exploration, context};
use crate::path::{CandidatePath, CandidateSet, CandidateStreams, Source};
use crate::perception::{Observation, Proprio, View};
use crate::q_attention::{NextBestPose, QDecision, QObservation};
use crate::ranker::{RankedPath, RankerContext};
use crate::replay;

/// Images that Q-attention looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Eyes<'a> {
    /// The scene, as the cameras see it.
    Open,
    /// Other images: an ablation. Proprioception and obstacles stay those of the scene.
    Shown(&'a [View]),
}

/// Random streams of one decision, and its exploration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draws {
    /// Generators of the candidates.
    pub streams: CandidateStreams,
    /// How the choice may differ from the highest value.
    pub exploration: Exploration,
}

impl Draws {
    /// The draws of a decision without exploration.
    #[must_use]
    pub const fn greedy(streams: CandidateStreams) -> Self {
        Self { streams, exploration: Exploration::Greedy }
    }
}

/// A next-best pose with the observation that it was chosen in (lines 6 and 7).
#[derive(Debug, Clone)]
pub struct Goal {
    /// The pose: `g_t` in the paper.
    pub pose: NextBestPose,
    /// The values behind it; none with the demonstrator's poses.
    pub attention: Option<QDecision>,
    /// The part of the observation that Q-attention saw; none with the demonstrator's poses.
    pub seen: Option<QObservation>,
    /// The observation: `o_t` in the paper.
    pub observation: Observation,
}

impl Goal {
    /// A pose that somebody else chose: the demonstrator, or a test.
    #[must_use]
    pub const fn given(observation: Observation, pose: NextBestPose) -> Self {
        Self { pose, attention: None, seen: None, observation }
    }
}

/// One decision of the agent (lines 6–12), with everything that led there.
#[derive(Debug, Clone)]
pub struct Action {
    /// End of the paths, and the gripper's command there: `g_t` in the paper.
    pub goal: NextBestPose,
    /// Values of Q-attention behind the goal; none with the demonstrator's poses.
    pub attention: Option<QDecision>,
    /// The part of the observation that Q-attention saw; none with the demonstrator's poses.
    pub seen: Option<QObservation>,
    /// Proprioception before the action: `z_t` in the paper.
    pub proprio: Proprio,
    /// The situation in which the paths were ranked.
    pub context: RankerContext,
    /// The candidates (`Ξ` in the paper) and the rejected draws.
    pub set: CandidateSet,
    /// Value of every candidate; none without a ranker.
    pub values: Option<Vec<f32>>,
    /// Index of the candidate to run; none when there is no candidate.
    pub chosen: Option<usize>,
}

impl Action {
    pub(super) fn new(
        goal: Goal,
        set: CandidateSet,
        values: Option<Vec<f32>>,
        chosen: Option<usize>,
    ) -> Self {
        let Goal { pose, attention, seen, observation: Observation { proprio, .. } } = goal;
        let context = context(&proprio, pose);
        Self { goal: pose, attention, seen, proprio, context, set, values, chosen }
    }

    /// The candidate to run: `ξ*` in the paper.
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

    /// The part that the replay keeps; none when there was no candidate.
    #[must_use]
    pub fn decision(&self) -> Option<replay::Decision> {
        let CandidatePath { source, path, collides } = self.path()?.clone();
        let taken = RankedPath { path, collides };
        Some(replay::Decision {
            context: self.context,
            taken,
            source: Some(source),
            alternatives: Vec::new(),
        })
    }
}
