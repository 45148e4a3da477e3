//! Results that the candidates could have given: every one is executed from a snapshot of the
//! world.

use super::{EvaluatedEpisode, Evaluation, run_episode};
use crate::agent::{Action, Agent, Eyes};
use crate::env::Environment;
use crate::error::Result;
use crate::in_order::map_in_order;

use core::ops::Range;

/// Shortfall of the chosen paths against the best of all candidates.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Regret {
    /// Environment steps in which some candidate would have finished the task.
    pub decisive_steps: u64,
    /// Those of them in which the chosen path did not.
    pub missed: u64,
}

impl Regret {
    /// Mean over the decisive steps of the best reward minus that of the chosen path; none without
    /// such a step.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.decisive_steps > 0).then(|| self.missed as f64 / self.decisive_steps as f64)
    }

    fn add(&mut self, best: f32, chosen: f32) {
        if best > 0.0 || chosen > 0.0 {
            self.decisive_steps += 1;
            self.missed += u64::from(chosen < best);
        }
    }
}

/// [`evaluate`](super::evaluate) for an oracle that executes every candidate of `agent` from a
/// snapshot and goes on with the best.
///
/// The best is one that finishes the task; else, among those that end without an invalid action,
/// the one whose grip ends nearest to the pose. The oracle looks one step ahead: a path that grasps
/// badly counts like one that grasps well.
///
/// # Errors
///
/// As [`evaluate`](super::evaluate).
pub fn best_of_all<E: Environment + Clone>(
    agent: &Agent,
    environment: &mut E,
    seeds: Range<u64>,
    mut on_episode: impl FnMut(&EvaluatedEpisode),
) -> Result<Evaluation> {
    let mut evaluation = Evaluation::default();
    for seed in seeds {
        let mut run = |environment: &mut E, action: &Action| {
            let chosen = best_candidate(environment, action)?;
            let action = Action { chosen, ..action.clone() };
            evaluation.add_action(&action);
            agent.execute(environment, &action)
        };
        let episode = run_episode(agent, environment, seed, Eyes::Open, &mut run)?;
        evaluation.add(&episode);
        on_episode(&episode);
    }
    Ok(evaluation)
}

/// The regret of the agent's choices in the greedy episodes of `seeds`.
///
/// # Errors
///
/// As [`evaluate`](super::evaluate).
pub fn measure_regret<E: Environment + Clone + Send + Sync>(
    agent: &Agent,
    environment: &mut E,
    seeds: Range<u64>,
) -> Result<Regret> {
    let mut regret = Regret::default();
    for seed in seeds {
        let mut run = |environment: &mut E, action: &Action| {
            let (snapshot, candidates) = (&*environment, &action.set.candidates);
            let reward = |idx: usize| {
                let result = snapshot.clone().step(&candidates[idx].path, action.goal.gripper)?;
                Ok(result.reward)
            };
            let rewards: Vec<f32> =
                map_in_order(candidates.len(), reward).into_iter().collect::<Result<_>>()?;
            let best = rewards.into_iter().fold(0.0, f32::max);
            let result = agent.execute(environment, action)?;
            regret.add(best, result.reward);
            Ok(result)
        };
        run_episode(agent, environment, seed, Eyes::Open, &mut run)?;
    }
    Ok(regret)
}

/// Index of the candidate that the oracle takes.
pub(crate) fn best_candidate<E: Environment + Clone>(
    snapshot: &E,
    action: &Action,
) -> Result<Option<usize>> {
    let mut best: Option<(usize, f32)> = None;
    for (idx, candidate) in action.set.candidates.iter().enumerate() {
        let mut world = snapshot.clone();
        let result = world.step(&candidate.path, action.goal.gripper)?;
        if result.reward > 0.0 {
            return Ok(Some(idx));
        }
        let distance = if result.invalid.is_some() {
            f32::INFINITY
        } else {
            let grip = world.observe()?.proprio.grip;
            grip.translation.distance(action.goal.pose.translation)
        };
        if best.is_none_or(|(_, least)| distance < least) {
            best = Some((idx, distance));
        }
    }
    Ok(best.map(|(idx, _)| idx))
}
