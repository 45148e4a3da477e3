//! The choices of the recipe, each put back to what the preset had before it, or to the other way
//! that was tried.

use crate::cli::failure::Result;
use crate::files::{self, FileError};
use lpr_core::agent::Exploration;
use lpr_core::config::Config;
use lpr_core::demo::{Alternatives, PathStarts};
use lpr_core::policy::PolicySpace;
use lpr_core::q_attention::{ActingNetwork, HalfTurn, NetworkSettings, Places, Position};
use lpr_core::ranker::{Critics, Objective, RankerInput, Sampling};
use std::fs;
use std::path::Path;

/// A choice by its name, and how it is put back.
type Choice = (&'static str, fn(&mut Config));

const CHOICES: [Choice; 16] = [
    ("policy-in-joint-space", |config| config.policy.space = PolicySpace::Joints),
    ("ranker-sees-grips", |config| config.ranker.input = RankerInput::Grip),
    ("outcome", |config| config.ranker.objective = Objective::Outcome),
    ("prioritised-ranker", |config| config.ranker.sampling = Sampling::Prioritised),
    ("one-critic", |config| {
        config.ranker.critics = Critics::Single;
        config.training.exploration = epsilon(config.training.exploration);
    }),
    ("epsilon", |config| config.training.exploration = epsilon(config.training.exploration)),
    ("online-ranker", |config| config.ranker.acting_weights = ActingNetwork::Online),
    ("every-path-start", |config| config.demos.path_starts = PathStarts::Every),
    ("no-alternatives", |config| config.demos.alternatives = Alternatives::Never),
    ("no-refinement", |config| config.candidates.refinement = None),
    ("voxel-centres", |config| config.q_attention.position = Position::Voxel),
    ("no-wide-view", |config| config.q_attention.wide_half_width = None),
    ("no-attended-cells", |config| {
        if let NetworkSettings::Fast { attended_channels, .. } = &mut config.q_attention.network {
            *attended_channels = 0;
        }
    }),
    ("no-hand-jitter", |config| config.q_attention.hand_jitter = None),
    ("places-of-the-grid", |config| config.q_attention.places = Places::Grid),
    ("nearest-half-turn", |config| config.q_attention.half_turn = HalfTurn::Nearest),
];

/// Exploration that needs no second critic.
const fn epsilon(exploration: Exploration) -> Exploration {
    match exploration {
        Exploration::Critics { first, last, steps } => Exploration::Epsilon { first, last, steps },
        other => other,
    }
}

/// Writes `recipe` with each choice put back into `directory`; the files.
pub(super) fn write(recipe: &Config, directory: &Path) -> Result<Vec<String>> {
    fs::create_dir_all(directory).map_err(FileError::io("create", directory))?;
    let mut presets = Vec::new();
    for (name, put_back) in CHOICES {
        let mut config = recipe.clone();
        put_back(&mut config);
        let path = directory.join(format!("{name}.toml"));
        files::write_atomically(&path, |file| file.write_all(config.to_toml().as_bytes()))?;
        presets.push(path.display().to_string());
    }
    Ok(presets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_choice_is_in_the_preset_and_what_puts_it_back_can_be_read() {
        let recipe = Config::preset("fast").unwrap();
        let folder = tempfile::tempdir().unwrap();
        for path in write(&recipe, folder.path()).unwrap() {
            let found = Config::from_toml(&fs::read_to_string(&path).unwrap()).unwrap();
            assert_ne!(found, recipe, "{path}");
        }
    }
}
