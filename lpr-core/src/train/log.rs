//! Reports of training steps.

use super::Progress;
use crate::agent::Action;
use crate::env::StepResult;
use crate::path::Source;

/// Named numbers in the order in which they were measured.
///
/// Names are `group/what`, as dashboards group them:
///
/// | name | meaning |
/// | --- | --- |
/// | `value/chosen`, `value/mean` | value of the path that ran; mean over the candidates |
/// | `candidates/planner`, `candidates/bezier`, `candidates/rejected` | how many there were |
/// | `policy/valid`, `policy/chosen` | 1 when the policy's path was ranked; when it ran |
/// | `episode/success`, `episode/steps` | of an episode that ended with the step |
/// | `value/realised`, `value/error` | mean over an episode of `γ^k` reward of what came; of its absolute difference to the value |
/// | `validation/…` | of a validation: `success`, `regret`, `value_chosen`, `value_realised` and `value_error`, means over its steps |
/// | `losses/…`, `td_error` | means over the gradient steps after the environment step |
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metrics(Vec<(&'static str, f32)>);

impl Metrics {
    /// Adds a number under a name that is new.
    pub fn push(&mut self, name: &'static str, value: f32) {
        debug_assert!(self.get(name).is_none(), "{name} is measured once");
        self.0.push((name, value));
    }

    /// Adds the mean of `values`, unless there are none.
    pub fn push_mean(&mut self, name: &'static str, values: impl Iterator<Item = f32>) {
        let (sum, n) = values.fold((0.0, 0_u32), |(sum, n), value| (sum + value, n + 1));
        if n > 0 {
            self.push(name, sum / n as f32);
        }
    }

    /// The number of that name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<f32> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f32)> + '_ {
        self.0.iter().copied()
    }
}

/// Report of an environment step and its gradient steps.
#[derive(Debug, Clone)]
pub struct StepLog {
    /// Progress of the run, this step included.
    pub progress: Progress,
    /// Updates so far, of the network that was updated most.
    pub updates: u64,
    /// The agent's action.
    pub action: Action,
    /// The environment's answer.
    pub result: StepResult,
    /// The episode, if it ended with this step.
    pub episode: Option<EpisodeLog>,
    /// Everything measured.
    pub metrics: Metrics,
}

/// An episode that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeLog {
    /// Its number within the run, from 0.
    pub episode: u64,
    /// Seed of its scene.
    pub scene_seed: u64,
    /// Environment steps.
    pub steps: usize,
    /// True if the task was done.
    pub success: bool,
    /// The reason if it was not: the name of an invalid action, `timeout` or `not_done`.
    pub failure: Option<&'static str>,
    /// Value of the path that ran and the discounted reward that came of it, for each step that
    /// ranked paths.
    pub values: Vec<ChosenValue>,
}

/// Expected and realised value of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChosenValue {
    /// The ranker's value of the path that ran.
    pub expected: f32,
    /// Discounted sum of the rewards from the step to the end of the episode.
    pub realised: f32,
}

/// Pairs the value of every step's path with the discounted rewards from that step on.
pub(crate) fn chosen_values(
    steps: impl DoubleEndedIterator<Item = (Option<f32>, f32)>,
    discount: f32,
) -> Vec<ChosenValue> {
    let mut realised = 0.0;
    let with_realised = steps.rev().map(|(value, reward)| {
        realised = reward + discount * realised;
        value.map(|expected| ChosenValue { expected, realised })
    });
    let mut values: Vec<_> = with_realised.flatten().collect();
    values.reverse();
    values
}

pub(super) fn write_action(action: &Action, result: &StepResult, metrics: &mut Metrics) {
    metrics.push("reward", result.reward);
    if let Some(attention) = &action.attention {
        metrics.push("value/pose", attention.value);
    }
    if let Some(value) = action.chosen_value() {
        metrics.push("value/chosen", value);
    }
    metrics.push_mean("value/mean", action.values.iter().flatten().copied());
    metrics.push("candidates/planner", action.n_from(Source::Planner) as f32);
    metrics.push("candidates/bezier", action.n_from(Source::Bezier) as f32);
    if action.n_from(Source::Screw) > 0 {
        metrics.push("candidates/screw", 1.0);
    }
    metrics.push("candidates/rejected", action.set.rejected.len() as f32);
    metrics.push("policy/valid", action.n_from(Source::Policy) as f32);
    let is_policy = action.path().is_some_and(|path| path.source == Source::Policy);
    metrics.push("policy/chosen", f32::from(u8::from(is_policy)));
}

pub(super) fn write_episode(episode: &EpisodeLog, metrics: &mut Metrics) {
    metrics.push("episode/success", f32::from(u8::from(episode.success)));
    metrics.push("episode/steps", episode.steps as f32);
    metrics.push_mean("value/realised", episode.values.iter().map(|value| value.realised));
    metrics.push_mean(
        "value/error",
        episode.values.iter().map(|value| (value.expected - value.realised).abs()),
    );
}
