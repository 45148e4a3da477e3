//! The scripted demonstrator: waypoints of the task through our own kinematics and planner.
//!
//! It alone knows the scene's construction; an agent sees only what it records.

use super::env::SimEnvironment;
use super::tasks::{Motion, Waypoint};
use super::world::World;
use crate::env::{Environment as _, InvalidAction};
use crate::path::{JointPath, RrtSettings, linear_path, rrt_connect, shortcut};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, MotionChecker};
use glamx::{Pose3, Quat};

/// Postures tried for the first waypoint, each followed through all others.
const POSTURES: usize = 40;
/// Least difference of two postures, radians.
const POSTURE_DISTANCE: f32 = 0.1;
/// Planner of the demonstrator's free motions.
const PLANNER: RrtSettings = RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 4000 };

/// What the demonstrator will do: one goal for each waypoint, and the paths that kinematics settles beforehand.
#[derive(Debug, Clone)]
pub struct DemoPlan {
    /// The waypoints' goals, with the grasp turned by half a turn where the arm prefers it.
    pub goals: Vec<NextBestPose>,
    /// For each waypoint: the posture of a free motion's end, or the path of a prescribed one.
    steps: Vec<PlanStep>,
}

#[derive(Debug, Clone)]
enum PlanStep {
    Free(JointConfig),
    Prescribed(JointPath),
}

impl PlanStep {
    fn end(&self) -> &JointConfig {
        match self {
            Self::Free(config) => config,
            Self::Prescribed(path) => path.goal(),
        }
    }
}

/// Finds postures in which the arm at `start` can do every waypoint; `None` when it finds none.
///
/// Both halves of the symmetric gripper's turn about its approach are tried.
pub fn plan_waypoints(robot: &Robot, start: &JointConfig, waypoints: &[Waypoint], rng: &mut Rng) -> Option<DemoPlan> {
    let (first, rest) = waypoints.split_first()?;
    let mut postures: Vec<(f32, usize, JointConfig)> = Vec::new();
    for (turn_idx, turn) in half_turns().into_iter().enumerate() {
        let found = robot.ik_distinct(&(first.goal.pose * turn), POSTURES, POSTURE_DISTANCE, start, rng);
        postures.extend(found.into_iter().map(|config| (config.distance(start), turn_idx, config)));
    }
    postures.sort_by(|a, b| a.0.total_cmp(&b.0));
    postures.into_iter().filter(|(_, _, config)| !robot.self_collides(config)).find_map(|(_, turn_idx, config)| {
        let turn = half_turns()[turn_idx];
        let mut steps = vec![PlanStep::Free(config)];
        for waypoint in rest {
            steps.push(plan_step(robot, steps[steps.len() - 1].end(), waypoint, &turn)?);
        }
        let goals = waypoints.iter().map(|w| NextBestPose { pose: w.goal.pose * turn, gripper: w.goal.gripper }).collect();
        Some(DemoPlan { goals, steps })
    })
}

fn half_turns() -> [Pose3; 2] {
    [Pose3::IDENTITY, Pose3::from_rotation(Quat::from_xyzw(0.0, 0.0, 1.0, 0.0))]
}

fn plan_step(robot: &Robot, from: &JointConfig, waypoint: &Waypoint, turn: &Pose3) -> Option<PlanStep> {
    let goal = waypoint.goal.pose * *turn;
    match &waypoint.motion {
        Motion::Free => robot.ik_nearest(&goal, from).map(PlanStep::Free),
        Motion::Linear => linear_path(robot, from, &goal).ok().map(PlanStep::Prescribed),
        Motion::Through(poses) => {
            let mut configs = vec![*from];
            for pose in poses.iter().map(|pose| *pose * *turn).chain([goal]) {
                let leg = linear_path(robot, &configs[configs.len() - 1], &pose).ok()?;
                configs.extend_from_slice(&leg.configs()[1..]);
            }
            JointPath::new(configs).ok().map(PlanStep::Prescribed)
        }
    }
}

/// A recorded demonstration.
#[derive(Debug)]
pub struct Demonstration {
    /// The world at every control step, from the first to the last: frames and observations are made from these.
    pub frames: Vec<World>,
    /// Indices of the frames in which a waypoint was reached and its gripper command done.
    pub waypoint_frames: Vec<usize>,
    /// Whether the task was done.
    pub success: bool,
    /// Why it ended early.
    pub invalid: Option<InvalidAction>,
}

/// Does the task in `env`, which has just been reset, recording every control step.
#[must_use]
pub fn demonstrate(env: &mut SimEnvironment, rng: &mut Rng) -> Demonstration {
    let mut demo =
        Demonstration { frames: vec![env.world().clone()], waypoint_frames: Vec::new(), success: false, invalid: None };
    let steps = env.plan().steps.clone();
    let goals = env.plan().goals.clone();
    for (step, goal) in steps.iter().zip(&goals) {
        let Some(path) = motion(env, step, rng) else {
            demo.invalid = Some(InvalidAction::NoPath);
            return demo;
        };
        let result = env.step_recorded(&path, goal.gripper, |world| demo.frames.push(world.clone()));
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
    let robot = env.robot();
    let goal = match step {
        PlanStep::Prescribed(path) => return Some(path.clone()),
        PlanStep::Free(config) => *config,
    };
    let start = *env.world().config();
    let scene = env.obstacles(Some(&robot.grip(&goal)));
    let arm = ArmSpheres::new(robot);
    let checker = MotionChecker::new(&scene, &arm, PLANNER.checks_per_radian);
    match rrt_connect(robot, &checker, &start, &[goal], &PLANNER, rng) {
        Ok(plan) => Some(shortcut(&plan.path, &checker)),
        // The cloud is conservative: where it leaves no way, the straight joint-space motion is tried and judged by the world.
        Err(_) => JointPath::new(vec![start, goal]).ok(),
    }
}
