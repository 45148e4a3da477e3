//! One greedy episode with everything that was decided in it, for files and animations.

use super::run_episode;
use crate::agent::{Action, Agent};
use crate::env::{Environment, StepResult};
use crate::error::Result;
use crate::train::execute;

/// An environment step of a recorded episode.
#[derive(Debug, Clone)]
pub struct RecordedStep {
    /// What the agent came to, with every candidate.
    pub action: Action,
    /// What came of it.
    pub result: StepResult,
}

/// The greedy episode of scene `seed`; the environment is left at its end.
///
/// # Errors
///
/// As [`evaluate`](super::evaluate).
pub fn record_episode(
    agent: &Agent,
    environment: &mut impl Environment,
    seed: u64,
) -> Result<Vec<RecordedStep>> {
    let mut steps = Vec::new();
    let mut run = |environment: &mut _, action: &Action| {
        let result = execute(environment, agent.poses(), action);
        steps.push(RecordedStep { action: action.clone(), result });
        result
    };
    run_episode(agent, environment, seed, &mut run)?;
    Ok(steps)
}
