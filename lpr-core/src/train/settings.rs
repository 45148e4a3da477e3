//! Numbers of Algorithm 1 itself.

use crate::agent::Exploration;
use crate::error::{Error, Result};
use crate::q_attention::ActingNetwork;

use serde::{Deserialize, Serialize};

/// How a run of Algorithm 1 goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainSettings {
    /// Demonstrations in the replay before training (paper: 10).
    pub demonstrations: usize,
    /// Updates on demonstrations alone before the first environment step (released: 0).
    pub demonstration_updates: u64,
    /// Transitions in the replay, demonstrations included, before the first update (released: 200).
    pub transitions_before_updates: u64,
    /// Updates of Q-attention after every environment step (released: about 1).
    pub q_attention_updates_per_step: usize,
    /// Transitions of an update of Q-attention (released: 128).
    pub q_attention_batch: usize,
    /// Which weights of Q-attention choose poses (paper: those that gradients change).
    pub acting_weights: ActingNetwork,
    /// Updates of ranker and policy after every environment step (released: about 1).
    pub path_updates_per_step: usize,
    /// Transitions of an update of ranker and policy (released: 128).
    pub path_batch: usize,
    /// How a training step departs from the path of highest value.
    pub exploration: Exploration,
    /// What running out of steps means.
    pub timeout: Timeout,
    /// Distance of the points of a cloud that the replay keeps, metres.
    pub cloud_spacing: f32,
    /// Environment steps between two validations.
    pub validation_interval: u64,
    /// Episodes of a validation.
    pub validation_episodes: u64,
}

/// What running out of steps means for the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Timeout {
    /// The episode terminated: the target of its last step is the reward alone, as in the released
    /// code.
    Terminal,
    /// The episode was cut off: the target of its last step bootstraps like any other.
    Truncated,
}

impl TrainSettings {
    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] naming the first setting that is out of its range.
    pub fn check(&self) -> Result<()> {
        let rules = [
            (self.q_attention_batch >= 1, "q_attention_batch: at least 1"),
            (self.path_batch >= 1, "path_batch: at least 1"),
            (
                self.exploration.is_valid(),
                "exploration: probabilities are 0 to 1, a temperature is above 0",
            ),
            (self.cloud_spacing > 0.0, "cloud_spacing: above 0"),
            (self.validation_interval >= 1, "validation_interval: at least 1"),
            (self.validation_episodes >= 1, "validation_episodes: at least 1"),
        ];
        let broken = rules.iter().find(|(holds, _)| !holds);
        broken.map_or(Ok(()), |(_, rule)| Err(Error::Config(format!("training.{rule}"))))
    }
}
