//! The simulator: physics, renderer, and what an environment does with them.

use super::{Row, environment, measure};
use crate::cli::failure::Result;
use crate::cli::settings::default_preset;
use lpr_core::config::Config;
use lpr_core::env::Environment as _;
use lpr_core::glamx::Pose3;
use lpr_core::perception::Camera;
use lpr_core::robot::{Gripper, PANDA, Robot, XARM7};
use lpr_core::sim::render::{Detail, Renderer};
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{ArmSweep, ControlAction, SimEnvironment, SimParams, VectorEnvironment};
use std::sync::Arc;

/// Physics steps that are measured at once: one is too short.
const PHYSICS_STEPS: usize = 20;
/// Control steps after which an environment starts over, so that nothing in it falls asleep.
const AWAKE_STEPS: usize = 20;
/// Environments that step together.
const ENVIRONMENTS: usize = 16;
/// The first of their scenes.
const SCENE: u64 = 1000;

pub(super) fn run() -> Result<Vec<Row>> {
    let config = default_preset();
    let env = environment(&config)?;
    let [scene, both_arms] = render(&config)?;
    let steps = [control_step(&config)?, vector_control_step(&config)?];
    Ok([physics(&config.simulator)?, scene, both_arms]
        .into_iter()
        .chain(steps)
        .chain([reset(env)])
        .collect())
}

/// One physics step of [`ArmSweep`]: a kinematic arm that sweeps over ten boxes, all awake.
fn physics(params: &SimParams) -> Result<Row> {
    let mut sweep = ArmSweep::new(params)?;
    let row = measure("physics_arm10_10ms", || (0..PHYSICS_STEPS).try_for_each(|_| sweep.step()));
    Ok(row.per(PHYSICS_STEPS))
}

/// 128 × 128 pixels with colour, depth, points and mask: a scene of 3,156 triangles, and 6,504 of
/// it with one arm and the other.
fn render(config: &Config) -> Result<[Row; 2]> {
    let mut renderer = Renderer::new(Detail::Observation);
    let mut items =
        SimEnvironment::picture_items(busy_environment(config, &XARM7)?.world(), &mut renderer)?;
    let camera = Camera::by_name("front", &XARM7, &Pose3::IDENTITY)?;
    let scene = measure("render_128", || renderer.render(&camera, &items));
    items.extend(SimEnvironment::picture_items(
        busy_environment(config, &PANDA)?.world(),
        &mut renderer,
    )?);
    Ok([scene, measure("render_128_both_arms", || renderer.render(&camera, &items))])
}

fn busy_environment(config: &Config, robot: &Arc<Robot>) -> Result<SimEnvironment> {
    let task = Task::by_name("stack_wine")?;
    Ok(SimEnvironment::new(&task, robot, SCENE, &["front"], &config.simulator)?)
}

/// Turns the arm to and fro.
fn turned(env: &SimEnvironment, n_steps: usize) -> ControlAction {
    let mut target = *env.world().config();
    target[0] += if n_steps % AWAKE_STEPS < AWAKE_STEPS / 2 { 0.02 } else { -0.02 };
    ControlAction { target, gripper: Gripper::Open }
}

/// One control step of 50 ms and the image after it, the arm moving and nothing asleep.
fn control_step(config: &Config) -> Result<Row> {
    let start = busy_environment(config, &XARM7)?;
    let (mut env, mut n_steps) = (start.clone(), 0);
    Ok(measure("control_step_rgbd", || {
        if n_steps % AWAKE_STEPS == 0 {
            env.clone_from(&start);
        }
        let result = env.control_step(&turned(&env, n_steps));
        n_steps += 1;
        (result, env.observe())
    }))
}

/// The same of [`ENVIRONMENTS`] environments together, per environment: what threads are for.
fn vector_control_step(config: &Config) -> Result<Row> {
    let task = Task::by_name("stack_wine")?;
    let scenes = SCENE..SCENE + ENVIRONMENTS as u64;
    let start = VectorEnvironment::new(&task, &XARM7, scenes, &["front"], &config.simulator)?;
    let (mut envs, mut n_steps) = (start.clone(), 0);
    let row = measure("vector_control_step_rgbd", || {
        if n_steps % AWAKE_STEPS == 0 {
            envs.clone_from(&start);
        }
        let actions: Vec<_> = envs.environments().iter().map(|env| turned(env, n_steps)).collect();
        n_steps += 1;
        envs.control_step_and_observe(&actions)
    });
    Ok(row.per(ENVIRONMENTS))
}

/// Placement of a new scene, its settling and an observation.
fn reset(mut env: SimEnvironment) -> Row {
    let mut seed = 2 * SCENE;
    measure("reset_rgbd", || {
        seed += 1;
        env.reset(seed).map(|()| env.observe())
    })
}
