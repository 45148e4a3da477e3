//! A task that is made at run time, with a name and a scene that no source file holds.

use crate::env::Environment as _;
use crate::q_attention::NextBestPose;
use crate::rng::{Stream, stream};
use crate::robot::{Gripper, XARM7};
use crate::scene::{Part, Shape};
use crate::sim::tasks::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet, Waypoint};
use crate::sim::{
    BodyKind, BodySpec, Condition, Grasp, SceneSpec, SimEnvironment, SimParams, World, demonstrate,
};
use glamx::{Pose3, Quat, Vec2, Vec3};
use std::sync::Arc;

/// Side of the cube, metres.
const SIDE: f32 = 0.04;

/// Grasp a cube; the source draws or keeps this scene.
fn grasp_a_cube() -> TaskScene {
    let cube = BodySpec {
        name: "cube".to_owned(),
        kind: BodyKind::Graspable,
        pose: Pose3::from_translation(Vec3::Z * 0.5 * SIDE),
        parts: vec![Part::new(
            Shape::Cuboid { half_extents: Vec3::splat(0.5 * SIDE) },
            Pose3::IDENTITY,
            [200, 60, 40],
        )],
        mass: 0.1,
        friction: 0.5,
    };
    let down = Quat::from_rotation_x(core::f32::consts::PI);
    let waypoint = |z: f32, gripper, approach| Waypoint {
        goal: NextBestPose { pose: Pose3::from_parts(Vec3::Z * z, down), gripper },
        approach,
    };
    TaskScene {
        spec: SceneSpec {
            task: String::new(),
            bodies: vec![cube],
            joints: Vec::new(),
            success: vec![Condition::Grasped { body: 0 }],
        },
        waypoints: vec![
            waypoint(0.1, Gripper::Open, Approach::Free),
            waypoint(0.5 * SIDE, Gripper::Close, Approach::Linear),
        ],
    }
}

fn task(name: String, scenes: SceneSource) -> Arc<Task> {
    Arc::new(Task {
        name,
        set: TaskSet::Extra,
        goal: "grasp the cube".to_owned(),
        variations: Vec::new(),
        keyframes: 2,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::splat(0.05), max_yaw: 0.5 },
        scenes,
    })
}

/// The environment after a demonstration in scene `seed`, with the cameras' names made at run time
/// as well.
fn demonstrated(task: &Arc<Task>, seed: u64) -> SimEnvironment {
    let camera = String::from("front");
    let cameras = [camera.as_str()];
    let mut env = SimEnvironment::new(task, &XARM7, 0, &cameras, &SimParams::STANDARD).unwrap();
    env.reset(seed).unwrap();
    assert_eq!(env.observe().views[0].camera.name, "front");
    let demo = demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0));
    assert!(demo.success, "{:?}", demo.invalid);
    env
}

#[test]
fn an_episode_runs_in_a_task_with_an_owned_name_and_a_scene_as_data() {
    let name = format!("grasp_{SIDE}");
    let task = task(name.clone(), SceneSource::Fixed(grasp_a_cube()));
    let env = demonstrated(&task, 5);
    assert_eq!(env.world().grasp(), Grasp::Attached { body: 0 });
    assert_eq!((&env.task().name, &env.world().spec().task), (&name, &name));
    assert!(Task::by_name(&name).is_err(), "it is none of this program's");
}

#[test]
fn a_scene_as_data_is_placed_as_one_that_is_drawn() {
    let cube = |world: &World| world.spec().bodies[0].pose;
    let fixed = task("cube".to_owned(), SceneSource::Fixed(grasp_a_cube()));
    let drawn = task("cube".to_owned(), SceneSource::Drawn(|_, _| grasp_a_cube()));
    let [five, six] = [5, 6].map(|seed| demonstrated(&fixed, seed));
    assert_eq!(five.world().hash(), demonstrated(&drawn, 5).world().hash());
    assert_ne!(cube(five.world()), cube(six.world()));
}
