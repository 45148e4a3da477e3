//! Experience: transitions and the prioritised buffer that holds them (Schaul et al. 2016).
//!
//! Sampling is proportional to `priority ^ α` and not stratified, as in the released code. New rows
//! take the largest priority ever set, so that everything is seen soon.

mod buffer;
mod sum_tree;
mod transition;

pub use buffer::{Draw, Replay, ReplaySettings, ReplayState};
pub use transition::{Decision, Step, Transition, TransitionRow, join_steps, split_steps};
