//! A foreign crate's use of the packed `lpr-core`: its README's program and its example of a world
//! of one's own, which `tests/package.sh` lays beside this file.

#[expect(dead_code, reason = "an example has a `main`")]
mod own_environment;
mod readme;

use wasm_bindgen::prelude::wasm_bindgen;

/// Runs the README's program and returns its finding.
#[wasm_bindgen]
pub fn plan() -> String {
    readme::plan()
}

/// In what share of scenes the agent succeeds, before and after learning.
///
/// # Errors
///
/// As the example.
#[wasm_bindgen]
pub fn learn() -> Result<Vec<f64>, String> {
    own_environment::learn().map(Vec::from).map_err(|error| error.to_string())
}
