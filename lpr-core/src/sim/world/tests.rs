//! Worlds hold, follow and end where they should.

use super::*;
use crate::env::Environment as _;
use crate::rng::{Stream, stream};
use crate::robot::{PANDA, ROBOTS, XARM7};
use crate::sim::demonstrating::{Demonstration, demonstrate};
use crate::sim::environment::SimEnvironment;
use crate::sim::placement::place;
use crate::sim::tasks::{TASKS, Task};
use glamx::Vec3;

fn demonstration(task: &str, robot: &Arc<Robot>, seed: u64) -> (SimEnvironment, Demonstration) {
    let task = Task::by_name(task).unwrap();
    let mut env =
        SimEnvironment::new(&task, robot, seed, &["front"], &SimParams::STANDARD).unwrap();
    let demo = demonstrate(&mut env, &mut stream(seed, Stream::Demo, 0));
    (env, demo)
}

#[test]
fn demonstrations_do_every_task_with_both_robots() {
    for (task, robot) in TASKS.iter().flat_map(|task| ROBOTS.map(|robot| (task, robot))) {
        let failed: Vec<_> =
            (0..5).filter(|seed| !demonstration(&task.name, robot, *seed).1.success).collect();
        assert_eq!(failed, [0_u64; 0], "{} with {}", task.name, robot.name);
    }
}

#[test]
fn articulated_bodies_stay_on_their_joints() {
    /// Degrees: the light lever of a door gives way more than doors and drawers do.
    const LEVER: f32 = 1.3;
    for (task, robot) in TASKS.iter().flat_map(|task| ROBOTS.map(|robot| (task, robot))) {
        let (_, demo) = demonstration(&task.name, robot, 1);
        for (frame, joint) in demo
            .frames
            .iter()
            .flat_map(|frame| (0..frame.spec().joints.len()).map(move |joint| (frame, joint)))
        {
            let most = if frame.spec().joints[joint].name == "lever_axle" { LEVER } else { 1.0 };
            let (shift, turn) = frame.joint_deviation(joint);
            assert!(
                shift < 0.003 && turn < most.to_radians(),
                "{} {}: {shift} m, {turn} rad",
                task.name,
                robot.name
            );
        }
    }
}

#[test]
fn a_door_is_latched_until_its_lever_is_turned() {
    let (_, demo) = demonstration("open_door", &PANDA, 1);
    let [door, lever] = [0, 1];
    let latched: Vec<_> =
        demo.frames.iter().filter(|frame| frame.joint_position(lever) < 0.4).collect();
    assert!(
        latched.len() > 10 && latched.iter().all(|frame| frame.joint_position(door).abs() < 0.01)
    );
    // Pushed where the lever is held, without turning it, the door stays shut.
    let mut world = demo.frames[demo.waypoint_frames[1]].clone();
    for _ in 0..20 {
        let mut grip = world.robot().grip(world.config());
        grip.translation += 0.0005 * world.spec().joints[lever].axis;
        let config = world.robot().ik_step(&grip, world.config()).unwrap();
        // It presses harder than it may; that ends an episode, not the test.
        let _ = world.step(&config);
    }
    assert!(
        world.joint_position(door) < 0.02,
        "the door opened by {} rad",
        world.joint_position(door)
    );
}

#[test]
fn a_lever_that_is_let_go_returns() {
    let (_, demo) = demonstration("open_door", &XARM7, 1);
    let mut world = demo.frames[demo.waypoint_frames[2]].clone();
    let turned = world.joint_position(1);
    world.command_gripper(Gripper::Open);
    for step in 0..400 {
        // The fingers open, then withdraw from around it.
        let grip =
            world.robot().grip(world.config()) * Pose3::from_translation(Vec3::NEG_Z * 0.0005);
        let config = if step < 150 {
            *world.config()
        } else {
            world.robot().ik_step(&grip, world.config()).unwrap()
        };
        let _ = world.step(&config);
    }
    assert!(
        turned > 0.4 && world.joint_position(1) < 0.1,
        "from {turned} to {}",
        world.joint_position(1)
    );
}

#[test]
fn friction_alone_holds_what_a_demonstrator_lifts() {
    let task = Task::by_name("pick_and_lift").unwrap();
    for robot in ROBOTS {
        let env = SimEnvironment::new(&task, robot, 1, &["front"], &SimParams::STANDARD).unwrap();
        let mut env = env.with_friction_grasps().unwrap();
        let demo = demonstrate(&mut env, &mut stream(1, Stream::Demo, 0));
        assert!(
            demo.success && env.world().grasp() == Grasp::Pinched,
            "{}: {:?}",
            robot.name,
            demo.invalid
        );
    }
}

#[test]
fn every_variation_can_be_placed_and_is_another_scene() {
    for task in TASKS.iter() {
        let scene = |variation| place(task, variation, &PANDA, 1).map(|placed| placed.scene.spec);
        let first = scene(0).unwrap();
        for variation in 1..task.n_variations() {
            assert_ne!(scene(variation).unwrap(), first, "{}", task.describe(variation));
            assert_eq!(
                scene(variation).unwrap(),
                scene(variation).unwrap(),
                "the same seed, the same scene"
            );
        }
        let error = scene(task.n_variations()).expect_err("one variation too many").to_string();
        assert!(error.contains(&task.name) && error.contains("no variation"), "{error}");
    }
}

#[test]
fn an_attached_lid_does_not_slip() {
    let (_, demo) = demonstration("take_lid_off_saucepan", &XARM7, 1);
    let lid = demo.frames[0].spec().bodies.iter().position(|body| body.name == "lid").unwrap();
    let in_grip =
        |world: &World| world.robot().grip(world.config()).inverse() * world.body_pose(lid);
    let held: Vec<_> =
        demo.frames.iter().filter(|frame| frame.grasp() == Grasp::Attached { body: lid }).collect();
    assert!(held.len() > 5, "the lid was held for {} frames", held.len());
    for frame in &held {
        let slip = in_grip(frame).translation.distance(in_grip(held[0]).translation);
        assert!(slip < 0.002, "slipped by {slip} m");
    }
}

#[test]
fn a_clone_continues_bit_for_bit() {
    let (_, demo) = demonstration("toilet_seat_up", &PANDA, 2);
    let mut original = demo.frames[demo.waypoint_frames[1]].clone();
    let mut copy = original.clone();
    for _ in 0..100 {
        let config = *original.config();
        original.step(&config).unwrap();
        copy.step(&config).unwrap();
        assert_eq!(original.hash(), copy.hash());
    }
}

#[test]
fn the_same_seed_gives_the_same_world() {
    let hash = || demonstration("open_drawer", &XARM7, 7).0.world().hash();
    assert_eq!(hash(), hash());
}

/// A world of the lid task with the arm where its demonstrator grasps.
fn at_the_knob() -> World {
    let (_, demo) = demonstration("take_lid_off_saucepan", &XARM7, 1);
    demo.frames[demo.waypoint_frames[1] - 1].clone()
}

/// Moves the grip by `way` metres at 0.2 m/s until something ends it.
fn push(world: &mut World, way: Vec3) -> Result<(), InvalidAction> {
    let steps = (way.length() / 0.002) as usize;
    for _ in 0..steps {
        let mut grip = world.robot().grip(world.config());
        grip.translation += way / steps as f32;
        let config = world.robot().ik_step(&grip, world.config()).unwrap();
        world.step(&config)?;
    }
    Ok(())
}

#[test]
fn the_arm_does_not_pass_through_things() {
    let pushed = push(&mut at_the_knob(), Vec3::new(0.0, 0.0, -0.12));
    assert!(
        matches!(pushed, Err(InvalidAction::Collision { .. } | InvalidAction::Force { .. })),
        "got {pushed:?}"
    );
}

#[test]
fn a_jump_of_the_arm_is_refused() {
    let mut world = at_the_knob();
    let mut config = *world.config();
    config[2] += 0.5;
    assert_eq!(world.step(&config), Err(InvalidAction::JointSpeed { joint: 2 }));
    config[2] = f32::NAN;
    assert_eq!(world.step(&config), Err(InvalidAction::JointSpeed { joint: 2 }));
}

#[test]
fn a_gripper_that_closes_on_air_holds_nothing() {
    let (mut env, _) = demonstration("reach_target", &XARM7, 0);
    env.reset(0).unwrap();
    let mut world = env.world().clone();
    world.command_gripper(Gripper::Close);
    let config = *world.config();
    for _ in 0..200 {
        world.step(&config).unwrap();
    }
    assert_eq!((world.grasp(), world.gripper_width()), (Grasp::Nothing, 0.0));
}
