//! Candidate paths, and the draws that gave none.

use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::path::source::Source;

/// A path that the arm can follow, for the ranker.
#[derive(Debug, Clone, PartialEq)]
pub struct CandidatePath {
    /// Which generator made it (`m`, `b` or `π` in the paper).
    pub source: Source,
    /// `T` configurations, joined linearly.
    pub path: JointPath,
    /// True if the arm meets the scene or itself on the way.
    pub collides: bool,
}

/// A draw that gave no path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RejectedPath {
    /// Which generator failed.
    pub source: Source,
    /// Reason of the failure.
    pub reason: Rejection,
}

/// The candidates (`Ξ` in the paper) and what was rejected, both in the order planner, Bézier,
/// screw, policy.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CandidateSet {
    /// Paths to rank.
    pub candidates: Vec<CandidatePath>,
    /// Draws that gave none.
    pub rejected: Vec<RejectedPath>,
}

impl CandidateSet {
    /// The shortest candidate that does not collide.
    #[must_use]
    pub fn shortest_free(&self) -> Option<&CandidatePath> {
        let free = self.candidates.iter().filter(|candidate| !candidate.collides);
        free.min_by(|a, b| a.path.length().total_cmp(&b.path.length()))
    }

    /// Mean length of the candidates, radians; none without candidates.
    pub(super) fn mean_length(&self) -> Option<f32> {
        let lengths = self.candidates.iter().map(|candidate| candidate.path.length());
        (!self.candidates.is_empty()).then(|| lengths.sum::<f32>() / self.candidates.len() as f32)
    }

    /// Adds paths, but none that is already there.
    pub(crate) fn add(&mut self, SampledPaths { source, outcomes }: SampledPaths) {
        for outcome in outcomes {
            self.rejected
                .extend(outcome.failures.into_iter().map(|reason| RejectedPath { source, reason }));
            let Some((path, collides)) = outcome.path else { continue };
            if self.candidates.iter().any(|other| other.path == path) {
                self.rejected.push(RejectedPath { source, reason: Rejection::TooFewGoals });
            } else {
                self.candidates.push(CandidatePath { source, path, collides });
            }
        }
    }
}

/// The paths of one generator, in the order of their draws; [`PathSampler::join`] takes them.
///
/// [`PathSampler::join`]: super::PathSampler::join
#[derive(Debug, Clone, PartialEq)]
pub struct SampledPaths {
    pub(super) source: Source,
    pub(super) outcomes: Vec<Outcome>,
}

/// The result of the draws for one path: the path with its `collides` flag, if any, and the
/// failures before it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outcome {
    pub(super) path: Option<(JointPath, bool)>,
    pub(super) failures: Vec<Rejection>,
}

impl From<Rejection> for Outcome {
    fn from(reason: Rejection) -> Self {
        Self { path: None, failures: vec![reason] }
    }
}
