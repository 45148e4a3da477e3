//! One agent in one scene, step by step: what the page shows, in plain Rust.
//!
//! An episode of the page is that of `lpr eval` for the same weights and seed, as long as the best
//! candidate runs.

use crate::plan::Plan;
use crate::scene::SceneView;
use lpr_core::agent::{Action, Agent, Draws, Eyes};
use lpr_core::checkpoint::{SavedAgent, load_agent};
use lpr_core::env::{Environment as _, StepResult};
use lpr_core::error::{Error, Result};
use lpr_core::glamx::Pose3;
use lpr_core::path::{CandidatePath, CandidateStreams};
use lpr_core::perception::Camera;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{SimEnvironment, World};
use serde::Serialize;

/// Numbers of a pose in an array: position x y z in metres, then the quaternion x y z w.
pub const POSE_LEN: usize = 7;

/// An agent in a scene.
#[derive(Debug)]
pub struct Demo {
    agent: Agent,
    environment: SimEnvironment,
    seed: u64,
    step: u64,
    action: Option<Action>,
    is_over: bool,
}

/// Result of a macro action: the motion, and its outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Execution {
    /// Poses of every item of the scene after every control step: frames × items × [`POSE_LEN`].
    pub poses: Vec<f32>,
    /// The page's words about it.
    pub outcome: Outcome,
}

/// End of a macro action.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Index of the macro action in its episode.
    pub step: u64,
    /// Seconds of simulated time between two frames.
    pub frame_seconds: f32,
    /// 1 when the task is done.
    pub reward: f32,
    /// True if the episode is over.
    pub ended: bool,
    /// Reason why the action ended early, in words.
    pub invalid: Option<String>,
    /// [`World::hash`] after it, 16 hexadecimal digits.
    pub world_hash: String,
}

impl Demo {
    /// The agent of `weights` (a `weights.safetensors` of `lpr train`) in scene `seed` of its task.
    ///
    /// # Errors
    ///
    /// When the weights are corrupt, foreign or newer than this program, or the scene cannot be
    /// placed.
    pub fn new(weights: &[u8], seed: u64) -> Result<Self> {
        let SavedAgent { header, agent } = load_agent(weights)?;
        let task = Task::by_name(&header.run.task)?;
        let cameras: Vec<_> = header
            .run
            .cameras
            .iter()
            .map(|name| Camera::known_name(name))
            .collect::<Result<_>>()?;
        let mut environment =
            SimEnvironment::new(&task, agent.robot(), seed, &cameras, &header.config.simulator)?;
        environment.set_timing(header.config.timing.clone());
        Ok(Self { agent, environment, seed, step: 0, action: None, is_over: false })
    }

    /// Starts the episode of scene `seed`.
    ///
    /// # Errors
    ///
    /// When the scene cannot be placed; the old one then stays.
    pub fn reset(&mut self, seed: u64) -> Result<()> {
        self.environment.reset(seed)?;
        (self.seed, self.step, self.action, self.is_over) = (seed, 0, None, false);
        Ok(())
    }

    /// Everything that is drawn: every item with its parts.
    #[must_use]
    pub fn scene(&self) -> SceneView {
        SceneView::new(&self.environment, self.seed, &self.agent)
    }

    /// Poses of every item of the scene now: items × [`POSE_LEN`].
    #[must_use]
    pub fn poses(&self) -> Vec<f32> {
        poses(self.environment.world())
    }

    /// The first camera's picture: rows × columns × RGB, and its width and height in pixels.
    #[must_use]
    pub fn picture(&mut self) -> (Vec<u8>, [usize; 2]) {
        let observation = self.environment.observe();
        observation.views.first().map_or((Vec::new(), [0; 2]), |view| {
            (view.rgb.iter().flatten().copied().collect(), [view.camera.width, view.camera.height])
        })
    }

    /// Lines 6 to 12 of Algorithm 1: the next-best pose, the candidates and their values. Asked
    /// twice, it answers the same.
    ///
    /// # Errors
    ///
    /// When the episode is over, or a network's answer is not a number.
    pub fn plan(&mut self) -> Result<Plan> {
        if self.action.is_none() {
            self.action = Some(self.decide()?);
        }
        let action = self.action.as_ref().expect("it was just made");
        Ok(Plan::new(action, self.agent.robot(), self.step))
    }

    fn decide(&mut self) -> Result<Action> {
        if self.is_over {
            return Err(Error::Environment("the episode is over: reset it".to_owned()));
        }
        let streams = CandidateStreams { seed: self.seed, step: self.step };
        self.agent.decide(&mut self.environment, Eyes::Open, Draws::greedy(streams))
    }

    /// Poses of the robot's items along a candidate: configurations × robot items × [`POSE_LEN`].
    ///
    /// # Errors
    ///
    /// When there is no plan or no such candidate.
    pub fn ghost(&self, candidate: usize) -> Result<Vec<f32>> {
        let world = self.environment.world();
        let configs = self.candidate(candidate)?.path.configs();
        Ok(configs.iter().flat_map(|config| flat(world.robot_poses_at(config))).collect())
    }

    /// Runs a candidate of the plan and gives the gripper its command (line 13).
    ///
    /// # Errors
    ///
    /// When there is no plan or no such candidate.
    pub fn execute(&mut self, candidate: usize) -> Result<Execution> {
        let path = self.candidate(candidate)?.path.clone();
        let action = self.action.take().expect("it has the candidate");
        let mut frames = Vec::new();
        let gripper = action.goal.gripper;
        let result =
            self.agent.execute_with(&mut self.environment, Some(&path), |world, path| {
                Ok(world.step_recorded(path, gripper, |world| frames.extend(poses(world))))
            })?;
        // An action that is refused before the arm moves has one frame, too.
        if frames.is_empty() {
            frames = self.poses();
        }
        Ok(Execution { poses: frames, outcome: self.outcome(result) })
    }

    fn outcome(&mut self, result: StepResult) -> Outcome {
        let step = self.step;
        self.step += 1;
        self.is_over = result.is_last();
        let world = self.environment.world();
        Outcome {
            step,
            frame_seconds: world.params().control_dt,
            reward: result.reward,
            ended: self.is_over,
            invalid: result.invalid.map(|invalid| invalid.to_string()),
            world_hash: format!("{:016x}", world.hash()),
        }
    }

    fn candidate(&self, candidate: usize) -> Result<&CandidatePath> {
        let action = self
            .action
            .as_ref()
            .ok_or_else(|| Error::Environment("nothing is planned".to_owned()))?;
        let missing = || Error::Environment(format!("there is no candidate {candidate}"));
        action.set.candidates.get(candidate).ok_or_else(missing)
    }
}

fn poses(world: &World) -> Vec<f32> {
    let scene = world.scene_items().map(|(_, pose, _)| pose);
    flat(scene.chain(world.robot_poses_at(world.config())))
}

fn flat(poses: impl IntoIterator<Item = Pose3>) -> Vec<f32> {
    let numbers =
        |pose: Pose3| pose.translation.to_array().into_iter().chain(pose.rotation.to_array());
    poses.into_iter().flat_map(numbers).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_core::agent::{Method, PoseSource};
    use lpr_core::config::Config;
    use lpr_core::evaluate::record_episode;
    use lpr_core::nn::Backend;
    use lpr_core::robot::XARM7;
    use lpr_core::train::{Run, Trainer};

    const SEED: u64 = 1000;

    /// The weights of an agent that has learned nothing.
    fn weights(poses: PoseSource) -> Vec<u8> {
        let mut config = Config::preset("fast").unwrap();
        config.training.demonstration_updates = 0;
        let run = Run {
            task: "reach_target".to_owned(),
            method: Method::Lpr,
            poses,
            backend: Backend::Flex,
            seed: 0,
            cameras: vec!["front".to_owned()],
        };
        let task = Task::by_name(&run.task).unwrap();
        let environment =
            SimEnvironment::new(&task, &XARM7, SEED, &["front"], &config.simulator).unwrap();
        Trainer::new(config, run, environment).unwrap().checkpoint().unwrap().weights
    }

    fn demo(poses: PoseSource) -> Demo {
        Demo::new(&weights(poses), SEED).unwrap()
    }

    #[test]
    fn an_episode_is_that_of_an_evaluation() {
        for poses in [PoseSource::Learned, PoseSource::Oracle] {
            let SavedAgent { agent, header } = load_agent(&weights(poses)).unwrap();
            let task = Task::by_name(&header.run.task).unwrap();
            let mut environment =
                SimEnvironment::new(&task, agent.robot(), 0, &["front"], &header.config.simulator)
                    .unwrap();
            environment.set_timing(header.config.timing.clone());
            let recorded = record_episode(&agent, &mut environment, SEED).unwrap();
            let mut demo = demo(poses);
            for step in recorded {
                let plan = demo.plan().unwrap();
                let values: Option<Vec<_>> =
                    plan.candidates.iter().map(|candidate| candidate.value).collect();
                assert_eq!((plan.chosen, values), (step.action.chosen, step.action.values));
                let Some(chosen) = plan.chosen else { break };
                let outcome = demo.execute(chosen).unwrap().outcome;
                assert_eq!(
                    (outcome.reward, outcome.ended),
                    (step.result.reward, step.result.terminated || step.result.truncated)
                );
            }
            assert_eq!(demo.environment.world().hash(), environment.world().hash());
        }
    }

    #[test]
    fn every_frame_has_a_pose_for_every_item_and_the_last_is_where_things_are() {
        let mut demo = demo(PoseSource::Oracle);
        let frame_len = demo.scene().items.len() * POSE_LEN;
        assert_eq!(demo.poses().len(), frame_len);
        let chosen = demo.plan().unwrap().chosen.unwrap();
        let n_waypoints = demo.plan().unwrap().candidates[chosen].path.len();
        assert_eq!(
            demo.ghost(chosen).unwrap().len(),
            n_waypoints * demo.scene().n_robot_items * POSE_LEN
        );
        let poses = demo.execute(chosen).unwrap().poses;
        assert!(poses.len() > frame_len && poses.len().is_multiple_of(frame_len));
        assert_eq!(poses[poses.len() - frame_len..], demo.poses());
    }

    #[test]
    fn a_reset_forgets_what_was_done() {
        let mut demo = demo(PoseSource::Oracle);
        let (plan, poses) = (demo.plan().unwrap(), demo.poses());
        demo.execute(0).unwrap();
        assert_ne!(demo.poses(), poses);
        demo.reset(SEED).unwrap();
        assert_eq!((demo.plan().unwrap(), demo.poses()), (plan, poses));
    }

    #[test]
    fn what_is_not_there_is_refused_by_name() {
        let mut demo = demo(PoseSource::Oracle);
        assert!(demo.execute(0).unwrap_err().to_string().contains("nothing is planned"));
        demo.plan().unwrap();
        assert!(demo.ghost(999).unwrap_err().to_string().contains("candidate 999"));
        assert!(demo.execute(999).unwrap_err().to_string().contains("candidate 999"));
        assert!(demo.execute(0).is_ok(), "a refusal changes nothing");
        assert!(Demo::new(b"no weights", 0).is_err());
    }

    #[test]
    fn an_episode_that_is_over_plans_nothing() {
        let mut demo = demo(PoseSource::Oracle);
        while !demo.is_over {
            let chosen = demo.plan().unwrap().chosen.unwrap();
            demo.execute(chosen).unwrap();
        }
        assert!(demo.plan().unwrap_err().to_string().contains("over"));
    }
}
