//! One greedy episode with everything that was decided in it, for files and animations.

use super::run_episode;
use crate::agent::{Action, Agent, Eyes};
use crate::env::{Environment, StepResult};
use crate::error::Result;

/// An environment step of a recorded episode.
#[derive(Debug, Clone)]
pub struct RecordedStep {
    /// Decision of the agent, with every candidate.
    pub action: Action,
    /// Result of its run.
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
        let result = agent.execute(environment, action)?;
        steps.push(RecordedStep { action: action.clone(), result });
        Ok(result)
    };
    run_episode(agent, environment, seed, Eyes::Open, &mut run)?;
    Ok(steps)
}
