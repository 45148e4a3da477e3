//! Functions for JavaScript: a thin wasm-bindgen shell over [`lpr_core`].
//!
//! Everything that it does is plain Rust that is tested natively: [`planner`], [`trajectory`], with the
//! feature `files` [`arm_file`] and, with the feature `page`, [`demo`] and [`check`]. The shell turns values into what JavaScript
//! takes: typed arrays for poses, JSON for the rest.
//!
//! Without the feature `page` it is a planner alone, without networks and simulator:
//! `lpr-wasm/build.sh plan`, and `files` with arms from URDF files.

#[cfg(feature = "files")]
pub mod arm_file;
#[cfg(feature = "page")]
pub mod check;
#[cfg(feature = "page")]
pub mod demo;
#[cfg(feature = "page")]
mod page;
#[cfg(feature = "page")]
pub mod plan;
pub mod planner;
#[cfg(feature = "page")]
pub mod scene;
pub mod trajectory;

#[cfg(feature = "page")]
pub use page::{CandidatesBench, Demo, Execution, PhysicsBench, Picture, demonstration_hash};

use serde::Serialize;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// Version of this build, as in `lpr --version`.
#[must_use]
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_owned()
}

/// Makes a panic say where it was, in the browser's console.
#[cfg(target_arch = "wasm32")]
#[wasm_bindgen(start)]
pub fn start() {
    console_error_panic_hook::set_once();
}

/// An arm among obstacles: [`planner::Planner`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct Planner(planner::Planner);

#[wasm_bindgen]
impl Planner {
    /// The arm called `robot` among [`planner::Obstacles`] as JSON.
    ///
    /// # Errors
    ///
    /// As [`planner::Planner::new`], and when the JSON is none.
    #[wasm_bindgen(constructor)]
    pub fn new(robot: &str, obstacles: &str) -> Result<Self, JsError> {
        Ok(Self(planner::Planner::new(robot, &serde_json::from_str(obstacles)?)?))
    }

    /// [`planner::Planner::configurations`] for a [`planner::Request`] as JSON, as JSON.
    ///
    /// # Errors
    ///
    /// As there, and when the JSON is none.
    pub fn configurations(&self, request: &str, n: usize) -> Result<String, JsError> {
        json(&self.0.configurations(&serde_json::from_str(request)?, n)?)
    }

    /// [`planner::Planner::plan`] for a [`planner::Request`] as JSON, as JSON.
    ///
    /// # Errors
    ///
    /// As there, and when the JSON is none.
    pub fn plan(&self, request: &str) -> Result<String, JsError> {
        json(&self.0.plan(&serde_json::from_str(request)?)?)
    }

    /// [`planner::Planner::candidates`] for a [`planner::Request`] as JSON, as JSON.
    ///
    /// # Errors
    ///
    /// As there, and when the JSON is none.
    pub fn candidates(&self, request: &str) -> Result<String, JsError> {
        json(&self.0.candidates(&serde_json::from_str(request)?)?)
    }

    /// [`planner::Planner::trajectory`] for a [`trajectory::TrajectoryRequest`] as JSON, as JSON.
    ///
    /// # Errors
    ///
    /// As there, and when the JSON is none.
    pub fn trajectory(&self, request: &str) -> Result<String, JsError> {
        json(&self.0.trajectory(&serde_json::from_str(request)?)?)
    }
}

/// An arm from a URDF file: [`arm_file::ArmFile`].
#[cfg(feature = "files")]
#[derive(Debug)]
#[wasm_bindgen]
pub struct ArmFile(arm_file::ArmFile);

#[cfg(feature = "files")]
#[wasm_bindgen]
impl ArmFile {
    /// The bytes of the file, and [`arm_file::ArmOptions`] as JSON.
    ///
    /// # Errors
    ///
    /// As [`arm_file::ArmFile::new`], and when the JSON is none.
    #[wasm_bindgen(constructor)]
    pub fn new(urdf: &[u8], options: &str) -> Result<Self, JsError> {
        Ok(Self(arm_file::ArmFile::new(urdf, serde_json::from_str(options)?)?))
    }

    /// [`arm_file::ArmFile::mesh_names`] as JSON.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn mesh_names(&self) -> Result<String, JsError> {
        json(&self.0.mesh_names()?)
    }

    /// [`arm_file::ArmFile::add_mesh`].
    pub fn add_mesh(&mut self, name: &str, bytes: Vec<u8>) {
        self.0.add_mesh(name, bytes);
    }

    /// [`arm_file::ArmFile::summary`] as JSON.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn summary(&self) -> Result<String, JsError> {
        json(&self.0.summary()?)
    }

    /// A planner of the arm among [`planner::Obstacles`] as JSON.
    ///
    /// # Errors
    ///
    /// As [`arm_file::ArmFile::planner`], and when the JSON is none.
    pub fn planner(&self, obstacles: &str) -> Result<Planner, JsError> {
        Ok(Planner(self.0.planner(&serde_json::from_str(obstacles)?)?))
    }
}

fn json(value: &impl Serialize) -> Result<String, JsError> {
    Ok(serde_json::to_string(value)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_has_three_numbers() {
        let numbers: Vec<u32> = version().split('.').map(|part| part.parse().unwrap()).collect();
        assert_eq!(numbers.len(), 3);
    }
}
