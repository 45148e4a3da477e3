//! JSON of poses, configurations, demonstrations and tasks, as every command and the API read and
//! print them.

use crate::files::{self, FileError, Result};
use lpr_core::glamx::{DPose3, DQuat, DVec3};
use lpr_core::perception::Proprio;
use lpr_core::robot::{DOF, JointConfig};
use lpr_core::sim::tasks::{TASKS, Task, TaskSet};
use lpr_core::sim::{Demonstration, World};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use utoipa::ToSchema;

/// Greatest difference of the norm of a quaternion in a file from 1: it covers numbers with three
/// decimals.
const NORM_TOLERANCE: f64 = 2e-3;

/// The tasks.
#[derive(Debug, Serialize, ToSchema)]
pub struct TaskList {
    /// In the order of the paper.
    pub tasks: Vec<TaskRow>,
}

/// A task.
#[derive(Debug, Serialize, ToSchema)]
pub struct TaskRow {
    /// Its name in commands and jobs.
    pub name: &'static str,
    /// The paper's Task Set.
    pub set: &'static str,
    /// The robot's task in words.
    pub description: String,
    /// Names of its variations; none when there is only one.
    pub variations: &'static [String],
    /// Keyframes of a demonstration.
    pub keyframes: usize,
}

impl TaskList {
    /// All tasks.
    #[must_use]
    pub fn all() -> Self {
        let row = |task: &'static Arc<Task>| TaskRow {
            name: &task.name,
            set: match task.set {
                TaskSet::One => "1",
                TaskSet::Two => "2",
                TaskSet::Extra => "extra",
            },
            description: task.describe(0),
            variations: &task.variations,
            keyframes: task.keyframes,
        };
        Self { tasks: TASKS.iter().map(row).collect() }
    }
}

/// A pose in the world, which is the base of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseJson {
    /// Metres.
    pub position: [f64; 3],
    /// Unit quaternion with w ≥ 0.
    pub rotation_xyzw: [f64; 4],
}

impl From<DPose3> for PoseJson {
    fn from(pose: DPose3) -> Self {
        let rotation = if pose.rotation.w < 0.0 { -pose.rotation } else { pose.rotation };
        Self { position: pose.translation.to_array(), rotation_xyzw: rotation.to_array() }
    }
}

/// A pose for inverse kinematics.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseQuery {
    /// `world_from_flange`.
    pub world_from_flange: DPose3,
    /// Configuration at which the search for a solution starts: one number for each joint,
    /// unchecked.
    pub seed_config: Option<Vec<f64>>,
}

/// Reads `{"configs": [[q…]…]}`, radians; how many numbers a configuration has is unchecked.
///
/// # Errors
///
/// When the file is missing or malformed, naming the configuration at fault.
pub fn read_configs(path: &Path) -> Result<Vec<Vec<f64>>> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct ConfigsFile {
        configs: Vec<Vec<f64>>,
    }
    files::read_json(path).map(|ConfigsFile { configs }| configs)
}

/// Reads `{"poses": [{"position": [3], "rotation_xyzw": [4], "seed_config": [q…]?}]}`.
///
/// # Errors
///
/// When the file is missing or malformed, naming the pose at fault.
pub fn read_poses(path: &Path) -> Result<Vec<PoseQuery>> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct PosesFile {
        poses: Vec<PoseEntry>,
    }
    let PosesFile { poses } = files::read_json(path)?;
    poses.into_iter().enumerate().map(|(idx, entry)| entry.checked(path, idx)).collect()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseEntry {
    position: [f64; 3],
    rotation_xyzw: [f64; 4],
    seed_config: Option<Vec<f64>>,
}

impl PoseEntry {
    fn checked(self, path: &Path, idx: usize) -> Result<PoseQuery> {
        let rotation = unit_quaternion(self.rotation_xyzw).map_err(|reason| {
            FileError::content(path, format!("poses[{idx}].rotation_xyzw: {reason}"))
        })?;
        let world_from_flange = DPose3::from_parts(DVec3::from_array(self.position), rotation);
        Ok(PoseQuery { world_from_flange, seed_config: self.seed_config })
    }
}

/// The rotation of a quaternion in a file, or what is wrong with it.
pub(crate) fn unit_quaternion(xyzw: [f64; 4]) -> core::result::Result<DQuat, String> {
    let rotation = DQuat::from_array(xyzw);
    let norm = rotation.length();
    if (norm - 1.0).abs() <= NORM_TOLERANCE {
        Ok(rotation.normalize())
    } else {
        Err(format!("has norm {norm}, expected a unit quaternion"))
    }
}

/// Version of [`DemoFile`].
pub const DEMO_VERSION: u32 = 1;

/// A demonstration, `NAME.demo.json.gz`. Simulated ones hold no observations: those are rendered
/// again from the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DemoFile {
    /// [`DEMO_VERSION`].
    pub version: u32,
    /// Who demonstrated.
    pub source: DemoSource,
    /// Name of the arm.
    pub robot: String,
    /// Name of the task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    /// Seed of the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_seed: Option<u64>,
    /// Time from one frame to the next, seconds; a gripper command takes one frame, however long it
    /// lasts.
    pub control_dt: f32,
    /// True if the task was done.
    pub success: bool,
    /// The arm at every control step.
    pub frames: Vec<DemoFrameJson>,
}

/// Who made a demonstration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DemoSource {
    /// The scripted demonstrator.
    Scripted,
    /// A person at the demo page.
    Page,
    /// A person at the arm.
    Arm,
}

/// The arm in one frame of a demonstration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DemoFrameJson {
    /// Joint angles, radians.
    pub q: JointConfig,
    /// Joint velocities, rad/s.
    pub qd: [f32; DOF],
    /// True if the gripper counts as open.
    pub gripper_open: bool,
    /// Distance between the pads, metres.
    pub gripper_width: f32,
}

impl DemoFile {
    /// A scripted demonstration in scene `scene_seed`.
    #[must_use]
    pub fn scripted(demo: &Demonstration, scene_seed: u64) -> Self {
        let first = &demo.frames[0];
        let control_dt = first.params().control_dt;
        let nexts = demo.frames.iter().skip(1).chain(demo.frames.last());
        Self {
            version: DEMO_VERSION,
            source: DemoSource::Scripted,
            robot: first.robot().name.clone(),
            task: Some(first.spec().task.clone()),
            scene_seed: Some(scene_seed),
            control_dt,
            success: demo.success,
            frames: demo
                .frames
                .iter()
                .zip(nexts)
                .map(|(frame, next)| DemoFrameJson::new(frame, next, control_dt))
                .collect(),
        }
    }
}

impl DemoFrameJson {
    /// The arm in `world`; its velocities from where it is in `next`, so that an arm that waits for
    /// its gripper has none.
    fn new(world: &World, next: &World, control_dt: f32) -> Self {
        let (q, width) = (*world.config(), world.gripper_width());
        Self {
            q,
            qd: core::array::from_fn(|joint| (next.config()[joint] - q[joint]) / control_dt),
            gripper_open: Proprio::openness(width, world.gripper_spec().max_width) > 0.5,
            gripper_width: width,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_tests::mistake;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::fs;

    const POSES: &str = r#"{"poses": [
  {"position": [0.4, 0.1, 0.2], "rotation_xyzw": [1, 0, 0, 0], "seed_config": [0, 0.5, 0]},
  {"position": [0.4, -0.1, 0.2], "rotation_xyzw": [0.6, 0, 0.8, 0]}
]}
"#;

    const CONFIGS: &str = "{\"configs\": [\n  [0, -0.5, 1e-3],\n  [1, 2, 3]\n]}\n";

    /// The value that `read` makes of a file, or its error after the file's path.
    fn read_file<T>(text: &[u8], read: impl Fn(&Path) -> Result<T>) -> Result<T, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(&path, text).unwrap();
        read(&path).map_err(|error| {
            let error = error.to_string();
            error
                .strip_prefix(&format!("{}: ", path.display()))
                .unwrap_or_else(|| panic!("{error}"))
                .to_owned()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn poses_with_one_mistake_are_poses_or_a_message_that_says_where(mistake in mistake()) {
            match read_file(&mistake.made_in(POSES.as_bytes()), read_poses) {
                Ok(poses) => prop_assert!(poses.iter().all(|pose| pose.world_from_flange.is_finite())),
                Err(message) => prop_assert!(message.contains("poses") || message.contains("line "), "{message}"),
            }
        }

        #[test]
        fn configurations_with_one_mistake_are_numbers_or_a_message_that_says_where(mistake in mistake()) {
            if let Err(message) = read_file(&mistake.made_in(CONFIGS.as_bytes()), read_configs) {
                prop_assert!(message.contains("configs") || message.contains("line "), "{message}");
            }
        }

        #[test]
        fn arbitrary_bytes_are_a_message(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(read_file(&bytes, read_poses).is_err_and(|message| message.contains("line ")));
            prop_assert!(read_file(&bytes, read_configs).is_err_and(|message| message.contains("line ")));
        }
    }
}
