//! Bytes and back: the weights, which any program of this crate can act with, and the rest of a
//! run, from which training goes on bit by bit.
//!
//! No generator is stored: each is made anew from the seed and a counter. Nor is the world: an
//! episode that is under way is played again from its scene, which ends where it was.
//!
//! Both files carry a digest, so that damage is told from a bug.

mod state;
mod weights;

pub use weights::{SavedAgent, WeightsHeader, load_agent, read_header};

use crate::digest;
use crate::env::Environment;
use crate::error::{Error, Result};
use crate::q_attention::NextBestPose;
use crate::train::Trainer;
use state::State;

/// A run between two environment steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    /// `weights.safetensors`: every network, with the configuration in its metadata.
    pub weights: Vec<u8>,
    /// `state.bin`: optimisers, targets, replay and counters, for the same weights.
    pub state: Vec<u8>,
}

impl<E: Environment> Trainer<E> {
    /// Everything that [`Self::resume`] needs.
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] when a setting has no representation (a seed from 2⁶³ on), or a weight
    /// is not finite.
    pub fn checkpoint(&self) -> Result<Checkpoint> {
        let weights = weights::write(self)?;
        let state = State::of(self, digest::of(&weights)).to_bytes()?;
        Ok(Checkpoint { weights, state })
    }

    /// Goes on where [`Self::checkpoint`] was made, in a world like the one it was made in.
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] naming what is corrupt, foreign or newer than this program, or when
    /// the world does not repeat the episode that was under way.
    pub fn resume(checkpoint: &Checkpoint, environment: E) -> Result<Self> {
        let SavedAgent { header, agent } = load_agent(&checkpoint.weights)?;
        let robot = environment.robot().name.clone();
        if header.robot != robot {
            return Err(Error::Checkpoint(format!(
                "of the robot `{}`, the world has `{robot}`",
                header.robot
            )));
        }
        let state = State::from_bytes(&checkpoint.state)?;
        if state.weights_digest != digest::of(&checkpoint.weights) {
            return Err(Error::Checkpoint(
                "weights and state are not of one checkpoint".to_owned(),
            ));
        }
        let mut trainer = Self::new(header.config, header.run, environment)?;
        trainer.agent = agent;
        state.restore(&mut trainer)?;
        trainer.play_again()?;
        Ok(trainer)
    }

    /// Brings the world to where the episode under way is.
    fn play_again(&mut self) -> Result<()> {
        let Some(episode) = self.episode.take() else { return Ok(()) };
        let environment = self.environment();
        environment.reset(episode.scene_seed)?;
        for (path, NextBestPose { gripper, .. }) in episode.actions() {
            let result = environment.step(path, gripper)?;
            if result.is_last() {
                return Err(Error::Checkpoint(
                    "the world does not repeat the episode under way: it ended early".to_owned(),
                ));
            }
        }
        self.episode = Some(episode);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
