//! Settings of the algorithms: built-in presets, and files like `config.toml` of a run.

use super::failure::Result;
use crate::files::FileError;
use lpr_core::config::Config;
use std::path::Path;

/// The table of `config.toml` that says what the run was of; a preset has none.
const RUN_TABLE: &str = "run";

/// The default preset, for commands that look at scenes and candidates without a run.
pub(super) fn default_preset() -> Config {
    Config::preset("fast").expect("the preset is built in and parses")
}

/// The preset of that name, or the file of that path; the table that says what a run was of is left
/// out.
pub(super) fn load_config(preset: &str) -> Result<Config> {
    let path = Path::new(preset);
    // A run that is called `fast` does not hide the preset.
    if Config::preset_names().any(|name| name == preset) || !path.exists() {
        return Ok(Config::preset(preset)?);
    }
    let text = std::fs::read_to_string(path).map_err(FileError::io("read", path))?;
    // The core says what is wrong with a text that is no table.
    let mut table = text.parse::<toml::Table>().unwrap_or_default();
    let settings = if table.remove(RUN_TABLE).is_some() { table.to_string() } else { text };
    Config::from_toml(&settings).map_err(|error| FileError::content(path, error.to_string()).into())
}
