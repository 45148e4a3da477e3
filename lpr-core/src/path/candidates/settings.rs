//! Numbers of the candidate set.

use super::query::{DRAW_BITS, SECOND_ROUND};
use crate::check::{in_table, setting};
use crate::error::Result;
use crate::path::curves::BezierSettings;
use crate::path::planners::{PlannerKind, RrtSettings};
use serde::{Deserialize, Serialize};

/// Numbers of the candidate set.
///
/// ```
/// use lpr_core::path::CandidateSettings;
///
/// let settings = CandidateSettings { planner_paths: 20, ..CandidateSettings::EXAMPLE };
/// assert_eq!(settings.check(), Ok(()));
/// let too_short = CandidateSettings { path_len: 1, ..settings };
/// let message = too_short.check().unwrap_err().to_string();
/// assert_eq!(message, "configuration: candidates.path_len: expected at least 2, found 1");
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateSettings {
    /// Configurations of every path (`T` in the paper).
    pub path_len: usize,
    /// Planner paths asked for (`M` in the paper).
    pub planner_paths: usize,
    /// Bézier paths asked for (`B` in the paper).
    pub bezier_paths: usize,
    /// Share of the planner paths that are planned with collision checking on, 0 to 1 ("a portion"
    /// in the paper).
    pub planner_collision_free_fraction: f32,
    /// Screw motions of the grip asked for, 0 or 1: there is one from start to goal. Beyond the
    /// paper; settings files that do not say mean none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub screw_paths: usize,
    /// Draws for every path before it is given up.
    pub draws_per_path: usize,
    /// Two goal configurations differ by more than this in some joint, radians.
    pub min_goal_distance: f32,
    /// Which planner; settings files that name none mean `RRTConnect`, the paper's.
    #[serde(default, skip_serializing_if = "PlannerKind::is_default")]
    pub planner: PlannerKind,
    /// The numbers of `RRTConnect`, and the resolution of all checks; the other planners have their
    /// standard numbers.
    pub rrt: RrtSettings,
    /// The curves.
    pub bezier: BezierSettings,
    /// A second round of curves; settings files that name none mean none, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinement: Option<Refinement>,
}

/// A second round of curves, around the candidates that the ranker values most: the paper hopes to
/// "rely less on sampling".
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refinement {
    /// Candidates that curves are drawn around.
    pub best: usize,
    /// Curves of the second round.
    pub paths: usize,
    /// Standard deviation of their middle control points around that of a candidate, metres.
    pub sigma: f32,
}

impl CandidateSettings {
    /// A small set for documentation, examples and tests: 4 planner paths and 4 curves, wide ones,
    /// of 10 configurations. A run takes its numbers from a preset.
    pub const EXAMPLE: Self = Self {
        path_len: 10,
        planner_paths: 4,
        bezier_paths: 4,
        screw_paths: 0,
        planner_collision_free_fraction: 0.5,
        draws_per_path: 5,
        min_goal_distance: 0.2,
        planner: PlannerKind::RrtConnect,
        rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
        bezier: BezierSettings { sigma: 0.25 },
        refinement: None,
    };

    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`](crate::Error::Config) naming the first setting that is out of its range.
    pub fn check(&self) -> Result<()> {
        self.check_numbers().map_err(|error| in_table("candidates", error))
    }

    fn check_numbers(&self) -> Result<()> {
        /// Draws of one set: the numbers of their streams are unique below this.
        const MAX_DRAWS: usize = 1 << DRAW_BITS;
        setting(self.path_len >= 2, "path_len", "at least 2", self.path_len)?;
        setting(self.screw_paths <= 1, "screw_paths", "0 or 1", self.screw_paths)?;
        setting(self.draws_per_path >= 1, "draws_per_path", "at least 1", self.draws_per_path)?;
        let expected = format!("at most {MAX_DRAWS} draws, paths times draws_per_path");
        let paths = [("planner_paths", self.planner_paths), ("bezier_paths", self.bezier_paths)];
        for (name, n_paths) in paths {
            let n_draws = n_paths.saturating_mul(self.draws_per_path);
            setting(n_draws <= MAX_DRAWS, name, &expected, n_draws)?;
        }
        if let Some(Refinement { best, paths, sigma }) = self.refinement {
            setting(best >= 1, "refinement.best", "at least 1", best)?;
            let n_draws = self.bezier_paths.max(paths).saturating_mul(self.draws_per_path);
            let expected = format!("at most {SECOND_ROUND} draws a round");
            setting(n_draws <= SECOND_ROUND, "refinement.paths", &expected, n_draws)?;
            let holds = sigma.is_finite() && sigma >= 0.0;
            setting(holds, "refinement.sigma", "a finite number from 0", sigma)?;
        }
        let fraction = self.planner_collision_free_fraction;
        let name = "planner_collision_free_fraction";
        setting((0.0..=1.0).contains(&fraction), name, "0 to 1", fraction)?;
        let distance = self.min_goal_distance;
        let is_distance = distance.is_finite() && distance >= 0.0;
        setting(is_distance, "min_goal_distance", "a finite number from 0", distance)?;
        self.rrt.check()?;
        self.bezier.check()
    }
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands a reference to what decides on skipping"
)]
const fn is_zero(n: &usize) -> bool {
    *n == 0
}
