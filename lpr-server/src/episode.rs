//! Episode files, `NAME.episode.json.gz`: what was decided in one episode, and all that is needed
//! to run it again.

use crate::files::{self, FileError, Result};
use crate::formats::PoseJson;
use lpr_core::agent::{Action, Agent};
use lpr_core::env::{EPISODE_LENGTH, Environment as _, StepResult};
use lpr_core::evaluate::{RecordedStep, record_episode};
use lpr_core::glamx::DPose3;
use lpr_core::path::{CandidatePath, JointPath, RejectedPath, TimingSettings};
use lpr_core::robot::{Gripper, JointConfig, Robot};
use lpr_core::sim::{SceneSpec, SimEnvironment, SimParams, World};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Version of [`EpisodeFile`].
pub const EPISODE_VERSION: u32 = 1;

/// An episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpisodeFile {
    /// [`EPISODE_VERSION`].
    pub version: u32,
    /// Name of the arm.
    pub robot: String,
    /// The scene as it was placed.
    pub scene: SceneSpec,
    /// Its seed.
    pub scene_seed: u64,
    /// Settings of the world.
    pub simulator: SimParams,
    /// Speed of the arm.
    pub timing: TimingSettings,
    /// The macro actions.
    pub steps: Vec<EpisodeStep>,
    /// [`World::hash`] at the end, 16 hexadecimal digits.
    pub world_hash: String,
}

/// A macro action with everything that it was chosen from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpisodeStep {
    /// The next-best pose: `world_from_grip`.
    pub goal: PoseJson,
    /// The candidates, then the draws that gave none.
    pub candidates: Vec<EpisodeCandidate>,
    /// Index of the candidate that ran; none when there was none.
    pub chosen: Option<usize>,
    /// The gripper's command at the end of the path.
    pub gripper: Gripper,
    /// 1 when the task was done.
    pub reward: f32,
    /// Reason why the action ended early.
    pub invalid: Option<String>,
}

/// A candidate, or a draw that gave none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpisodeCandidate {
    /// Which generator made it.
    pub source: String,
    /// The configurations, radians; none of a rejected draw.
    pub q: Option<Vec<JointConfig>>,
    /// The ranker's value, if there was a ranker.
    pub value: Option<f32>,
    /// True if the path meets the scene.
    pub collides: Option<bool>,
    /// Reason why the draw gave no candidate.
    pub rejected: Option<String>,
}

/// Result of running an episode again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Replayed {
    /// True if every reward and the world at the end are those of the file, bit by bit.
    pub identical: bool,
    /// Hash of the world at the end.
    pub world_hash: String,
}

impl EpisodeFile {
    /// The greedy episode of `agent` in scene `scene_seed`; the environment is left at its end.
    ///
    /// # Errors
    ///
    /// When the scene cannot be built, or a network's answer is not a number.
    pub fn record(
        agent: &Agent,
        environment: &mut SimEnvironment,
        scene_seed: u64,
    ) -> lpr_core::Result<Self> {
        let steps = record_episode(agent, environment, scene_seed)?;
        let world = environment.world();
        Ok(Self {
            version: EPISODE_VERSION,
            robot: environment.robot().name.clone(),
            scene: world.spec().clone(),
            scene_seed,
            simulator: world.params().clone(),
            timing: environment.timing().clone(),
            steps: steps
                .iter()
                .map(|RecordedStep { action, result }| EpisodeStep::new(action, result))
                .collect(),
            world_hash: hex(world.hash()),
        })
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_json(path, self)
    }

    /// Reads a file and checks what no type checks, so that it can be run again.
    ///
    /// # Errors
    ///
    /// When the file is missing, corrupt, foreign or newer than this program: one line that names
    /// the file and the field.
    pub fn read(path: &Path) -> Result<Self> {
        let episode: Self = files::read_versioned_json(path, EPISODE_VERSION)?;
        episode.check().map_err(|reason| FileError::content(path, reason))?;
        Ok(episode)
    }

    fn check(&self) -> Result<(), String> {
        Robot::by_name(&self.robot).map_err(|error| format!("robot: {error}"))?;
        self.scene.check().map_err(|error| format!("scene: {error}"))?;
        self.check_numbers()?;
        if self.steps.is_empty() || self.steps.len() > EPISODE_LENGTH {
            return Err(format!(
                "steps: expected 1 to {EPISODE_LENGTH}, found {}",
                self.steps.len()
            ));
        }
        self.steps.iter().enumerate().try_for_each(|(idx, step)| {
            step.check().map_err(|reason| format!("steps[{idx}].{reason}"))
        })
    }

    /// Numbers with which the world would never end, or not move at all.
    fn check_numbers(&self) -> Result<(), String> {
        let (simulator, timing) = (&self.simulator, &self.timing);
        let rules = [
            ((1e-4..=0.1).contains(&simulator.dt), "simulator.dt: expected 0.0001 to 0.1 s"),
            (
                (simulator.dt..=1.0).contains(&simulator.control_dt),
                "simulator.control_dt: expected dt to 1 s",
            ),
            (
                (1..=1000).contains(&simulator.solver_iterations),
                "simulator.solver_iterations: expected 1 to 1000",
            ),
            (
                (0.01..=100.0).contains(&timing.max_velocity),
                "timing.max_velocity: expected 0.01 to 100 rad/s",
            ),
            (
                (0.01..=1000.0).contains(&timing.max_acceleration),
                "timing.max_acceleration: expected 0.01 to 1000 rad/s²",
            ),
        ];
        rules.iter().find(|(holds, _)| !holds).map_or(Ok(()), |(_, rule)| Err((*rule).to_owned()))
    }

    /// The arm.
    ///
    /// # Errors
    ///
    /// When there is none of that name.
    pub fn robot(&self) -> lpr_core::Result<Arc<Robot>> {
        Robot::by_name(&self.robot)
    }

    /// The world before the first step.
    ///
    /// # Errors
    ///
    /// When the scene cannot be built.
    pub fn start(&self) -> lpr_core::Result<SimEnvironment> {
        let mut environment =
            SimEnvironment::in_scene(self.scene.clone(), &self.robot()?, &self.simulator)?;
        environment.set_timing(self.timing.clone());
        Ok(environment)
    }

    /// Runs the chosen paths again; `on_world` sees the index of the step and the world after every
    /// control step.
    ///
    /// # Errors
    ///
    /// When the scene cannot be built.
    pub fn replay(&self, mut on_world: impl FnMut(usize, &World)) -> lpr_core::Result<Replayed> {
        let mut environment = self.start()?;
        let mut same_rewards = true;
        for (idx, step) in self.steps.iter().enumerate() {
            let Some(path) = step.chosen_path()? else { continue };
            let result =
                environment.step_recorded(&path, step.gripper, |world| on_world(idx, world));
            same_rewards &= result.reward == step.reward;
        }
        let world_hash = hex(environment.world().hash());
        Ok(Replayed { identical: same_rewards && world_hash == self.world_hash, world_hash })
    }
}

impl EpisodeStep {
    fn new(action: &Action, result: &StepResult) -> Self {
        let value = |idx: usize| action.values.as_ref().and_then(|values| values.get(idx)).copied();
        let admitted = action.set.candidates.iter().enumerate();
        let admitted =
            admitted.map(|(idx, candidate)| EpisodeCandidate::admitted(candidate, value(idx)));
        let rejected = action.set.rejected.iter().map(EpisodeCandidate::rejected);
        Self {
            goal: PoseJson::from(DPose3::from(action.goal.pose)),
            candidates: admitted.chain(rejected).collect(),
            chosen: action.chosen,
            gripper: action.goal.gripper,
            reward: result.reward,
            invalid: result.invalid.map(|invalid| invalid.name().to_owned()),
        }
    }

    fn check(&self) -> Result<(), String> {
        for (idx, candidate) in self.candidates.iter().enumerate() {
            if candidate.q.is_some() == candidate.rejected.is_some() {
                return Err(format!("candidates[{idx}]: expected either q or rejected"));
            }
            candidate.path().map_err(|error| format!("candidates[{idx}].q: {error}"))?;
        }
        match self.chosen {
            Some(chosen)
                if self.candidates.get(chosen).is_none_or(|candidate| candidate.q.is_none()) =>
            {
                Err(format!("chosen: {chosen} is no candidate with a path"))
            }
            _ => Ok(()),
        }
    }

    /// The path that ran.
    ///
    /// # Errors
    ///
    /// When it has fewer than two configurations, or one that is not finite.
    pub fn chosen_path(&self) -> lpr_core::Result<Option<JointPath>> {
        self.chosen
            .and_then(|chosen| self.candidates.get(chosen))
            .map_or(Ok(None), EpisodeCandidate::path)
    }
}

impl EpisodeCandidate {
    fn admitted(candidate: &CandidatePath, value: Option<f32>) -> Self {
        Self {
            source: candidate.source.name().to_owned(),
            q: Some(candidate.path.configs().to_vec()),
            value,
            collides: Some(candidate.collides),
            rejected: None,
        }
    }

    fn rejected(rejected: &RejectedPath) -> Self {
        let reason = Some(rejected.reason.name().to_owned());
        Self {
            source: rejected.source.name().to_owned(),
            q: None,
            value: None,
            collides: None,
            rejected: reason,
        }
    }

    /// The path; none of a rejected draw.
    ///
    /// # Errors
    ///
    /// When it has fewer than two configurations, or one that is not finite.
    pub fn path(&self) -> lpr_core::Result<Option<JointPath>> {
        self.q.clone().map(JointPath::new).transpose()
    }
}

fn hex(hash: u64) -> String {
    format!("{hash:016x}")
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use lpr_core::agent::{Init, Method, Networks, PoseSource};
    use lpr_core::config::Config;
    use lpr_core::nn::Backend;
    use lpr_core::robot::XARM7;
    use lpr_core::sim::tasks::Task;

    /// An episode of an agent without networks.
    pub(crate) fn episode(task: &str, seed: u64) -> EpisodeFile {
        let mut config = Config::preset("fast").unwrap();
        config.candidates.planner_paths = 3;
        config.candidates.bezier_paths = 3;
        let init = Init { backend: Backend::Flex, seed: 0 };
        let networks = Networks::new(
            config.network_settings(),
            &XARM7,
            Method::ShortestFree,
            PoseSource::Oracle,
            init,
        )
        .unwrap();
        let agent = Agent::new(config.agent_settings(), &XARM7, Method::ShortestFree, networks);
        let task = Task::by_name(task).unwrap();
        let mut environment =
            SimEnvironment::new(&task, &XARM7, seed, &["front"], &config.simulator).unwrap();
        environment.set_timing(config.timing.clone());
        EpisodeFile::record(&agent, &mut environment, seed).unwrap()
    }

    #[test]
    fn a_file_reads_back_as_it_was_and_runs_again_bit_by_bit() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.episode.json.gz");
        for task in ["reach_target", "open_drawer"] {
            let written = episode(task, 3);
            written.write(&path).unwrap();
            let read = EpisodeFile::read(&path).unwrap();
            assert_eq!(read, written);
            let replayed = read.replay(|_, _| {}).unwrap();
            assert_eq!(replayed, Replayed { identical: true, world_hash: written.world_hash });
        }
    }

    #[test]
    fn what_differs_is_not_identical() {
        let mut changed = episode("reach_target", 4);
        changed.steps[0].reward = 1.0 - changed.steps[0].reward;
        assert!(!changed.replay(|_, _| {}).unwrap().identical);
        let mut changed = episode("reach_target", 4);
        changed.steps[0].chosen = (0..2).find(|idx| Some(*idx) != changed.steps[0].chosen);
        assert!(!changed.replay(|_, _| {}).unwrap().identical);
    }

    #[test]
    fn corrupt_foreign_and_newer_files_are_one_error_that_names_them() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.episode.json.gz");
        let good = episode("reach_target", 5);
        let refusal = |change: &dyn Fn(&mut EpisodeFile)| {
            let mut broken = good.clone();
            change(&mut broken);
            broken.write(&path).unwrap();
            let error = EpisodeFile::read(&path).unwrap_err().to_string();
            error.strip_prefix(&format!("{}: ", path.display())).unwrap().to_owned()
        };
        assert!(
            refusal(&|file| file.version = 2)
                .contains("version: 2 is unknown, this program reads version 1")
        );
        assert!(refusal(&|file| file.robot = "ur5".to_owned()).starts_with("robot: "));
        assert!(refusal(&|file| file.scene.bodies[0].mass = -1.0).starts_with("scene: "));
        assert_eq!(
            refusal(&|file| file.steps[0].chosen = Some(999)),
            "steps[0].chosen: 999 is no candidate with a path"
        );
        assert!(
            refusal(&|file| file.steps[0].candidates[0].q = Some(Vec::new()))
                .starts_with("steps[0].candidates[0].q: ")
        );
        assert!(refusal(&|file| file.steps.clear()).starts_with("steps: expected 1 to 10"));
        assert!(refusal(&|file| file.simulator.dt = 0.0).starts_with("simulator.dt"));
        good.write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(
            EpisodeFile::read(&path)
                .unwrap_err()
                .to_string()
                .starts_with(&path.display().to_string())
        );
        std::fs::write(&path, b"no gzip").unwrap();
        assert!(
            EpisodeFile::read(&path)
                .unwrap_err()
                .to_string()
                .starts_with(&path.display().to_string())
        );
    }
}
