//! What a checkpoint stores of the agent.

use super::{Depth, QAttention};
use crate::error::{Error, Result};
use crate::nn::{AdamState, NamedTensor, export, import};

use serde::{Deserialize, Serialize};

/// Everything that makes one depth go on bit by bit: part of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthState {
    /// The online network.
    pub online: Vec<NamedTensor>,
    /// The target network.
    pub target: Vec<NamedTensor>,
    /// The optimiser.
    pub adam: AdamState,
}

impl QAttention {
    /// What a checkpoint stores, from the coarse depth to the fine one.
    #[must_use]
    pub fn state(&self) -> Vec<DepthState> {
        self.depths.iter().map(Depth::state).collect()
    }

    /// Goes on from a checkpoint of an agent with the same settings.
    ///
    /// # Errors
    ///
    /// [`Error::Checkpoint`] naming the tensor that does not fit; the agent is unchanged then.
    pub fn restore(&mut self, state: &[DepthState]) -> Result<()> {
        if state.len() != self.depths.len() {
            return Err(Error::Checkpoint(format!("expected {} depths, found {}", self.depths.len(), state.len())));
        }
        self.depths = self.depths.iter().zip(state).map(|(depth, state)| depth.restored(state)).collect::<Result<_>>()?;
        Ok(())
    }
}

impl Depth {
    fn state(&self) -> DepthState {
        let adam = self.adam.state().clone();
        DepthState { online: export(&self.online), target: export(&self.target), adam }
    }

    fn restored(&self, state: &DepthState) -> Result<Self> {
        let mut adam = self.adam.clone();
        adam.restore(&state.adam)?;
        Ok(Self {
            online: import(self.online.clone(), &state.online)?,
            target: import(self.target.clone(), &state.target)?,
            adam,
        })
    }
}
