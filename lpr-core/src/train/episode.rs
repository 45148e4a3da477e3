//! From the steps of an episode to rows of the replay.

use super::log::{EpisodeLog, chosen_values};
use crate::agent::{Action, Agent, context};
use crate::demo::{Alternatives, DemoEpisode, DemoSettings, DemoStep, PathStarts};
use crate::env::StepResult;
use crate::error::{Error, Result};
use crate::learner::{Learner, Row, Seen};
use crate::path::{CandidatePath, CandidateStreams, JointPath, PathQuery, candidates};
use crate::q_attention::NextBestPose;
use crate::ranker::RankedPath;
use crate::replay::{Decision, Step, Transition};

use std::sync::Arc;

/// An episode that is under way.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Episode {
    /// Seed of its scene.
    pub(crate) scene_seed: u64,
    pub(crate) steps: Vec<Taken>,
    /// The agent's decision after the last step of an episode that was cut off.
    pub(crate) next: Option<Choice>,
}

/// A step of an episode and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Taken {
    pub(crate) choice: Choice,
    /// The ranker's value of the path.
    pub(crate) value: Option<f32>,
    pub(crate) reward: f32,
}

/// The agent's choice.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Choice {
    /// A path.
    Path(Arc<Step<Seen>>),
    /// A pose that no path reaches: the step holds a path that stays where it is.
    Nowhere(Arc<Step<Seen>>),
}

impl Choice {
    fn new(action: &Action) -> Self {
        let step = |decision| Arc::new(Step { observation: action.seen.clone(), decision });
        if let Some(decision) = action.decision() {
            return Self::Path(step(decision));
        }
        let start = action.proprio.joints;
        let path = JointPath::new(vec![start; 2]).expect("measured angles are finite");
        let taken = RankedPath { path, collides: false };
        Self::Nowhere(step(Decision {
            context: action.context,
            taken,
            source: None,
            alternatives: Vec::new(),
        }))
    }

    pub(crate) const fn step(&self) -> &Arc<Step<Seen>> {
        match self {
            Self::Path(step) | Self::Nowhere(step) => step,
        }
    }

    fn path_step(&self) -> Option<&Arc<Step<Seen>>> {
        match self {
            Self::Path(step) => Some(step),
            Self::Nowhere(_) => None,
        }
    }
}

impl Episode {
    pub(crate) const fn new(scene_seed: u64) -> Self {
        Self { scene_seed, steps: Vec::new(), next: None }
    }

    /// The paths that ran, with the poses they led to.
    pub(crate) fn actions(&self) -> impl Iterator<Item = (&JointPath, NextBestPose)> {
        self.steps.iter().map(|taken| {
            let decision = &taken.choice.step().decision;
            (&decision.taken.path, decision.context.goal)
        })
    }

    /// Adds a step and what came of it.
    pub(super) fn push(&mut self, action: &Action, result: &StepResult) {
        let (choice, value) = (Choice::new(action), action.chosen_value());
        self.steps.push(Taken { choice, value, reward: result.reward });
    }

    /// Sets what would follow the last step.
    pub(super) fn push_next(&mut self, action: &Action) {
        self.next = Some(Choice::new(action));
    }

    fn succeeded(&self) -> bool {
        self.steps.last().is_some_and(|step| step.reward > 0.0)
    }

    /// All steps into the buffers (line 14).
    pub(super) fn store(&self, agent: &Agent, learner: &mut Learner) {
        let episode_success = self.succeeded();
        for (idx, taken) in self.steps.iter().enumerate() {
            let is_last = idx + 1 == self.steps.len();
            let next = if is_last { self.next.as_ref() } else { Some(&self.steps[idx + 1].choice) };
            let row = |next: Option<&Arc<Step<Seen>>>| Transition {
                step: Arc::clone(taken.choice.step()),
                next: next.cloned(),
                reward: taken.reward,
                truncated: is_last && self.next.is_some(),
                episode_success,
                is_demo: false,
            };
            if taken.choice.path_step().is_some() {
                learner.push_path(&row(next.and_then(Choice::path_step)));
            }
            if let Some(attention) = &agent.networks.q_attention {
                learner.push_scene(&row(next.map(Choice::step)), attention);
            }
        }
    }

    /// The report of it, with `discount` (γ) for the rewards after each step.
    pub(super) fn log(&self, episode: u64, last: &StepResult, discount: f32) -> EpisodeLog {
        let values =
            chosen_values(self.steps.iter().map(|taken| (taken.value, taken.reward)), discount);
        EpisodeLog {
            episode,
            scene_seed: self.scene_seed,
            steps: self.steps.len(),
            success: self.succeeded(),
            failure: last.failure(),
            values,
        }
    }
}

/// The steps of a demonstration into the buffers (line 3).
pub(super) fn add_demonstration(
    demo: &DemoEpisode,
    settings: &DemoSettings,
    agent: &Agent,
    learner: &mut Learner,
) -> Result<()> {
    if demo.steps.is_empty() {
        return Err(Error::Shape {
            what: "demonstration",
            expected: "at least 1 step".to_owned(),
            found: "none".to_owned(),
        });
    }
    let teaches_paths = settings.path_starts == PathStarts::Every || demo.start == 0;
    let with_alternatives = settings.alternatives != Alternatives::Never && teaches_paths;
    let number = |idx: usize| learner.n_transitions() + idx as u64;
    let streams = |idx| with_alternatives.then(|| learner.demonstration_streams(number(idx)));
    let steps = demo.steps.iter().enumerate();
    let steps: Vec<_> =
        steps.map(|(idx, step)| Arc::new(demonstrated(step, agent, streams(idx)))).collect();
    for (idx, step) in steps.iter().enumerate() {
        let next = steps.get(idx + 1).cloned();
        let reward = if next.is_none() { 1.0 } else { 0.0 };
        let row = Row {
            step: Arc::clone(step),
            next,
            reward,
            truncated: false,
            episode_success: true,
            is_demo: true,
        };
        if teaches_paths {
            learner.push_path(&row);
        }
        if let Some(attention) = &agent.networks.q_attention {
            learner.push_scene(&row, attention);
        }
    }
    Ok(())
}

fn demonstrated(
    step: &DemoStep,
    agent: &Agent,
    alternatives: Option<CandidateStreams>,
) -> Step<Seen> {
    let scene = agent.obstacles(&step.observation, &step.goal);
    let start = *step.path.start();
    let query = PathQuery { robot: agent.robot(), start, goal: step.goal.pose, scene: &scene };
    let alternatives = alternatives.map_or_else(Vec::new, |streams| {
        let set = candidates(&query, agent.candidate_settings(), streams);
        let ranked = |CandidatePath { path, collides, .. }| RankedPath { path, collides };
        set.candidates.into_iter().map(ranked).collect()
    });
    let decision = Decision {
        context: context(&step.observation.proprio, step.goal),
        taken: agent.ranked(&step.path, &scene),
        source: None,
        alternatives,
    };
    Step { observation: agent.attended(&step.observation), decision }
}
