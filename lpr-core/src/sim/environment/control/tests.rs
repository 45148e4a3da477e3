use super::*;
use crate::path::JointPath;
use crate::rng::{Rng, Stream, stream};
use crate::robot::{DOF, PANDA, Robot, XARM7};
use crate::sim::demonstrating::demonstrate;
use crate::sim::scene::BodyKind;
use crate::sim::tasks::{TASKS, Task};
use crate::sim::world::{Grasp, SimParams, World};
use rand::RngExt as _;
use std::sync::Arc;

fn environment(task: &Arc<Task>, robot: &Arc<Robot>, seed: u64) -> SimEnvironment {
    SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD).unwrap()
}

fn assert_finite(world: &World) {
    let numbers = world
        .scene_items()
        .flat_map(|(_, pose, _)| [pose.translation.length(), pose.rotation.length()]);
    assert!(numbers.chain([world.gripper_width()]).all(f32::is_finite), "{world:?}");
    assert!(world.config().is_finite(), "{world:?}");
}

fn assert_observation_is_finite(env: &mut SimEnvironment) {
    let observation = env.observe();
    assert!(
        observation.proprio.low_dim().iter().all(|value| value.is_finite()),
        "{:?}",
        observation.proprio
    );
    for view in &observation.views {
        assert!(
            view.depth.iter().all(|depth| !depth.is_nan())
                && view.points.iter().all(|point| !point.is_nan())
        );
    }
}

/// A value that no one would ask a joint for, or an ordinary one.
fn odd_angle(rng: &mut Rng) -> f32 {
    const ODD: [f32; 8] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN_POSITIVE,
        -0.0,
        1e-40,
        core::f32::consts::TAU,
    ];
    match rng.random_range(0..3) {
        0 => ODD[rng.random_range(0..ODD.len())],
        1 => f32::from_bits(rng.random()),
        _ => rng.random_range(-7.0..7.0),
    }
}

/// Mostly motions that the arm can make towards `heading` (shares of the velocity limits), so that
/// it gets somewhere; sometimes to a limit, sometimes nonsense.
fn fuzzed(
    robot: &Robot,
    config: &JointConfig,
    heading: &[f32; DOF],
    rng: &mut Rng,
) -> ControlAction {
    let mut target = *config;
    let kind = rng.random_range(0..20);
    for (j, joint) in robot.joints.iter().enumerate() {
        let step = joint.max_velocity * 0.05;
        target[j] = match kind {
            0 if rng.random_range(0..3) == 0 => odd_angle(rng),
            1 => target[j] + step * if rng.random() { 1.0 } else { -1.0 },
            2 => [joint.lower, joint.upper][rng.random_range(0..2)],
            _ => (target[j] + step * heading[j]).clamp(joint.lower, joint.upper),
        };
    }
    ControlAction { target, gripper: if rng.random() { Gripper::Open } else { Gripper::Close } }
}

/// Outcomes of control steps.
#[derive(Debug, Default)]
struct Tally {
    valid: usize,
    refused: usize,
    ended: usize,
}

/// Control steps with arbitrary targets, starting over where the world has ended an episode.
fn fuzz(task: &Arc<Task>, robot: &Arc<Robot>, n_steps: usize) -> Tally {
    let mut rng = stream(1, Stream::Explore, 0);
    let start = environment(task, robot, 3);
    let (mut env, mut tally, mut heading) = (start.clone(), Tally::default(), [0.0; DOF]);
    for step in 0..n_steps {
        if step % 20 == 0 {
            heading = core::array::from_fn(|_| rng.random_range(-1.0..1.0));
        }
        let before = env.world().hash();
        let action = fuzzed(robot, env.world().config(), &heading, &mut rng);
        let result = env.control_step(&action);
        assert_finite(env.world());
        match result.invalid {
            None => tally.valid += 1,
            Some(InvalidAction::OutsideLimits | InvalidAction::JointSpeed { .. }) => {
                assert_eq!(
                    env.world().hash(),
                    before,
                    "{action:?} was refused and changed the world"
                );
                tally.refused += 1;
            }
            Some(_) => tally.ended += 1,
        }
        if step % 100 == 0 {
            assert_observation_is_finite(&mut env);
        }
        if !matches!(
            result.invalid,
            None | Some(InvalidAction::OutsideLimits | InvalidAction::JointSpeed { .. })
        ) {
            env = start.clone();
        }
    }
    tally
}

/// Half of the hundred thousand steps that both robots do, spread over the tasks.
fn fuzz_tasks(robot: &Arc<Robot>) {
    let mut sum = Tally::default();
    for task in TASKS.iter() {
        let tally = fuzz(task, robot, 50_000 / TASKS.len());
        sum.valid += tally.valid;
        sum.refused += tally.refused;
        sum.ended += tally.ended;
    }
    assert!(
        sum.valid > 25_000 && sum.refused > 1000 && sum.ended > 50,
        "the fuzz is lopsided: {sum:?}"
    );
}

#[test]
fn fifty_thousand_arbitrary_targets_of_the_xarm7_break_nothing() {
    fuzz_tasks(&XARM7);
}

#[test]
fn fifty_thousand_arbitrary_targets_of_the_panda_break_nothing() {
    fuzz_tasks(&PANDA);
}

#[test]
fn a_target_is_reached_exactly_and_limits_are_kept_to_the_bit() {
    let mut env = environment(&TASKS[0], &PANDA, 0);
    let mut target = *env.world().config();
    target[3] += PANDA.joints[3].max_velocity * 0.05;
    assert_eq!(env.control_step(&ControlAction { target, gripper: Gripper::Open }).invalid, None);
    assert_eq!(*env.world().config(), target);
    for (value, expected) in
        [(f32::NAN, "outside_limits"), (f32::INFINITY, "outside_limits"), (1.0, "joint_speed")]
    {
        let mut target = target;
        target[6] = value;
        let refused = env.control_step(&ControlAction { target, gripper: Gripper::Open });
        assert_eq!(
            (refused.invalid.map(|it| it.name()), refused.terminated),
            (Some(expected), true)
        );
    }
}

#[test]
fn a_lid_is_lifted_by_control_steps_alone() {
    let mut env = environment(&Task::by_name("take_lid_off_saucepan").unwrap(), &XARM7, 1);
    let start = env.clone();
    let demo = demonstrate(&mut env, &mut stream(1, Stream::Demo, 0));
    let closes_at = demo.waypoint_frames[1] - 1;
    let mut env = start;
    let mut do_step = |target: &JointConfig, gripper| {
        env.control_step(&ControlAction { target: *target, gripper })
    };
    for frame in &demo.frames[..closes_at] {
        assert_eq!(do_step(frame.config(), Gripper::Open).invalid, None);
    }
    for _ in 0..40 {
        assert_eq!(do_step(demo.frames[closes_at].config(), Gripper::Close).invalid, None);
    }
    let rewards: f32 = demo.frames[closes_at..]
        .iter()
        .map(|frame| do_step(frame.config(), Gripper::Close).reward)
        .sum();
    assert!(rewards > 0.0, "{:?}", env.world().grasp());
    assert!(matches!(env.world().grasp(), Grasp::Attached { .. }));
}

#[test]
fn a_path_of_one_place_is_done_at_once() {
    let mut env = environment(&TASKS[0], &XARM7, 0);
    let config = *env.world().config();
    let result = env.step(&JointPath::new(vec![config; 2]).unwrap(), Gripper::Open);
    assert_eq!((result.invalid, *env.world().config()), (None, config));
}

#[test]
fn a_path_of_ten_thousand_configurations_is_followed() {
    let mut env = environment(&TASKS[0], &XARM7, 0);
    let start = *env.world().config();
    let mut goal = start;
    goal[0] += 0.5;
    let configs = (0..10_000).map(|i| start.lerp(&goal, i as f32 / 9999.0)).collect();
    assert_eq!(env.step(&JointPath::new(configs).unwrap(), Gripper::Open).invalid, None);
    assert!(env.world().config().max_joint_distance(&goal) < 1e-6);
}

#[test]
fn a_path_that_would_take_hours_is_refused() {
    let mut env = environment(&TASKS[0], &XARM7, 0);
    let (start, before) = (*env.world().config(), env.world().hash());
    let mut turned = start;
    turned[0] = 6.0;
    let configs = (0..10_000).map(|i| if i % 2 == 0 { start } else { turned }).collect();
    let result = env.step(&JointPath::new(configs).unwrap(), Gripper::Open);
    assert!(matches!(result.invalid, Some(InvalidAction::TooLong { .. })), "{result:?}");
    assert_eq!(env.world().hash(), before);
}

#[test]
fn a_path_that_is_not_a_number_cannot_be_made() {
    let mut broken = XARM7.start;
    broken[DOF - 1] = f32::NAN;
    assert!(JointPath::new(vec![XARM7.start, broken]).is_err());
    assert!(JointPath::new(vec![XARM7.start]).is_err());
}

#[test]
fn what_falls_off_the_table_comes_to_rest_below_it() {
    let task = Task::by_name("pick_and_lift").unwrap();
    let mut env = environment(&task, &XARM7, 0);
    let body =
        env.world().spec().bodies.iter().position(|body| body.kind == BodyKind::Graspable).unwrap();
    env.world.throw(body, [6.0, 0.0, 1.0].into());
    let action = ControlAction { target: *env.world().config(), gripper: Gripper::Open };
    for _ in 0..400 {
        assert_eq!(env.control_step(&action).invalid, None);
        assert_finite(env.world());
    }
    let fallen = env.world().body_pose(body).translation;
    assert!((-2.0..-0.5).contains(&fallen.z), "{fallen}");
    let still = env.world().hash();
    env.control_step(&action);
    assert_eq!(env.world().hash(), still, "nothing moves any more");
    assert_observation_is_finite(&mut env);
}
