//! Physics settings hold grasps by friction alone, a stack, a drawer and a lid.
//!
//! rapier's defaults missed such bounds by centimetres in the prototype that the settings come
//! from.

use crate::path::{TimedPath, TimingSettings, linear_path};
use crate::rng::{Stream, stream};
use crate::robot::{Gripper, JointConfig, ROBOTS, Robot};
use crate::scene::{Part, Shape};
use crate::sim::tasks::Task;
use crate::sim::{BodyKind, BodySpec, SceneSpec, SimEnvironment, SimParams, World, demonstrate};
use glamx::{Pose3, Quat, Vec3};
use std::sync::Arc;

/// As the environment times paths.
const TIMING: TimingSettings = TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 };

fn body(name: &str, kind: BodyKind, position: Vec3, half_extents: Vec3, mass: f32) -> BodySpec {
    let parts = vec![Part::new(Shape::Cuboid { half_extents }, Pose3::IDENTITY, [180; 3])];
    BodySpec {
        name: name.to_owned(),
        kind,
        pose: Pose3::from_translation(position),
        parts,
        mass,
        friction: 0.5,
    }
}

/// Cubes of one size on a table, one above the other, with the arm at `config`.
fn stacked(
    n_cubes: usize,
    side: f32,
    mass: f32,
    at: Vec3,
    robot: &Arc<Robot>,
    config: JointConfig,
) -> World {
    let cube = |idx: usize| {
        let center = at + Vec3::Z * side * (idx as f32 + 0.5);
        body(&format!("cube{idx}"), BodyKind::Dynamic, center, Vec3::splat(0.5 * side), mass)
    };
    let table = body(
        "table",
        BodyKind::Fixed,
        Vec3::new(0.45, 0.0, -0.02),
        Vec3::new(0.75, 0.85, 0.02),
        0.0,
    );
    let bodies = (0..n_cubes).map(cube).chain([table]).collect();
    let spec =
        SceneSpec { task: "cubes".to_owned(), bodies, joints: Vec::new(), success: Vec::new() };
    World::new(Arc::new(spec), robot, config, &SimParams::STANDARD).unwrap()
}

fn stand_still(world: &mut World, seconds: f32) {
    let config = *world.config();
    for _ in 0..(seconds / world.params().dt) as usize {
        // Closing fingers may press harder for a moment than a moving hand is allowed to.
        let _ = world.step(&config);
    }
}

/// Moves the grip straight to `goal` and calls `watch` after every step.
fn move_to(world: &mut World, goal: &Pose3, mut watch: impl FnMut(&World)) {
    let robot = world.robot();
    let path = linear_path(robot, world.config(), goal).unwrap();
    let timed = TimedPath::new(path, robot, &TIMING).unwrap();
    let dt = f64::from(world.params().dt);
    for i in 1..=(timed.duration_secs() / dt).ceil() as usize {
        world.step(&timed.config_at(i as f64 * dt)).unwrap();
        watch(world);
    }
}

/// The greatest motion of a cube in the hand, metres and degrees, while the hand lifts it, swings
/// it about and waits.
fn slip(robot: &Arc<Robot>, side: f32, mass: f32) -> (f32, f32) {
    let at = robot.workspace_center().unwrap().extend(0.0);
    let down = Quat::from_rotation_x(core::f32::consts::PI);
    let grasp = Pose3::from_parts(at + Vec3::Z * 0.5 * side, down);
    let config = robot.ik_nearest(&grasp, &robot.start).unwrap();
    let mut world = stacked(1, side, mass, at, robot, config);
    stand_still(&mut world, 0.2);
    world.command_gripper(Gripper::Close);
    stand_still(&mut world, 2.0);
    let in_hand = |world: &World| world.robot().grip(world.config()).inverse() * world.body_pose(0);
    let held = in_hand(&world);
    let (mut shift, mut turn) = (0.0_f32, 0.0_f32);
    let mut watch = |world: &World| {
        let now = in_hand(world);
        shift = shift.max(now.translation.distance(held.translation));
        turn = turn.max(now.rotation.angle_between(held.rotation).to_degrees());
    };
    let lifted = Pose3::from_translation(Vec3::Z * 0.22) * grasp;
    let swung = |sign: f32| {
        let tilt = Quat::from_rotation_y(0.3 * sign) * Quat::from_rotation_z(0.8 * sign);
        Pose3::from_parts(lifted.translation + sign * Vec3::new(-0.06, 0.165, 0.02), tilt * down)
    };
    for goal in [lifted, swung(1.0), swung(-1.0), lifted] {
        move_to(&mut world, &goal, &mut watch);
    }
    stand_still(&mut world, 3.0);
    watch(&world);
    (shift, turn)
}

#[test]
fn friction_holds_light_and_small_cubes() {
    for robot in ROBOTS {
        for (side, mass) in [(0.05, 0.1), (0.02, 0.02)] {
            let (shift, turn) = slip(robot, side, mass);
            assert!(
                shift < 5e-4 && turn < 1.0,
                "{} {side} m {mass} kg: {shift} m, {turn} degrees",
                robot.name
            );
        }
    }
}

#[test]
fn friction_holds_a_kilogram() {
    // Most of it is the fingers giving way sideways, under the weight of the tilted cube.
    for robot in ROBOTS {
        let (shift, turn) = slip(robot, 0.05, 1.0);
        assert!(shift < 2e-3 && turn < 1.0, "{}: {shift} m, {turn} degrees", robot.name);
    }
}

#[test]
fn a_stack_of_six_stands_still_once_it_has_come_to_rest() {
    let robot = ROBOTS[0];
    let at = robot.workspace_center().unwrap().extend(0.0) + Vec3::Y * 0.3;
    let mut world = stacked(6, 0.04, 0.1, at, robot, robot.start);
    let start = world.body_pose(5).translation;
    stand_still(&mut world, 1.0);
    let rested = world.body_pose(5).translation;
    assert!(rested.distance(start) < 1.5e-3, "came to rest {} away", rested - start);
    stand_still(&mut world, 9.0);
    let drift = world.body_pose(5).translation - rested;
    assert!(drift.length() < 1e-4, "drifted by {drift}");
}

/// Final position of the first joint of a task, which the demonstrator moves, metres or radians.
fn moved(task: &str, robot: &Arc<Robot>) -> f32 {
    let task = Task::by_name(task).unwrap();
    let mut env = SimEnvironment::new(&task, robot, 0, &["front"], &SimParams::STANDARD).unwrap();
    let _ = demonstrate(&mut env, &mut stream(0, Stream::Demo, 0));
    env.world().joint_position(0)
}

#[test]
fn a_pulled_drawer_and_a_lifted_lid_follow_the_hand() {
    for robot in ROBOTS {
        for (task, demonstrated) in [("open_drawer", 0.2265), ("open_grill", 57_f32.to_radians())] {
            let moved = moved(task, robot);
            assert!(
                (moved / demonstrated - 1.0).abs() < 0.05,
                "{task} with {}: {moved} of {demonstrated}",
                robot.name
            );
        }
    }
}
