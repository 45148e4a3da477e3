//! Placement of a task: drawn until it fits on the table and the arm can do the demonstrator's
//! waypoints.
//!
//! Reachability is a matter of kinematics alone: a placement is never judged by running the
//! demonstration.

use super::demo_plan::{DemoPlan, plan_waypoints};
use super::scene::{BodyKind, BodySpec};
use super::tasks::{Placement, Task, TaskScene};
use super::world::{collider_pose, link_parts, shared_shape};
use crate::error::{Error, Result};
use crate::rng::{self, Rng, Stream};
use crate::robot::Robot;
use crate::scene::{Part, Shape};
use glamx::{Pose3, Quat, Vec2, Vec3};
use rand::RngExt as _;
use rapier3d::parry::bounding_volume::BoundingVolume as _;
use std::sync::Arc;

/// Draws before a scene is given up.
const MAX_DRAWS: u64 = 200;
/// Room kept between the start posture of the arm and everything on the table, metres.
const CLEARANCE: f32 = 0.02;

const TABLE_RGB: [u8; 3] = [205, 190, 170];
/// Centre and half extents of the table: its top is z = 0 and reaches beyond the voxel bounds.
const TABLE: [Vec3; 2] = [Vec3::new(0.45, 0.0, -0.02), Vec3::new(0.75, 0.85, 0.02)];

/// A placed task.
#[derive(Debug, Clone)]
pub struct PlacedTask {
    /// Scene and waypoints in the world; the last body is the table.
    pub scene: TaskScene,
    /// `world_from_task`.
    pub frame: Pose3,
    /// The demonstration that the arm can do there.
    pub plan: DemoPlan,
    /// Draws that were rejected before this one.
    pub rejected: Rejected,
}

/// Draws that were rejected, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Rejected {
    /// Something stood in the arm's start posture.
    pub at_the_arm: u64,
    /// The arm could not do all waypoints.
    pub out_of_reach: u64,
}

impl Rejected {
    /// All of them.
    #[must_use]
    pub fn total(self) -> u64 {
        self.at_the_arm + self.out_of_reach
    }
}

/// Places a variation of `task` for scene `seed`. Task, variation, robot and seed make the scene,
/// bit for bit.
///
/// # Errors
///
/// When there is no such variation, the arm has no workspace, or 200 draws give no placement that the arm can do.
pub fn place(task: &Task, variation: usize, robot: &Arc<Robot>, seed: u64) -> Result<PlacedTask> {
    task.check_variation(variation)?;
    let workspace_center = robot.workspace_center()?;
    let mut rejected = Rejected::default();
    for draw in 0..MAX_DRAWS {
        let mut rng = rng::stream(seed, Stream::Placement, draw);
        let (frame, scene) = draw_placement(task, variation, robot, workspace_center, &mut rng);
        let Some(scene) = scene else {
            rejected.at_the_arm += 1;
            continue;
        };
        // A stream of its own: how often kinematics draws must not move the next placement.
        let mut ik_rng = rng::stream(seed, Stream::Ik, draw);
        if let Some(plan) = plan_waypoints(robot, &robot.start, &scene, &mut ik_rng) {
            return Ok(PlacedTask { scene, frame, plan, rejected });
        }
        rejected.out_of_reach += 1;
    }
    Err(Error::Environment(format!(
        "task '{}' with seed {seed}: none of {MAX_DRAWS} placements can be reached by {}",
        task.name, robot.name
    )))
}

/// One draw of the task's frame, and the scene there: `None` when something touches the arm's start
/// posture.
fn draw_placement(
    task: &Task,
    variation: usize,
    robot: &Robot,
    workspace_center: Vec2,
    rng: &mut Rng,
) -> (Pose3, Option<TaskScene>) {
    let Placement { center, half_range, max_yaw } = task.placement;
    let mut symmetric = || 2.0 * rng.random::<f32>() - 1.0;
    let yaw = max_yaw * symmetric();
    let origin = workspace_center + center + half_range * Vec2::new(symmetric(), symmetric());
    let world_from_task = Pose3::from_parts(origin.extend(0.0), Quat::from_rotation_z(yaw));
    let mut scene = task.scene(variation, rng).placed(&world_from_task);
    if touches_start(robot, &scene) {
        return (world_from_task, None);
    }
    scene.spec.bodies.push(table());
    (world_from_task, Some(scene))
}

/// Tells if a body that can be touched is at the arm in its start posture; bounding boxes decide.
fn touches_start(robot: &Robot, scene: &TaskScene) -> bool {
    let aabb = |pose: &Pose3, part: &Part| {
        shared_shape(&part.shape).compute_aabb(&(*pose * collider_pose(part)))
    };
    let frames = robot.link_frames(&robot.start);
    let arm: Vec<_> = frames
        .iter()
        .enumerate()
        .flat_map(|(link, frame)| {
            link_parts(robot, link).into_iter().map(move |part| (*frame, part))
        })
        .map(|(frame, part)| aabb(&frame, &part).loosened(CLEARANCE))
        .collect();
    let solid = scene.spec.bodies.iter().filter(|body| body.kind != BodyKind::Visual);
    solid
        .flat_map(|body| body.parts.iter().map(|part| aabb(&body.pose, part)))
        .any(|b| arm.iter().any(|a| a.intersects(&b)))
}

fn table() -> BodySpec {
    let [center, half_extents] = TABLE;
    BodySpec {
        name: "table".to_owned(),
        kind: BodyKind::Fixed,
        pose: Pose3::from_translation(center),
        parts: vec![Part::new(Shape::Cuboid { half_extents }, Pose3::IDENTITY, TABLE_RGB)],
        mass: 0.0,
        friction: 0.5,
    }
}
