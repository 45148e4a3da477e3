//! The simulator as an [`Environment`]: one task, one robot, one scene after the other.

mod control;
mod macro_action;
mod views;

pub use control::ControlAction;
pub(super) use macro_action::Until;

use super::demo_plan::DemoPlan;
use super::observing::Drawing;
use super::placement::{PlacedTask, Rejected, place};
use super::scene::{BodyKind, SceneSpec};
use super::tasks::{Task, TaskScene};
use super::world::{Grasp, SimParams, World};
use crate::env::{EPISODE_LENGTH, Environment, StepResult};
use crate::error::{Error, Result};
use crate::path::{JointPath, TimingSettings};
use crate::perception::{Camera, Observation, Proprio, time_feature};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{Gripper, JointConfig, Robot};
use crate::scene::{Held, Scene, observed_obstacles};
use glamx::Pose3;
use std::sync::Arc;

/// Physics steps for the scene to settle after a reset.
const SETTLE_STEPS: usize = 10;
/// One task with one robot in the simulator. A clone is a snapshot.
#[derive(Debug, Clone)]
pub struct SimEnvironment {
    task: Arc<Task>,
    variation: usize,
    robot: Arc<Robot>,
    params: SimParams,
    timing: TimingSettings,
    cameras: Arc<[String]>,
    world: World,
    plan: Arc<DemoPlan>,
    rejected_placements: u64,
    step: usize,
    drawing: Drawing,
}

impl SimEnvironment {
    /// The task in its scene `seed`, seen by `cameras` (names of [`Camera::by_name`]).
    ///
    /// # Errors
    ///
    /// When a camera is unknown or the scene cannot be placed.
    pub fn new(
        task: &Arc<Task>,
        robot: &Arc<Robot>,
        seed: u64,
        cameras: &[&str],
        params: &SimParams,
    ) -> Result<Self> {
        Self::of_variation(task, 0, robot, seed, cameras, params)
    }

    /// As [`Self::new`], of another variation than the first; a reset keeps to it.
    ///
    /// # Errors
    ///
    /// When there is no such variation, a camera is unknown or the scene cannot be placed.
    pub fn of_variation(
        task: &Arc<Task>,
        variation: usize,
        robot: &Arc<Robot>,
        seed: u64,
        cameras: &[&str],
        params: &SimParams,
    ) -> Result<Self> {
        for camera in cameras {
            Camera::by_name(camera, robot, &Pose3::IDENTITY)?;
        }
        let placed = place(task, variation, robot, seed)?;
        let cameras = cameras.iter().map(|camera| (*camera).to_owned()).collect();
        Ok(Self { variation, cameras, ..Self::of(Arc::clone(task), robot, placed, params)? })
    }

    /// The scene of an episode that was recorded: `spec` as it was placed, without cameras and
    /// without a demonstrator.
    ///
    /// # Errors
    ///
    /// When its task is unknown or the scene cannot be built.
    pub fn in_scene(spec: SceneSpec, robot: &Arc<Robot>, params: &SimParams) -> Result<Self> {
        spec.check()?;
        let task = Task::by_name(&spec.task)?;
        let scene = TaskScene { spec, waypoints: Vec::new() };
        let placed = PlacedTask {
            scene,
            frame: Pose3::IDENTITY,
            plan: DemoPlan::none(),
            rejected: Rejected::default(),
        };
        Self::of(task, robot, placed, params)
    }

    /// A placed task without cameras.
    fn of(
        task: Arc<Task>,
        robot: &Arc<Robot>,
        PlacedTask { scene, plan, rejected, .. }: PlacedTask,
        params: &SimParams,
    ) -> Result<Self> {
        robot.workspace_center()?;
        let world = settled(World::new(Arc::new(scene.spec), robot, robot.start, params)?);
        let drawing = Drawing::new(&world)?;
        Ok(Self {
            task,
            variation: 0,
            robot: Arc::clone(robot),
            params: params.clone(),
            timing: TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 },
            cameras: Arc::default(),
            world,
            plan: Arc::new(plan),
            rejected_placements: rejected.total(),
            step: 0,
            drawing,
        })
    }

    /// Times paths with other settings from now on.
    pub fn set_timing(&mut self, timing: TimingSettings) {
        self.timing = timing;
    }

    /// Settings that paths are timed with.
    #[must_use]
    pub fn timing(&self) -> &TimingSettings {
        &self.timing
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &Arc<Task> {
        &self.task
    }

    /// Index of the task's variation.
    #[must_use]
    pub fn variation(&self) -> usize {
        self.variation
    }

    /// The world behind the observations.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The demonstration that is planned in this scene.
    #[must_use]
    pub fn plan(&self) -> &DemoPlan {
        &self.plan
    }

    /// This episode with a demonstrator that goes to `goals`, one for each of its waypoints; `None`
    /// when the arm cannot do that.
    #[must_use]
    pub fn with_goals(&self, goals: &[NextBestPose], rng: &mut Rng) -> Option<Self> {
        let plan = self.plan.with_goals(&self.robot, &self.robot.start, goals, rng)?;
        Some(Self { plan: Arc::new(plan), ..self.clone() })
    }

    /// This episode in a world where friction alone holds what the hand closes on; nothing is
    /// attached to it.
    ///
    /// # Errors
    ///
    /// As [`World::new`].
    pub fn with_friction_grasps(&self) -> Result<Self> {
        let mut spec = self.world.spec().clone();
        for body in spec.bodies.iter_mut().filter(|body| body.kind == BodyKind::Graspable) {
            body.kind = BodyKind::Dynamic;
        }
        let world =
            settled(World::new(Arc::new(spec), &self.robot, self.robot.start, &self.params)?);
        Ok(Self { world, step: 0, ..self.clone() })
    }

    /// Placements drawn and rejected before this scene's.
    #[must_use]
    pub fn rejected_placements(&self) -> u64 {
        self.rejected_placements
    }

    /// Macro actions done in this episode.
    #[must_use]
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// This scene at its start, with the arm at `config` instead of its start configuration.
    ///
    /// # Errors
    ///
    /// As [`World::new`].
    pub fn around(&self, config: JointConfig) -> Result<Self> {
        let spec = Arc::new(self.world.spec().clone());
        let world = settled(World::new(spec, &self.robot, config, &self.params)?);
        Ok(Self { world, step: 0, ..self.clone() })
    }

    /// This episode with its world as in `world`, after `step` macro actions.
    #[must_use]
    pub fn at(&self, world: World, step: usize) -> Self {
        Self { world, step, ..self.clone() }
    }

    /// This episode with its world as in the snapshot, after `step` macro actions: [`Self::at`] for
    /// bytes.
    ///
    /// # Errors
    ///
    /// As [`World::from_bytes`], and when the snapshot is of another scene.
    pub fn at_snapshot(&self, bytes: &[u8], step: usize) -> Result<Self> {
        let world = World::from_bytes(bytes, self.world().robot())?;
        if world.spec() != self.world().spec() {
            let task = &world.spec().task;
            return Err(Error::Snapshot(format!(
                "of another scene than this episode's, of the task `{task}`"
            )));
        }
        Ok(self.at(world, step))
    }

    /// Obstacles that the cameras see in the scene, with the contact rule for `goal`
    /// (`world_from_grip`).
    #[must_use]
    pub fn obstacles(&mut self, goal: Option<&Pose3>) -> Scene {
        let holding = match self.world.grasp() {
            Grasp::Nothing => Held::Nothing,
            Grasp::Pinched | Grasp::Attached { .. } => Held::Object,
        };
        let observation = self.observe();
        observed_obstacles(&self.robot, &observation, goal, holding)
    }

    /// The report of cameras and arm now; a simulator never fails.
    #[must_use]
    pub fn observe(&mut self) -> Observation {
        let cameras = Arc::clone(&self.cameras);
        let views = cameras.iter().map(|camera| self.view(camera)).collect();
        Observation { views, proprio: self.proprio() }
    }

    /// The arm's part of an observation.
    #[must_use]
    pub fn proprio(&self) -> Proprio {
        let width = self.world.gripper_width();
        Proprio {
            joints: *self.world.config(),
            gripper_width: width,
            gripper_open: Proprio::openness(width, self.world.gripper_spec().max_width),
            finger_positions: [0.5 * width; 2],
            grip: self.robot.grip(self.world.config()),
            time: time_feature(self.step, EPISODE_LENGTH),
        }
    }
}

/// Lets the scene come to rest; the arm stands still.
fn settled(mut world: World) -> World {
    let config = *world.config();
    for _ in 0..SETTLE_STEPS {
        // An arm that touches something has no reason not to be where it is: in its start posture
        // nothing does, and elsewhere it was measured there.
        let _ = world.step(&config);
    }
    world
}

impl Environment for SimEnvironment {
    fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    fn reset(&mut self, seed: u64) -> Result<()> {
        let placed = place(&self.task, self.variation, &self.robot, seed)?;
        let fresh = Self::of(Arc::clone(&self.task), &self.robot, placed, &self.params)?;
        let sensing = self.sensing().cloned();
        *self = Self {
            variation: self.variation,
            timing: self.timing.clone(),
            cameras: Arc::clone(&self.cameras),
            ..fresh
        };
        if let Some(sensing) = sensing {
            self.set_sensing(sensing, seed);
        }
        Ok(())
    }

    fn observe(&mut self) -> Result<Observation> {
        Ok(Self::observe(self))
    }

    fn step(&mut self, path: &JointPath, gripper: Gripper) -> Result<StepResult> {
        Ok(Self::step(self, path, gripper))
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        self.plan.goals.get(self.step).copied()
    }
}
