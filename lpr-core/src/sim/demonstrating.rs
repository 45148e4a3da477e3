//! Scripted demonstrations: done in an environment, recorded for an agent, and compared with what
//! the candidates of its keyframes do.
//!
//! The demonstrator alone knows the scene's construction; an agent sees only what it records.

pub mod feasibility;
#[cfg(feature = "learn")]
pub mod recording;

use super::demo_plan::{PlanStep, solids};
use super::environment::{SimEnvironment, Until};
use super::world::World;
use crate::env::{Environment as _, InvalidAction};
use crate::path::{JointPath, RrtSettings, rrt_connect, shortcut};
use crate::rng::Rng;
use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, MotionChecker, Scene};
use std::sync::Arc;

/// Planner of the demonstrator's free motions.
const PLANNER: RrtSettings =
    RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 4000 };

/// A recorded demonstration.
#[derive(Debug)]
pub struct Demonstration {
    /// The world at every control step, from the first to the last: frames and observations are
    /// made from these.
    pub frames: Vec<World>,
    /// Indices of the frames in which a waypoint was reached and its gripper command done.
    pub waypoint_frames: Vec<usize>,
    /// True when the task was done.
    pub success: bool,
    /// The reason for an early end.
    pub invalid: Option<InvalidAction>,
}

/// Does the task in `env`, which has just been reset, recording every control step.
#[must_use]
pub fn demonstrate(env: &mut SimEnvironment, rng: &mut Rng) -> Demonstration {
    let mut demo = Demonstration {
        frames: vec![env.world().clone()],
        waypoint_frames: Vec::new(),
        success: false,
        invalid: None,
    };
    let steps = env.plan().steps.clone();
    let goals = env.plan().goals.clone();
    for (step, goal) in steps.iter().zip(&goals) {
        let Some(path) = motion(env, step, rng) else {
            demo.invalid = Some(InvalidAction::NoPath);
            return demo;
        };
        // To the end: a keyframe is where the demonstrator goes, not where its success is first
        // noticed on the way.
        let result = env
            .step_until(Until::End, &path, goal.gripper, |world| demo.frames.push(world.clone()));
        demo.waypoint_frames.push(demo.frames.len() - 1);
        if result.terminated {
            demo.success = result.reward > 0.0;
            demo.invalid = result.invalid;
            return demo;
        }
    }
    demo
}

/// The path of one step from where the arm is.
fn motion(env: &mut SimEnvironment, step: &PlanStep, rng: &mut Rng) -> Option<JointPath> {
    let robot = &Arc::clone(env.robot());
    let goal = match step {
        PlanStep::Prescribed(path) => return Some(path.clone()),
        PlanStep::Free(config) => *config,
    };
    let scene = env.obstacles(Some(&robot.grip(&goal)));
    let start = *env.world().config();
    let seen = around(robot, &scene, &start, &goal, rng);
    // The camera is blind behind things and for thin ones: the demonstrator goes by what it knows
    // where that is in the way.
    let world = env.world();
    let known = solids(
        world
            .scene_items()
            .map(|(body, pose, parts)| (world.spec().bodies[body].kind, pose, parts)),
    );
    let arm = ArmSpheres::new(robot);
    let checker = MotionChecker::new(&known, &arm, PLANNER.checks_per_radian);
    if let Some(path) = seen.as_ref().filter(|path| checker.path_is_free(path.configs())) {
        return Some(path.clone());
    }
    // Where all that leaves no way, since it is conservative, the straight joint-space motion is
    // tried and judged by the world.
    around(robot, &known, &start, &goal, rng)
        .or(seen)
        .or_else(|| JointPath::new(vec![start, goal]).ok())
}

/// A free path around `scene`, if the planner finds one.
fn around(
    robot: &Robot,
    scene: &Scene,
    start: &JointConfig,
    goal: &JointConfig,
    rng: &mut Rng,
) -> Option<JointPath> {
    let arm = ArmSpheres::new(robot);
    let checker = MotionChecker::new(scene, &arm, PLANNER.checks_per_radian);
    let plan = rrt_connect(&checker, start, &[*goal], &PLANNER, rng).ok()?;
    Some(shortcut(&plan.path, &checker))
}
