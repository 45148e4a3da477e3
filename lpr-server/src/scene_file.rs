//! Scene files, `NAME.scene.json`: a scene as it was placed, to look at, change and use again.

use crate::files::{self, FileError, Result};
use lpr_core::robot::Robot;
use lpr_core::sim::{SceneSpec, SimEnvironment, SimParams};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of [`SceneFile`].
pub const SCENE_VERSION: u32 = 1;

/// A scene, and the arm that stands in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// [`SCENE_VERSION`].
    pub version: u32,
    /// Name of the arm.
    pub robot: String,
    /// The scene in the world, which is the base of the arm.
    pub scene: SceneSpec,
}

impl SceneFile {
    /// The scene at the start of an episode.
    #[must_use]
    pub fn of(environment: &SimEnvironment) -> Self {
        let world = environment.world();
        Self {
            version: SCENE_VERSION,
            robot: world.robot().name.clone(),
            scene: world.spec().clone(),
        }
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_json(path, self)
    }

    /// Reads a file and checks what no type checks, so that the scene can be built.
    ///
    /// # Errors
    ///
    /// When the file is missing, corrupt, foreign or newer than this program: one line that names
    /// the file and the field.
    pub fn read(path: &Path) -> Result<Self> {
        let file: Self = files::read_versioned_json(path, SCENE_VERSION)?;
        let check = Robot::by_name(&file.robot).map_err(|error| format!("robot: {error}"));
        let check =
            check.and_then(|_| file.scene.check().map_err(|error| format!("scene: {error}")));
        check.map_err(|reason| FileError::content(path, reason))?;
        Ok(file)
    }

    /// The scene at rest, with the arm where it starts and without a demonstrator.
    ///
    /// # Errors
    ///
    /// When the robot or the task is unknown, or the scene cannot be built.
    pub fn start(&self) -> lpr_core::Result<SimEnvironment> {
        SimEnvironment::in_scene(
            self.scene.clone(),
            &Robot::by_name(&self.robot)?,
            &SimParams::STANDARD,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_core::robot::ROBOTS;
    use lpr_core::scene::Shape;
    use lpr_core::sim::tasks::{TASKS, Task};
    use serde_json::{Value, json};
    use std::sync::Arc;

    fn scene(task: &Arc<Task>, robot: &Arc<Robot>) -> SimEnvironment {
        SimEnvironment::new(task, robot, 3, &["front"], &SimParams::STANDARD).unwrap()
    }

    #[test]
    fn every_scene_reads_back_and_starts_bit_for_bit_as_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.scene.json");
        for (task, robot) in TASKS.iter().zip(ROBOTS.into_iter().cycle()) {
            let environment = scene(task, robot);
            let written = SceneFile::of(&environment);
            written.write(&path).unwrap();
            let read = SceneFile::read(&path).unwrap();
            assert_eq!(read, written);
            assert_eq!(
                read.start().unwrap().world().hash(),
                environment.world().hash(),
                "{}",
                task.name
            );
        }
    }

    #[test]
    fn a_file_that_cannot_be_built_is_one_error_that_names_the_field() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.scene.json");
        let good = SceneFile::of(&scene(&TASKS[0], ROBOTS[0]));
        let refusal = |change: &dyn Fn(&mut Value)| {
            let mut broken = serde_json::to_value(&good).unwrap();
            change(&mut broken);
            files::write_json(&path, &broken).unwrap();
            let error = SceneFile::read(&path).unwrap_err().to_string();
            error.strip_prefix(&format!("{}: ", path.display())).unwrap().to_owned()
        };
        assert!(refusal(&|file| file["version"] = json!(2)).starts_with("version: 2 is unknown"));
        assert!(refusal(&|file| file["robot"] = json!("ur5")).starts_with("robot: "));
        assert!(
            refusal(&|file| file["scene"]["bodies"][0]["mass"] = json!("heavy"))
                .starts_with("scene.bodies[0].mass: ")
        );
        assert!(
            refusal(&|file| file["scene"]["bodies"][0]["weight"] = json!(1))
                .contains("unknown field `weight`")
        );
        let error = refusal(&|file| file["scene"]["bodies"][0]["mass"] = json!(-1));
        assert!(error.starts_with("scene: ") && error.contains("mass"), "{error}");
        let mut flat = good.clone();
        let points = vec![lpr_core::glamx::Vec3::ZERO; 4];
        flat.scene.bodies[0].parts[0].shape = Shape::Convex { points };
        flat.write(&path).unwrap();
        assert!(
            SceneFile::read(&path).is_err() || SceneFile::read(&path).unwrap().start().is_err()
        );
        let mut unknown = good.clone();
        unknown.scene.task = "make_coffee".to_owned();
        assert!(unknown.start().unwrap_err().to_string().contains("found 'make_coffee'"));
    }
}
