//! The preset of the commands that look at scenes and candidates without an agent.

use lpr_core::config::Config;
use lpr_core::path::CandidateSettings;
use lpr_core::q_attention::QAttentionSettings;

fn fast() -> Config {
    Config::preset("fast").expect("the built-in preset is valid")
}

/// The candidate set of `fast`.
pub(super) fn candidates() -> CandidateSettings {
    fast().candidates
}

/// What the action codec of `fast` needs to know: depths, voxels and rotation bins.
pub(super) fn q_attention() -> QAttentionSettings {
    fast().q_attention
}
