//! The set of candidate paths that the ranker sees (Algorithm 1, lines 8–11).
//!
//! The paths ranked are the paths run: every candidate is the `T` configurations that the arm will follow,
//! joined linearly, and `collides` is computed on them.
//!
//! # Differences from the paper
//!
//! - `M` and `B` count admitted paths: a draw that fails is repeated a few times, and every failure
//!   is listed with its reason.
//! - The share of planner paths with collision checking off are straight joint-space motions: what
//!   `RRTConnect` finds when nothing is in the way.
//! - When the goal pose has fewer than `M` distinct configurations, the checked planner paths share
//!   them with other samples of `RRTConnect`; a path that comes out twice is kept once.
//! - The policy's path is moved onto the exact start and goal, and must keep the joint limits.
//! - The planner is a setting; every preset has `RRTConnect`.
//! - A screw motion of the grip can be asked for besides, and a second round of curves around the
//!   candidates that the ranker values most ([`Refinement`]); no preset does.

mod baseline;
mod query;
mod sampler;
mod set;
mod settings;

pub use baseline::{c2farm_path, linear_candidate};
pub use query::{CandidateStreams, PathQuery};
pub use sampler::{PathSampler, candidates};
pub use set::{CandidatePath, CandidateSet, RejectedPath, SampledPaths};
pub use settings::{CandidateSettings, Refinement};

#[cfg(test)]
mod tests;
