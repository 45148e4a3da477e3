//! Numbers of Algorithm 1 itself.

use crate::agent::Exploration;
use crate::check::{in_table, setting};
use crate::error::Result;
use crate::q_attention::ActingNetwork;

use core::fmt::Display;
use serde::{Deserialize, Serialize};

/// Settings of a run of Algorithm 1.
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
    /// Weights of Q-attention that choose poses (paper: those that gradients change).
    pub acting_weights: ActingNetwork,
    /// Updates of ranker and policy after every environment step (released: about 1).
    pub path_updates_per_step: usize,
    /// Transitions of an update of ranker and policy (released: 128).
    pub path_batch: usize,
    /// Departure of a training step from the path of highest value.
    pub exploration: Exploration,
    /// Meaning of a timeout.
    pub timeout: Timeout,
    /// Distance of the points of a cloud that the replay keeps, metres.
    pub cloud_spacing: f32,
    /// Environment steps between two validations.
    pub validation_interval: u64,
    /// Episodes of a validation.
    pub validation_episodes: u64,
}

/// Meaning of a timeout for the values.
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
    /// [`Error::Config`](crate::Error::Config) naming the first setting that is out of its range.
    pub fn check(&self) -> Result<()> {
        let check = |holds, name: &str, expected: &str, found: &dyn Display| {
            setting(holds, &format!("training.{name}"), expected, found)
        };
        let batches =
            [("q_attention_batch", self.q_attention_batch), ("path_batch", self.path_batch)];
        for (name, batch) in batches {
            check(batch >= 1, name, "at least 1", &batch)?;
        }
        self.exploration.check().map_err(|error| in_table("training", error))?;
        check(self.cloud_spacing > 0.0, "cloud_spacing", "above 0", &self.cloud_spacing)?;
        let validations = [
            ("validation_interval", self.validation_interval),
            ("validation_episodes", self.validation_episodes),
        ];
        for (name, count) in validations {
            check(count >= 1, name, "at least 1", &count)?;
        }
        Ok(())
    }
}
