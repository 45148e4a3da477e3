//! Experience of one macro action: rows for Q-attention, ranker and policy alike.
//!
//! A step holds what was seen and what was decided; a transition links two successive steps. Both
//! rows that touch a step share it, so an observation is stored once. The type of observations is
//! open: a buffer for the ranker alone needs none (`()`).

use crate::error::{Error, Result};
use crate::path::Source;
use crate::policy::PolicySample;
use crate::ranker::{RankedPath, RankerContext, RankerSample, RankerTransition};

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The agent's decision in one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// The situation in which paths were ranked: next-best pose (`g` in the paper), gripper, time.
    pub context: RankerContext,
    /// The path that was taken: `ξ` in the paper.
    pub taken: RankedPath,
    /// Generator of the path; none for a demonstration.
    pub source: Option<Source>,
    /// Candidates that a demonstrated way was not: see [`crate::demo::Alternatives`].
    pub alternatives: Vec<RankedPath>,
}

/// One environment step: what was seen and what was decided.
#[derive(Debug, Clone, PartialEq)]
pub struct Step<O> {
    /// The observation: `o` in the paper, with proprioception.
    pub observation: O,
    /// The agent's decision; after the last step of a truncated episode it decides once more
    /// without acting.
    pub decision: Decision,
}

/// One environment step and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition<O> {
    /// The step.
    pub step: Arc<Step<O>>,
    /// The step after it; none when the episode terminated here.
    pub next: Option<Arc<Step<O>>>,
    /// Reward: 1 on success, else 0.
    pub reward: f32,
    /// True if the step was the last allowed one of its episode; values still bootstrap from
    /// `next`.
    pub truncated: bool,
    /// True if the episode ended in success: paths of such episodes teach the policy.
    pub episode_success: bool,
    /// True if it was demonstrated.
    pub is_demo: bool,
}

impl<O> Transition<O> {
    /// True if the episode ended in this step by success or failure, not by time.
    #[must_use]
    pub const fn terminated(&self) -> bool {
        self.next.is_none()
    }

    /// The ranker's view, with an importance weight from replay.
    #[must_use]
    pub fn for_ranker(&self, weight: f32) -> RankerTransition<'_> {
        let next = self.next.as_ref().map(|step| step.decision.ranker_sample());
        RankerTransition {
            taken: self.step.decision.ranker_sample(),
            reward: self.reward,
            next,
            outcome: f32::from(u8::from(self.episode_success)),
            weight,
        }
    }

    /// The ranker's view of the alternative number `idx`, modulo their number, as a failure; none
    /// without alternatives.
    #[must_use]
    pub fn alternative(&self, idx: usize, weight: f32) -> Option<RankerTransition<'_>> {
        let Decision { context, alternatives, .. } = &self.step.decision;
        let path = alternatives.get(idx.checked_rem(alternatives.len())?)?;
        let taken = RankerSample { context, path };
        Some(RankerTransition { taken, reward: 0.0, next: None, outcome: 0.0, weight })
    }

    /// The policy's view; none unless the episode ended in success.
    #[must_use]
    pub fn for_policy(&self, weight: f32) -> Option<PolicySample<'_>> {
        let Decision { context, taken, .. } = &self.step.decision;
        self.episode_success.then_some(PolicySample {
            path: &taken.path,
            goal: &context.goal,
            weight,
        })
    }
}

impl Decision {
    fn ranker_sample(&self) -> RankerSample<'_> {
        RankerSample { context: &self.context, path: &self.taken }
    }
}

/// A transition whose steps are numbers into a list: what a checkpoint stores.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransitionRow {
    /// Index of the step.
    pub step: usize,
    /// Index of the step after it.
    pub next: Option<usize>,
    /// As [`Transition::reward`].
    pub reward: f32,
    /// As [`Transition::truncated`].
    pub truncated: bool,
    /// As [`Transition::episode_success`].
    pub episode_success: bool,
    /// As [`Transition::is_demo`].
    pub is_demo: bool,
}

/// The distinct steps of `transitions`, each once, and the rows that link them.
#[must_use]
pub fn split_steps<O>(transitions: &[Transition<O>]) -> (Vec<Arc<Step<O>>>, Vec<TransitionRow>) {
    let mut steps: Vec<Arc<Step<O>>> = Vec::new();
    let mut rows: Vec<TransitionRow> = Vec::with_capacity(transitions.len());
    // Keyed by address for the look-up alone; the order of the result is that of the transitions.
    let mut known = std::collections::BTreeMap::new();
    let mut index_of = |step: &Arc<Step<O>>| {
        *known.entry(Arc::as_ptr(step)).or_insert_with(|| {
            steps.push(Arc::clone(step));
            steps.len() - 1
        })
    };
    for transition in transitions {
        let Transition { reward, truncated, episode_success, is_demo, .. } = *transition;
        let (step, next) =
            (index_of(&transition.step), transition.next.as_ref().map(&mut index_of));
        rows.push(TransitionRow { step, next, reward, truncated, episode_success, is_demo });
    }
    (steps, rows)
}

/// The inverse of [`split_steps`].
///
/// # Errors
///
/// [`Error::Checkpoint`] when a row names a step that is not there.
pub fn join_steps<O>(steps: &[Arc<Step<O>>], rows: &[TransitionRow]) -> Result<Vec<Transition<O>>> {
    let step_at = |idx: usize| {
        let missing = || {
            Error::Checkpoint(format!("replay: a transition names step {idx} of {}", steps.len()))
        };
        steps.get(idx).cloned().ok_or_else(missing)
    };
    rows.iter()
        .map(|row| {
            let TransitionRow { reward, truncated, episode_success, is_demo, .. } = *row;
            let next = row.next.map(step_at).transpose()?;
            Ok(Transition {
                step: step_at(row.step)?,
                next,
                reward,
                truncated,
                episode_success,
                is_demo,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::JointPath;
    use crate::q_attention::NextBestPose;
    use crate::robot::{Gripper, JointConfig};
    use glamx::Pose3;

    /// Three steps of an episode that ends in success.
    fn episode() -> Vec<Transition<u32>> {
        let step = |number: u32| {
            let configs = vec![JointConfig::new([0.0; 7]), JointConfig::new([number as f32; 7])];
            let goal = NextBestPose { pose: Pose3::IDENTITY, gripper: Gripper::Open };
            Arc::new(Step {
                observation: number,
                decision: Decision {
                    context: RankerContext { goal, gripper_open: 1.0, time: 0.0 },
                    taken: RankedPath {
                        path: JointPath::new(configs).expect("two configurations"),
                        collides: false,
                    },
                    source: Some(Source::Bezier),
                    alternatives: Vec::new(),
                },
            })
        };
        let steps = [step(0), step(1), step(2)];
        (0..3)
            .map(|k| Transition {
                step: Arc::clone(&steps[k]),
                next: steps.get(k + 1).cloned(),
                reward: if k == 2 { 1.0 } else { 0.0 },
                truncated: false,
                episode_success: true,
                is_demo: false,
            })
            .collect()
    }

    #[test]
    fn steps_are_stored_once_and_come_back_shared() {
        let transitions = episode();
        let (steps, rows) = split_steps(&transitions);
        assert_eq!(steps.iter().map(|step| step.observation).collect::<Vec<_>>(), [0, 1, 2]);
        let joined = join_steps(&steps, &rows).expect("its own rows");
        assert_eq!(joined, transitions);
        let next = joined[0].next.as_ref().expect("not the last");
        assert!(Arc::ptr_eq(next, &joined[1].step));
        assert!(join_steps(&steps[..2], &rows).is_err());
    }

    #[test]
    fn the_path_taken_next_follows_unless_the_episode_terminated() {
        let transitions = episode();
        let next = transitions[0].for_ranker(0.5).next.expect("not the last");
        assert_eq!(next.path, &transitions[1].step.decision.taken);
        assert!(transitions[2].terminated() && transitions[2].for_ranker(1.0).next.is_none());
    }

    #[test]
    fn the_policy_learns_from_successful_episodes_only() {
        let mut transition = episode().remove(0);
        assert!(transition.for_policy(1.0).is_some());
        transition.episode_success = false;
        assert!(transition.for_policy(1.0).is_none());
    }
}
