//! Where a task stands: drawn until it fits on the table and the arm can do the demonstrator's waypoints.
//!
//! Reachability is a matter of kinematics alone: a placement is never judged by running the demonstration.

use super::arm::link_parts;
use super::demonstrator::{DemoPlan, plan_waypoints};
use super::scene_spec::{BodyKind, BodySpec};
use super::tasks::{Placement, Task, TaskScene};
use crate::error::{Error, Result};
use crate::rng::{self, Rng, Stream};
use crate::robot::Robot;
use crate::scene::{Part, Shape};
use glamx::{Pose3, Quat, Vec2, Vec3};
use rand::RngExt as _;
use rapier3d::parry::bounding_volume::BoundingVolume as _;

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
    /// What the demonstrator will do.
    pub plan: DemoPlan,
    /// Draws that were rejected before this one.
    pub rejected: u64,
}

/// Places `task` for scene `seed`.
///
/// # Errors
///
/// When 200 draws give no placement that the arm can do.
pub fn place(task: &Task, robot: &'static Robot, seed: u64) -> Result<PlacedTask> {
    for draw in 0..MAX_DRAWS {
        let mut rng = rng::stream(seed, Stream::Placement, draw);
        let Some(scene) = draw_placement(task, robot, &mut rng) else { continue };
        let mut ik_rng = rng::stream(seed, Stream::Ik, draw);
        if let Some(plan) = plan_waypoints(robot, &robot.start, &scene, &mut ik_rng) {
            return Ok(PlacedTask { scene, plan, rejected: draw });
        }
    }
    Err(Error::Environment(format!(
        "task '{}' with seed {seed}: none of {MAX_DRAWS} placements can be reached by {}",
        task.name, robot.name
    )))
}

/// One draw: `None` when something touches the arm's start posture.
fn draw_placement(task: &Task, robot: &Robot, rng: &mut Rng) -> Option<TaskScene> {
    let Placement { center, half_range, max_yaw } = task.placement;
    let mut symmetric = || 2.0 * rng.random::<f32>() - 1.0;
    let yaw = max_yaw * symmetric();
    let origin = robot.workspace_center + center + half_range * Vec2::new(symmetric(), symmetric());
    let world_from_task = Pose3::from_parts(origin.extend(0.0), Quat::from_rotation_z(yaw));
    let mut scene = (task.build)(rng).placed(&world_from_task);
    if touches_start(robot, &scene) {
        return None;
    }
    scene.spec.bodies.push(table());
    Some(scene)
}

/// Whether a body that can be touched is at the arm in its start posture; bounding boxes decide.
fn touches_start(robot: &Robot, scene: &TaskScene) -> bool {
    let aabb = |pose: &Pose3, part: &Part| {
        let shape = super::physics::shared_shape(&part.shape);
        shape.compute_aabb(&(*pose * super::physics::collider_pose(part)))
    };
    let frames = robot.link_frames(&robot.start);
    let arm: Vec<_> = frames
        .iter()
        .enumerate()
        .flat_map(|(link, frame)| link_parts(robot, link).into_iter().map(move |part| (*frame, part)))
        .map(|(frame, part)| aabb(&frame, &part).loosened(CLEARANCE))
        .collect();
    let solid = scene.spec.bodies.iter().filter(|body| body.kind != BodyKind::Visual);
    solid.flat_map(|body| body.parts.iter().map(|part| aabb(&body.pose, part))).any(|b| arm.iter().any(|a| a.intersects(&b)))
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
