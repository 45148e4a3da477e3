//! Words that say how an agent acts: its method, and the source of its poses.

use crate::check::one_of;
use crate::error::{Error, Result};

use serde::{Deserialize, Serialize};

/// A method of choosing paths to next-best poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, strum::IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Planner, Bézier and policy paths, ranked by learned values: the paper's.
    Lpr,
    /// The same without the path policy: the paper's ablation.
    LprNoPolicy,
    /// The baseline: the straight line of the grip, else the shortest joint-space motion without
    /// collision checking.
    #[serde(rename = "c2farm")]
    #[strum(serialize = "c2farm")]
    C2fArm,
    /// The straight line of the grip alone.
    Linear,
    /// The shortest candidate that does not collide.
    ShortestFree,
    /// Any of the candidates.
    Random,
}

/// Source of the next-best poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// Coarse-to-fine Q-attention, as in the paper.
    Learned,
    /// The demonstrator (`--oracle-poses`): paths are learned alone, and Q-attention is not built.
    Oracle,
}

impl Method {
    /// All of them; the first is the default.
    pub const ALL: [Self; 6] = [
        Self::Lpr,
        Self::LprNoPolicy,
        Self::C2fArm,
        Self::Linear,
        Self::ShortestFree,
        Self::Random,
    ];

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The method of that name.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] naming those that exist.
    pub fn by_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name).ok_or_else(|| {
            Error::Config(format!("method: {}", one_of(Self::ALL.map(Self::name), name)))
        })
    }

    /// True if it ranks paths by learned values.
    #[must_use]
    pub const fn has_ranker(self) -> bool {
        matches!(self, Self::Lpr | Self::LprNoPolicy)
    }

    /// True if a learned policy proposes a path.
    #[must_use]
    pub const fn has_policy(self) -> bool {
        matches!(self, Self::Lpr)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_files_and_of_the_command_line() {
        for method in Method::ALL {
            assert_eq!(Method::by_name(method.name()), Ok(method));
            assert_eq!(serde_json::to_value(method).expect("a word"), method.name());
        }
        assert!(
            Method::by_name("LPR").expect_err("case matters").to_string().contains("lpr-no-policy")
        );
    }
}
