//! Functions that the demo page calls: an agent in a scene, and the results that are compared
//! between wasm and native code.

use crate::{check, demo, json};
#[cfg(doc)]
use crate::{plan, scene};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// An agent in a scene: [`demo::Demo`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct Demo(demo::Demo);

/// Result of a macro action: [`demo::Execution`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct Execution(demo::Execution);

/// A picture.
#[derive(Debug)]
#[wasm_bindgen]
pub struct Picture {
    rgb: Vec<u8>,
    size: [usize; 2],
}

#[wasm_bindgen]
impl Demo {
    /// The agent of a `weights.safetensors` in scene `seed` of its task.
    ///
    /// # Errors
    ///
    /// As [`demo::Demo::new`].
    #[wasm_bindgen(constructor)]
    pub fn new(weights: &[u8], seed: u32) -> Result<Self, JsError> {
        Ok(Self(demo::Demo::new(weights, u64::from(seed))?))
    }

    /// Starts the episode of scene `seed`.
    ///
    /// # Errors
    ///
    /// As [`demo::Demo::reset`].
    pub fn reset(&mut self, seed: u32) -> Result<(), JsError> {
        Ok(self.0.reset(u64::from(seed))?)
    }

    /// [`scene::SceneView`] as JSON.
    ///
    /// # Errors
    ///
    /// When a number of it has no JSON.
    pub fn scene(&self) -> Result<String, JsError> {
        json(&self.0.scene())
    }

    /// [`demo::Demo::poses`].
    #[must_use]
    pub fn poses(&self) -> Vec<f32> {
        self.0.poses()
    }

    /// [`demo::Demo::picture`].
    #[must_use]
    pub fn picture(&mut self) -> Picture {
        let (rgb, size) = self.0.picture();
        Picture { rgb, size }
    }

    /// [`plan::Plan`] as JSON.
    ///
    /// # Errors
    ///
    /// As [`demo::Demo::plan`].
    pub fn plan(&mut self) -> Result<String, JsError> {
        json(&self.0.plan()?)
    }

    /// [`demo::Demo::ghost`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn ghost(&self, candidate: usize) -> Result<Vec<f32>, JsError> {
        Ok(self.0.ghost(candidate)?)
    }

    /// [`demo::Demo::execute`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn execute(&mut self, candidate: usize) -> Result<Execution, JsError> {
        Ok(Execution(self.0.execute(candidate)?))
    }
}

#[wasm_bindgen]
impl Execution {
    /// [`demo::Execution::poses`].
    #[must_use]
    pub fn poses(&self) -> Vec<f32> {
        self.0.poses.clone()
    }

    /// [`demo::Outcome`] as JSON.
    ///
    /// # Errors
    ///
    /// When a number of it has no JSON.
    pub fn outcome(&self) -> Result<String, JsError> {
        json(&self.0.outcome)
    }
}

#[wasm_bindgen]
impl Picture {
    /// Rows × columns × RGB.
    #[must_use]
    pub fn rgb(&self) -> Vec<u8> {
        self.rgb.clone()
    }

    /// Pixels of a row.
    #[must_use]
    #[wasm_bindgen(getter)]
    pub fn width(&self) -> usize {
        self.size[0]
    }

    /// Rows.
    #[must_use]
    #[wasm_bindgen(getter)]
    pub fn height(&self) -> usize {
        self.size[1]
    }
}

/// [`check::demonstration_hash`].
///
/// # Errors
///
/// As there.
#[wasm_bindgen]
pub fn demonstration_hash(task: &str, robot: &str, seed: u32) -> Result<String, JsError> {
    Ok(check::demonstration_hash(task, robot, u64::from(seed))?)
}

/// [`check::PhysicsBench`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct PhysicsBench(check::PhysicsBench);

#[wasm_bindgen]
impl PhysicsBench {
    /// [`check::PhysicsBench::new`].
    ///
    /// # Errors
    ///
    /// As there.
    #[wasm_bindgen(constructor)]
    pub fn new() -> Result<Self, JsError> {
        Ok(Self(check::PhysicsBench::new()?))
    }

    /// [`check::PhysicsBench::run`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn run(&mut self, n_steps: u32) -> Result<String, JsError> {
        Ok(self.0.run(n_steps)?)
    }
}

/// [`check::CandidatesBench`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct CandidatesBench(check::CandidatesBench);

#[wasm_bindgen]
impl CandidatesBench {
    /// [`check::CandidatesBench::new`].
    ///
    /// # Errors
    ///
    /// As there.
    #[wasm_bindgen(constructor)]
    pub fn new() -> Result<Self, JsError> {
        Ok(Self(check::CandidatesBench::new()?))
    }

    /// [`check::CandidatesBench::run`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn run(&self, step: u32) -> Result<String, JsError> {
        Ok(self.0.run(u64::from(step))?)
    }
}

/// [`check::NetworksBench`].
#[derive(Debug)]
#[wasm_bindgen]
pub struct NetworksBench(check::NetworksBench);

#[wasm_bindgen]
impl NetworksBench {
    /// [`check::NetworksBench::new`].
    ///
    /// # Errors
    ///
    /// As there.
    #[wasm_bindgen(constructor)]
    pub fn new() -> Result<Self, JsError> {
        Ok(Self(check::NetworksBench::new()?))
    }

    /// [`check::NetworksBench::attend`].
    #[must_use]
    pub fn attend(&self) -> f32 {
        self.0.attend()
    }

    /// [`check::NetworksBench::rank`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn rank(&self) -> Result<f32, JsError> {
        Ok(self.0.rank()?)
    }

    /// [`check::NetworksBench::update`].
    pub fn update(&mut self) -> f32 {
        self.0.update()
    }

    /// [`check::NetworksBench::gradients`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn gradients(&mut self) -> Result<Vec<f32>, JsError> {
        Ok(self.0.gradients()?)
    }
}
