//! The scripted demonstrator: waypoints of the task through our own kinematics and planner.
//!
//! It alone knows the scene's construction; an agent sees only what it records.

use super::env::{SimEnvironment, Until};
use super::scene_spec::BodyKind;
use super::tasks::{Motion, TaskScene, Waypoint};
use super::world::World;
use crate::env::{Environment as _, InvalidAction};
use crate::path::{JointPath, RrtSettings, linear_path, linear_path_in, rrt_connect, shortcut};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, MotionChecker, Part, Primitive, Scene};
use glamx::{Pose3, Quat};
use std::sync::Arc;

/// Postures tried for the first waypoint, each followed through all others.
const POSTURES: usize = 40;
/// Least difference of two postures, radians.
const POSTURE_DISTANCE: f32 = 0.1;
/// Steps of inverse kinematics between two poses of an arc, which are close already.
const LEG_STEPS: usize = 4;
/// Planner of the demonstrator's free motions.
const PLANNER: RrtSettings =
    RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 4000 };

/// What the demonstrator will do: one goal for each waypoint, and the paths that kinematics settles
/// beforehand.
#[derive(Debug, Clone)]
pub struct DemoPlan {
    /// The waypoints' goals, with the grasp turned by half a turn where the arm prefers it.
    pub goals: Vec<NextBestPose>,
    /// How each goal is reached, turned as the goals are.
    motions: Vec<Motion>,
    /// For each waypoint: the posture of a free motion's end, or the path of a prescribed one.
    steps: Vec<PlanStep>,
    /// What stands in the scene at its start.
    solids: Scene,
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

impl DemoPlan {
    /// Of no one: an episode that was recorded needs no demonstrator.
    pub(super) fn none() -> Self {
        Self { goals: Vec::new(), motions: Vec::new(), steps: Vec::new(), solids: Scene::empty() }
    }

    /// The same motions to other goals, one for each waypoint: those that an agent can express, for
    /// instance.
    ///
    /// Straight lines end at the new goals. An arc is bent, so that it leads from the new goal
    /// before it to its own new goal: each of its poses is displaced, in the frame of the grip, by
    /// a share of both displacements. `None` when the arm cannot do that from `start`.
    #[must_use]
    pub fn with_goals(
        &self,
        robot: &Robot,
        start: &JointConfig,
        goals: &[NextBestPose],
        rng: &mut Rng,
    ) -> Option<Self> {
        let displacement = |idx: usize| self.goals[idx].pose.inverse() * goals[idx].pose;
        let waypoints = self.motions.iter().enumerate().zip(goals).map(|((idx, motion), goal)| {
            let motion = match motion {
                // The first waypoint is reached from where the arm starts, which stays.
                Motion::Through(poses) if idx > 0 => {
                    Motion::Through(bent(poses, displacement(idx - 1), displacement(idx)))
                }
                other => other.clone(),
            };
            Waypoint { goal: *goal, motion }
        });
        plan_one_of(robot, start, &[waypoints.collect()], &self.solids, rng)
    }
}

/// `poses` displaced by more and more of `last` and less and less of `first`.
fn bent(poses: &[Pose3], first: Pose3, last: Pose3) -> Vec<Pose3> {
    let displaced = |(idx, pose): (usize, &Pose3)| {
        let share = (idx + 1) as f32 / (poses.len() + 1) as f32;
        let translation = first.translation.lerp(last.translation, share);
        *pose * Pose3::from_parts(translation, first.rotation.slerp(last.rotation, share))
    };
    poses.iter().enumerate().map(displaced).collect()
}

/// Finds postures in which the arm at `start` can do every waypoint of a scene; `None` when it
/// finds none.
///
/// Both halves of the symmetric gripper's turn about its approach are tried.
pub(super) fn plan_waypoints(
    robot: &Robot,
    start: &JointConfig,
    scene: &TaskScene,
    rng: &mut Rng,
) -> Option<DemoPlan> {
    let TaskScene { spec, waypoints } = scene;
    let half_turn = Pose3::from_rotation(Quat::from_xyzw(0.0, 0.0, 1.0, 0.0));
    let turned = |waypoint: &Waypoint| Waypoint {
        goal: NextBestPose { pose: waypoint.goal.pose * half_turn, gripper: waypoint.goal.gripper },
        motion: match &waypoint.motion {
            Motion::Through(poses) => {
                Motion::Through(poses.iter().map(|pose| *pose * half_turn).collect())
            }
            other => other.clone(),
        },
    };
    let solids =
        solids(spec.bodies.iter().map(|body| (body.kind, body.pose, body.parts.as_slice())));
    plan_one_of(
        robot,
        start,
        &[waypoints.clone(), waypoints.iter().map(turned).collect()],
        &solids,
        rng,
    )
}

/// Finds postures for the waypoints of one of the alternatives: those that touch nothing first, of
/// them the nearest to `start`.
fn plan_one_of(
    robot: &Robot,
    start: &JointConfig,
    alternatives: &[Vec<Waypoint>],
    solids: &Scene,
    rng: &mut Rng,
) -> Option<DemoPlan> {
    let arm = ArmSpheres::new(robot);
    let cost = |config: &JointConfig| (!solids.is_free(&arm, config), config.distance(start));
    let mut postures: Vec<((bool, f32), &[Waypoint], JointConfig)> = Vec::new();
    for waypoints in alternatives {
        let found = robot.ik_distinct(
            &waypoints.first()?.goal.pose,
            POSTURES,
            POSTURE_DISTANCE,
            start,
            rng,
        );
        postures
            .extend(found.into_iter().map(|config| (cost(&config), waypoints.as_slice(), config)));
    }
    postures.sort_by(|(a, ..), (b, ..)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    postures.into_iter().filter(|(_, _, config)| !robot.self_collides(config)).find_map(
        |(_, waypoints, config)| {
            let mut steps = vec![PlanStep::Free(config)];
            for waypoint in &waypoints[1..] {
                steps.push(plan_step(robot, steps[steps.len() - 1].end(), waypoint)?);
            }
            let goals = waypoints.iter().map(|waypoint| waypoint.goal).collect();
            let motions = waypoints.iter().map(|waypoint| waypoint.motion.clone()).collect();
            Some(DemoPlan { goals, motions, steps, solids: solids.clone() })
        },
    )
}

fn plan_step(robot: &Robot, from: &JointConfig, waypoint: &Waypoint) -> Option<PlanStep> {
    let goal = waypoint.goal.pose;
    match &waypoint.motion {
        Motion::Free => robot.ik_nearest(&goal, from).map(PlanStep::Free),
        Motion::Linear => linear_path(robot, from, &goal).ok().map(PlanStep::Prescribed),
        Motion::Through(poses) => {
            let mut configs = vec![*from];
            for pose in poses.iter().chain([&goal]) {
                let leg =
                    linear_path_in(LEG_STEPS, robot, &configs[configs.len() - 1], pose).ok()?;
                configs.extend_from_slice(&leg.configs()[1..]);
            }
            JointPath::new(configs).ok().map(PlanStep::Prescribed)
        }
    }
}

/// A recorded demonstration.
#[derive(Debug)]
pub struct Demonstration {
    /// The world at every control step, from the first to the last: frames and observations are
    /// made from these.
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

/// Everything that can be touched of bodies with their kinds, poses and parts.
fn solids<'a>(bodies: impl Iterator<Item = (BodyKind, Pose3, &'a [Part])>) -> Scene {
    let touched = bodies.filter(|(kind, ..)| *kind != BodyKind::Visual);
    let primitives = touched.flat_map(|(_, pose, parts)| {
        parts.iter().map(move |part| Primitive::new(&part.shape, &(pose * part.pose)))
    });
    Scene::from_primitives(primitives.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::XARM7;
    use crate::sim::place;
    use crate::sim::tasks::Task;
    use glamx::Vec3;

    #[test]
    fn a_plan_for_displaced_goals_ends_its_paths_there() {
        let task = Task::by_name("toilet_seat_up").expect("a task");
        let plan = place(task, 0, &XARM7, 3).expect("a scene that can be placed").plan;
        let shift = |idx: usize| Vec3::new(0.004, -0.003 * idx as f32, 0.002);
        let mut goals = plan.goals.clone();
        goals.iter_mut().enumerate().for_each(|(idx, goal)| goal.pose.translation += shift(idx));
        let rng = &mut stream(3, Stream::Demo, 1);
        let moved = plan
            .with_goals(&XARM7, &XARM7.start, &goals, rng)
            .expect("goals a few millimetres away");
        assert_eq!(moved.goals, goals);
        for (step, goal) in moved.steps.iter().zip(&goals) {
            let end = XARM7.grip(step.end()).translation;
            assert!(
                end.distance(goal.pose.translation) < 1e-3,
                "{end} for {}",
                goal.pose.translation
            );
        }
    }

    #[test]
    fn a_bent_arc_keeps_its_poses_where_nothing_is_displaced() {
        let poses: Vec<_> =
            (0..5).map(|i| Pose3::from_translation(Vec3::splat(i as f32))).collect();
        assert_eq!(bent(&poses, Pose3::IDENTITY, Pose3::IDENTITY), poses);
        let last = Pose3::from_translation(Vec3::X * 0.6);
        let moved = bent(&poses, Pose3::IDENTITY, last);
        assert!((moved[2].translation - poses[2].translation - Vec3::X * 0.3).length() < 1e-6);
    }
}
