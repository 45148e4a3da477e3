//! The simulator: physics, renderer, and what an environment does with them.

use super::{Row, default_preset, environment, measure};
use crate::cli::Result;
use lpr_core::env::Environment as _;
use lpr_core::glamx::{Pose3, Vec3};
use lpr_core::perception::Camera;
use lpr_core::robot::XARM7;
use lpr_core::scene::{Part, Shape};
use lpr_core::sim::render::{Detail, Renderer};
use lpr_core::sim::{BodyKind, BodySpec, SceneSpec, SimEnvironment, SimParams, World};
use std::sync::Arc;

/// Objects that lie on the table.
const OBJECTS: usize = 10;
/// Physics steps for which nothing that has just been placed is at rest long enough to fall asleep.
const AWAKE_STEPS: usize = 100;

pub(super) fn run() -> Result<Vec<Row>> {
    let config = default_preset();
    let env = environment(&config)?;
    Ok(vec![physics(&config.simulator)?, render(&env)?, control_step(&env), reset(env)])
}

/// One physics step of the arm and ten objects on a table, before they fall asleep.
fn physics(params: &SimParams) -> Result<Row> {
    let start = World::new(Arc::new(ten_objects()), &XARM7, XARM7.start, params)?;
    let (mut world, config, mut n_steps) = (start.clone(), *start.config(), 0);
    Ok(measure("physics_arm10_10ms", || {
        n_steps += 1;
        if n_steps % AWAKE_STEPS == 0 {
            world = start.clone();
        }
        world.step(&config)
    }))
}

fn ten_objects() -> SceneSpec {
    let body = |name: String, kind, position, half_extents, mass| BodySpec {
        name,
        kind,
        pose: Pose3::from_translation(position),
        parts: vec![Part::new(Shape::Cuboid { half_extents }, Pose3::IDENTITY, [180; 3])],
        mass,
        friction: 0.5,
    };
    let half_side = 0.02;
    let place = |idx: usize| Vec3::new(0.4 + 0.06 * (idx % 5) as f32, 0.2 + 0.06 * (idx / 5) as f32, half_side);
    let objects =
        (0..OBJECTS).map(|idx| body(format!("object{idx}"), BodyKind::Dynamic, place(idx), Vec3::splat(half_side), 0.1));
    let table = body("table".to_owned(), BodyKind::Fixed, Vec3::new(0.45, 0.0, -0.02), Vec3::new(0.75, 0.85, 0.02), 0.0);
    SceneSpec { task: "objects".to_owned(), bodies: objects.chain([table]).collect(), joints: Vec::new(), success: Vec::new() }
}

/// One image of 128 × 128 pixels with depth, points and mask.
fn render(env: &SimEnvironment) -> Result<Row> {
    let mut renderer = Renderer::new(Detail::Observation);
    let items = SimEnvironment::picture_items(env.world(), &mut renderer)?;
    let camera = Camera::by_name("front", &XARM7, &Pose3::IDENTITY)?;
    Ok(measure("render_128", || renderer.render(&camera, &items)))
}

/// 50 ms of the scene, a snapshot of it and an observation, before the scene falls asleep.
fn control_step(env: &SimEnvironment) -> Row {
    let (start, mut env, mut world) = (env.world().clone(), env.clone(), env.world().clone());
    let config = *world.config();
    let per_control = world.params().steps_per_control();
    let mut n_steps = 0;
    measure("control_step_rgbd", || {
        n_steps += 1;
        if n_steps % (AWAKE_STEPS / per_control).max(1) == 0 {
            world = start.clone();
        }
        for _ in 0..per_control {
            // The arm stands still: nothing can end the episode.
            let _ = world.step(&config);
        }
        env = env.at(world.clone(), 0);
        env.observe()
    })
}

/// Placement of a new scene, its settling and an observation.
fn reset(mut env: SimEnvironment) -> Row {
    let mut seed = 2000;
    measure("reset_rgbd", || {
        seed += 1;
        env.reset(seed).map(|()| env.observe())
    })
}
