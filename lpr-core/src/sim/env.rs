//! The simulator as an [`Environment`].

use super::demonstrator::DemoPlan;
use super::observing::Drawing;
use super::params::SimParams;
use super::placement::{PlacedTask, Rejected, place};
use super::scene_spec::{BodyKind, SceneSpec};
use super::tasks::{Task, TaskScene};
use super::world::{Holding, World};
use crate::env::{EPISODE_LENGTH, Environment, InvalidAction, StepResult};
use crate::error::Result;
use crate::path::{JointPath, TimedPath, TimingSettings};
use crate::perception::{Camera, Observation, Proprio, time_feature};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{Gripper, Robot};
use crate::scene::{self, ObstacleQuery, Scene, obstacle_scene};
use glamx::{Pose3, Vec3};
use std::sync::Arc;

/// Physics steps for the scene to settle after a reset.
const SETTLE_STEPS: usize = 10;
/// Longest time a gripper command may take, seconds: fingers that meet an object off their middle
/// push it along slowly.
const GRIPPER_TIMEOUT_SECS: f32 = 5.0;
/// Longest motion, seconds: a path of many turns would run for hours.
const MOTION_TIMEOUT_SECS: f64 = 120.0;
/// A path must start this close to where the arm is, radians in every joint.
const START_TOLERANCE: f32 = 1e-3;

/// One task with one robot in the simulator. A clone is a snapshot.
#[derive(Debug, Clone)]
pub struct SimEnvironment {
    task: &'static Task,
    variation: usize,
    pub(super) robot: Arc<Robot>,
    params: SimParams,
    timing: TimingSettings,
    cameras: Vec<&'static str>,
    pub(super) world: World,
    plan: Arc<DemoPlan>,
    rejected_placements: u64,
    pub(super) step: usize,
    pub(super) drawing: Drawing,
}

/// Where a macro action stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Until {
    /// As soon as the task is done, or at the end.
    Success,
    /// At the end.
    End,
}

impl SimEnvironment {
    /// The task in its scene `seed`, seen by `cameras` (names of [`Camera::by_name`]).
    ///
    /// # Errors
    ///
    /// When a camera is unknown or the scene cannot be placed.
    pub fn new(
        task: &'static Task,
        robot: &Arc<Robot>,
        seed: u64,
        cameras: &[&'static str],
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
        task: &'static Task,
        variation: usize,
        robot: &Arc<Robot>,
        seed: u64,
        cameras: &[&'static str],
        params: &SimParams,
    ) -> Result<Self> {
        for camera in cameras {
            Camera::by_name(camera, robot, &Pose3::IDENTITY)?;
        }
        let placed = place(task, variation, robot, seed)?;
        Ok(Self { variation, ..Self::of(task, robot, placed, cameras, params)? })
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
        Self::of(task, robot, placed, &[], params)
    }

    fn of(
        task: &'static Task,
        robot: &Arc<Robot>,
        PlacedTask { scene, plan, rejected, .. }: PlacedTask,
        cameras: &[&'static str],
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
            cameras: cameras.to_vec(),
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

    /// How it times paths.
    #[must_use]
    pub fn timing(&self) -> &TimingSettings {
        &self.timing
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &'static Task {
        self.task
    }

    /// Which of the task's variations this is.
    #[must_use]
    pub fn variation(&self) -> usize {
        self.variation
    }

    /// The world behind the observations.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// What the demonstrator would do in this scene.
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

    /// This episode with its world as in `world`, after `step` macro actions.
    #[must_use]
    pub fn at(&self, world: World, step: usize) -> Self {
        Self { world, step, ..self.clone() }
    }

    /// What the cameras see of the scene as obstacles, with the contact rule for `goal`
    /// (`world_from_grip`).
    #[must_use]
    pub fn obstacles(&mut self, goal: Option<&Pose3>) -> Scene {
        let observation = self.observe();
        let points: Vec<Vec3> = observation.colored_points().map(|(point, _)| point).collect();
        let holding = if self.world.holding() == Holding::Nothing {
            scene::Holding::Nothing
        } else {
            scene::Holding::Object
        };
        let query =
            ObstacleQuery { robot: &self.robot, measured: self.world.config(), goal, holding };
        obstacle_scene(&query, &points)
    }

    /// As [`Environment::step`], calling `record` after every control step and after the gripper's
    /// command.
    pub fn step_recorded(
        &mut self,
        path: &JointPath,
        gripper: Gripper,
        record: impl FnMut(&World),
    ) -> StepResult {
        self.step_until(Until::Success, path, gripper, record)
    }

    /// As [`Self::step_recorded`], stopping where `until` says.
    pub(super) fn step_until(
        &mut self,
        until: Until,
        path: &JointPath,
        gripper: Gripper,
        mut record: impl FnMut(&World),
    ) -> StepResult {
        self.step += 1;
        let outcome = self.run(until, path, gripper, &mut record);
        let success = outcome.is_ok() && self.world.success();
        let terminated = success || outcome.is_err();
        StepResult {
            reward: f32::from(u8::from(success)),
            terminated,
            truncated: !terminated && self.step >= EPISODE_LENGTH,
            invalid: outcome.err(),
        }
    }

    /// Follows the path, then moves the gripper.
    fn run(
        &mut self,
        until: Until,
        path: &JointPath,
        gripper: Gripper,
        record: &mut impl FnMut(&World),
    ) -> Result<(), InvalidAction> {
        if path.start().max_joint_distance(self.world.config()) > START_TOLERANCE {
            return Err(InvalidAction::StartMismatch);
        }
        if !path.configs().iter().all(|config| self.robot.within_limits(config)) {
            return Err(InvalidAction::OutsideLimits);
        }
        let timed = TimedPath::new(path.clone(), &self.robot, &self.timing)
            .expect("the environment's timing is positive");
        if timed.duration_secs() > MOTION_TIMEOUT_SECS {
            return Err(InvalidAction::TooLong { seconds: timed.duration_secs() as f32 });
        }
        let dt = f64::from(self.params.dt);
        let steps = libm::ceil(timed.duration_secs() / dt) as usize;
        let per_control = self.params.steps_per_control();
        for i in 1..=steps {
            self.world.step(&timed.config_at(i as f64 * dt))?;
            if i % per_control == 0 || i == steps {
                record(&self.world);
                if until == Until::Success && self.world.success() {
                    return Ok(());
                }
            }
        }
        self.move_gripper(gripper)?;
        record(&self.world);
        Ok(())
    }

    /// The arm moves to `config` within one control step.
    #[cfg(feature = "learn")]
    pub(super) fn move_straight(
        &mut self,
        config: &crate::robot::JointConfig,
    ) -> Result<(), InvalidAction> {
        let (start, steps) = (*self.world.config(), self.params.steps_per_control());
        (1..=steps).try_for_each(|i| self.world.step(&start.lerp(config, i as f32 / steps as f32)))
    }

    pub(super) fn move_gripper(&mut self, gripper: Gripper) -> Result<(), InvalidAction> {
        self.world.command_gripper(gripper);
        let config = *self.world.config();
        let most = (GRIPPER_TIMEOUT_SECS / self.params.dt) as usize;
        for i in 0..most {
            match self.world.step(&config) {
                // The arm stands still: its fingers press with what the gripper's motor gives,
                // which overshoots at first.
                Ok(()) | Err(InvalidAction::Force { .. }) => {}
                Err(invalid) => return Err(invalid),
            }
            if self.world.gripper_settled() && i >= self.params.steps_per_control() {
                break;
            }
        }
        Ok(())
    }
}

/// Lets the scene come to rest; the arm stands still.
fn settled(mut world: World) -> World {
    let config = *world.config();
    for _ in 0..SETTLE_STEPS {
        // Nothing touches the arm in its start posture, so a reason to abort cannot arise.
        let _ = world.step(&config);
    }
    world
}

impl Environment for SimEnvironment {
    fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    fn reset(&mut self, seed: u64) -> Result<()> {
        let timing = self.timing.clone();
        let sensing = self.sensing().cloned();
        let Self { task, variation, ref robot, ref cameras, ref params, .. } = *self;
        *self =
            Self { timing, ..Self::of_variation(task, variation, robot, seed, cameras, params)? };
        if let Some(sensing) = sensing {
            self.set_sensing(sensing, seed);
        }
        Ok(())
    }

    fn observe(&mut self) -> Observation {
        let views = self.cameras.clone().into_iter().map(|camera| self.view(camera)).collect();
        let width = self.world.gripper_width();
        let proprio = Proprio {
            joints: *self.world.config(),
            gripper_width: width,
            gripper_open: Proprio::openness(width, self.world.gripper_spec().max_width),
            finger_positions: [0.5 * width; 2],
            grip: self.robot.grip(self.world.config()),
            time: time_feature(self.step, EPISODE_LENGTH),
        };
        Observation { views, proprio }
    }

    fn step(&mut self, path: &JointPath, gripper: Gripper) -> StepResult {
        self.step_recorded(path, gripper, |_| {})
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        self.plan.goals.get(self.step).copied()
    }
}
