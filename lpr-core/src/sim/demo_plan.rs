//! Plans of the scripted demonstrator: a task's waypoints through our own kinematics.
//!
//! A plan knows the scene's construction and no environment: placement makes one to see what the
//! arm can reach, `demonstrating` does it.

use super::scene::BodyKind;
use super::tasks::{Approach, TaskScene, Waypoint};
use crate::path::{JointPath, linear_path, linear_path_in};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, Part, Primitive, Scene};
use glamx::{Pose3, Quat};

/// Postures tried for the first waypoint, each followed through all others.
const POSTURES: usize = 40;
/// Least difference of two postures, radians.
const POSTURE_DISTANCE: f32 = 0.1;
/// Steps of inverse kinematics between two poses of an arc, which are close already.
const LEG_STEPS: usize = 4;

/// A demonstration to be done: one goal for each waypoint, and the paths that kinematics settles
/// beforehand.
#[derive(Debug, Clone)]
pub struct DemoPlan {
    /// The waypoints' goals, with the grasp turned by half a turn where the arm prefers it.
    pub goals: Vec<NextBestPose>,
    /// The way to each goal, turned as the goals are.
    approaches: Vec<Approach>,
    /// For each waypoint: the posture of a free motion's end, or the path of a prescribed one.
    pub(super) steps: Vec<PlanStep>,
    /// Solid bodies of the scene at its start.
    solids: Scene,
}

/// One step of a plan.
#[derive(Debug, Clone)]
pub(super) enum PlanStep {
    /// Any free path to this posture.
    Free(JointConfig),
    /// This path.
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
        Self {
            goals: Vec::new(),
            approaches: Vec::new(),
            steps: Vec::new(),
            solids: Scene::empty(),
        }
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
        let waypoints = self.approaches.iter().enumerate().zip(goals).map(|((idx, way), goal)| {
            let approach = match way {
                // The first waypoint is reached from where the arm starts, which stays.
                Approach::Through(poses) if idx > 0 => {
                    Approach::Through(bent(poses, displacement(idx - 1), displacement(idx)))
                }
                other => other.clone(),
            };
            Waypoint { goal: *goal, approach }
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
        approach: match &waypoint.approach {
            Approach::Through(poses) => {
                Approach::Through(poses.iter().map(|pose| *pose * half_turn).collect())
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
    // A posture that touches something is the last resort, not refused: spheres around the arm are
    // thicker than the arm.
    postures.sort_by(|(a, ..), (b, ..)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    postures.into_iter().filter(|(_, _, config)| !robot.self_collides(config)).find_map(
        |(_, waypoints, config)| {
            let mut steps = vec![PlanStep::Free(config)];
            // Each step from where the last one ends: a posture that reaches the first waypoint may
            // be one from which a later line cannot be followed, and then the next is tried.
            for waypoint in &waypoints[1..] {
                steps.push(plan_step(robot, steps[steps.len() - 1].end(), waypoint)?);
            }
            let goals = waypoints.iter().map(|waypoint| waypoint.goal).collect();
            let approaches = waypoints.iter().map(|waypoint| waypoint.approach.clone()).collect();
            Some(DemoPlan { goals, approaches, steps, solids: solids.clone() })
        },
    )
}

fn plan_step(robot: &Robot, from: &JointConfig, waypoint: &Waypoint) -> Option<PlanStep> {
    let goal = waypoint.goal.pose;
    match &waypoint.approach {
        Approach::Free => robot.ik_nearest(&goal, from).map(PlanStep::Free),
        Approach::Linear => linear_path(robot, from, &goal).ok().map(PlanStep::Prescribed),
        Approach::Through(poses) => {
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

/// Everything that can be touched of bodies with their kinds, poses and parts.
pub(super) fn solids<'a>(bodies: impl Iterator<Item = (BodyKind, Pose3, &'a [Part])>) -> Scene {
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
    use crate::sim::placement::place;
    use crate::sim::tasks::Task;
    use glamx::Vec3;

    #[test]
    fn a_plan_for_displaced_goals_ends_its_paths_there() {
        let task = Task::by_name("toilet_seat_up").expect("a task");
        let plan = place(&task, 0, &XARM7, 3).expect("a scene that can be placed").plan;
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
