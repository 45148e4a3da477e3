//! The question that a candidate set answers, and its streams of random numbers.

use crate::rng::{self, Rng, Stream};
use crate::robot::{JointConfig, Robot};
use crate::scene::Scene;
use glamx::Pose3;

/// The question that a candidate set answers.
#[derive(Debug, Clone, Copy)]
pub struct PathQuery<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// The configuration where it stands.
    pub start: JointConfig,
    /// `world_from_grip` where it goes: the next-best pose.
    pub goal: Pose3,
    /// The obstacles.
    pub scene: &'a Scene,
}

/// Which generators a candidate set draws from: one for every stream and draw, so that no draw
/// moves another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CandidateStreams {
    /// Seed of the run.
    pub seed: u64,
    /// Number of the environment step that the set is for, counted over the whole run; below 2⁴⁰.
    pub step: u64,
}

/// Bits of a stream's index that count the draws of one set.
pub(super) const DRAW_BITS: u32 = 16;

/// Number of the first draw of a second round of curves.
pub(super) const SECOND_ROUND: usize = 1 << (DRAW_BITS - 1);

impl CandidateStreams {
    pub(super) fn rng(self, stream: Stream, draw: usize) -> Rng {
        rng::stream(self.seed, stream, (self.step << DRAW_BITS) | draw as u64)
    }
}
