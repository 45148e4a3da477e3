//! What the demo page calls: a thin wasm-bindgen shell over [`lpr_core`].
//!
//! Every exported function forwards to plain Rust, so that the crate is tested natively.

use lpr_core::robot::ROBOTS;
use wasm_bindgen::prelude::wasm_bindgen;

/// Version of this build, as in `lpr --version`.
#[must_use]
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_owned()
}

/// Names of the built-in robots; the first is the default.
#[must_use]
#[wasm_bindgen]
pub fn robots() -> Vec<String> {
    ROBOTS.iter().map(|robot| robot.name.to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_has_three_numbers() {
        let numbers: Vec<u32> = version().split('.').map(|part| part.parse().unwrap()).collect();
        assert_eq!(numbers.len(), 3);
    }

    #[test]
    fn the_default_robot_comes_first() {
        assert_eq!(robots()[0], "xarm7");
    }
}
