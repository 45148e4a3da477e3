use super::closed_form::exact_pose;
use super::{Angles, DOF, JointConfig, Pose3, Robot, differ};
use crate::rng::{Stream, stream};
use crate::robot::{Joint, PANDA, ROBOTS, XARM7};
use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use glamx::{DPose3, Quat, Vec3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn config_at(robot: &Robot, fractions: [f32; DOF]) -> JointConfig {
    JointConfig::from_fn(DOF, |j| {
        let joint = &robot.joints[j];
        (joint.lower + fractions[j] * (joint.upper - joint.lower)).clamp(joint.lower, joint.upper)
    })
}

/// Distance in metres and angle in radians.
fn pose_error(a: &DPose3, b: &DPose3) -> (f64, f64) {
    let turn = a.rotation.inverse() * b.rotation;
    let sine = (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z).sqrt();
    ((a.translation - b.translation).length(), 2.0 * sine.atan2(turn.w.abs()))
}

fn grip_at(robot: &Robot, angles: &Angles) -> DPose3 {
    robot.frames_at(angles).tip * robot.body_from_flange * robot.flange_from_grip
}

fn assert_solves(robot: &Robot, config: &JointConfig, pose: &Pose3) {
    let (distance, angle) = pose_error(&robot.grip_f64(config), &exact_pose(pose));
    assert!(
        distance < 1e-4 && angle < 1e-3,
        "{}: {distance} m, {angle} rad off at {config:?}",
        robot.name
    );
    assert!(robot.within_limits(config), "{}: outside the limits: {config:?}", robot.name);
}

#[test]
fn nearest_solution_is_found_and_is_no_further_than_a_known_one() {
    for robot in ROBOTS {
        let mut rng = stream(1, Stream::Ik, 0);
        let mut draw = || config_at(robot, core::array::from_fn(|_| rng.random()));
        let mut n_worse = 0;
        for _ in 0..1000 {
            let (config, near) = (draw(), draw());
            let pose = robot.grip(&config);
            let found = robot
                .ik_nearest(&pose, &near)
                .expect("the pose was made by a configuration within the limits");
            assert_solves(robot, &found, &pose);
            n_worse += usize::from(found.distance(&near) > config.distance(&near) + 1e-2);
        }
        // The scan may miss intervals of q7 narrower than its spacing.
        assert!(n_worse <= 5, "{}: {n_worse} of 1000", robot.name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn closed_form_recovers_the_configuration_and_every_branch_is_exact(fractions in proptest::array::uniform7(0.0f32..=1.0)) {
        for robot in ROBOTS {
            let config = config_at(robot, fractions);
            let pose = robot.grip(&config);
            let branches = robot.ik_all_at(&pose, f64::from(config[6]), &config);
            for (angles, rounded) in branches.angles().iter().zip(branches.iter()) {
                let (distance, angle) = pose_error(&grip_at(robot, angles), &exact_pose(&pose));
                prop_assert!(distance < 1e-6 && angle < 1e-6, "{}: {distance} m, {angle} rad", robot.name);
                assert_solves(robot, &rounded, &pose);
            }
            // Near singular configurations the joints are ill-conditioned in the pose, which is
            // rounded to f32.
            let recovered = branches.iter().map(|found| found.max_joint_distance(&config)).fold(f32::INFINITY, f32::min);
            prop_assert!(recovered < 0.02, "{}: nearest branch is {recovered} rad from {config:?}", robot.name);
        }
    }

    #[test]
    fn distinct_solutions_solve_and_differ(fractions in proptest::array::uniform7(0.0f32..=1.0), seed in 0u64..1000) {
        for robot in ROBOTS {
            let config = config_at(robot, fractions);
            let pose = robot.grip(&config);
            let found = robot.ik_distinct(&pose, 20, 0.2, &robot.start, &mut stream(seed, Stream::Ik, 0));
            prop_assert!(found.len() <= 20);
            for (i, config) in found.iter().enumerate() {
                assert_solves(robot, config, &pose);
                prop_assert!(found[..i].iter().all(|other| differ(config, other, 0.2)));
            }
        }
    }
}

#[test]
fn distinct_finds_twenty_for_most_poses() {
    // The Panda's limits leave fewer solutions than the xArm7's.
    for (robot, at_least) in [(&XARM7, 960), (&PANDA, 720)] {
        let mut rng = stream(2, Stream::Ik, 0);
        let n_full = (0..1000).filter(|_| {
            let pose = robot.grip(&config_at(robot, core::array::from_fn(|_| rng.random())));
            let found = robot.ik_distinct(&pose, 20, 0.2, &robot.start, &mut rng);
            assert!(!found.is_empty(), "{}: a reachable pose without solution", robot.name);
            found.len() == 20
        });
        let n_full = n_full.count();
        assert!(n_full >= at_least, "{}: {n_full}", robot.name);
    }
}

#[test]
fn distinct_solutions_spread_over_the_last_joint() {
    for robot in ROBOTS {
        let pose = robot.grip(&robot.start);
        let found = robot.ik_distinct(&pose, 20, 0.2, &robot.start, &mut stream(3, Stream::Ik, 0));
        let mut q7: Vec<f32> = found.iter().map(|config| config[6]).collect();
        q7.sort_by(f32::total_cmp);
        q7.dedup_by(|a, b| *a - *b < 0.01);
        assert!(q7.len() >= 8, "{}: {q7:?}", robot.name);
    }
}

/// The hand approaches along +x, tilted down by `tilt`, turned about its approach as in the start
/// configurations.
fn forward(x: f32, y: f32, z: f32, tilt: f32) -> Pose3 {
    Pose3::from_parts(
        Vec3::new(x, y, z),
        Quat::from_rotation_y(FRAC_PI_2 + tilt) * Quat::from_rotation_z(PI),
    )
}

/// Largest joint step on the way through `poses`, from the solution of `start` nearest the robot's
/// start configuration.
fn follow(robot: &Robot, start: &Pose3, poses: impl Iterator<Item = Pose3>) -> f32 {
    let mut config = robot.ik_nearest(start, &robot.start).expect("the start is reachable");
    poses.enumerate().fold(0.0, |most, (i, pose)| {
        let next = robot
            .ik_step(&pose, &config)
            .unwrap_or_else(|| panic!("{}: stopped at {i}, {config:?}", robot.name));
        assert_solves(robot, &next, &pose);
        let step = next.max_joint_distance(&config);
        config = next;
        most.max(step)
    })
}

#[test]
fn step_follows_doors_through_a_right_angle() {
    for (robot, side, (x, y, tilt)) in
        product([(0.5, 0.0, FRAC_PI_4), (0.6, 0.15, FRAC_PI_4), (0.55, 0.1, FRAC_PI_2)])
    {
        let start = forward(x, side * y, 0.3 + 0.2 * y, tilt);
        let hinge = start.translation - side * 0.3 * Vec3::Y;
        let door = (1..=45).map(|i| {
            let turn = Quat::from_rotation_z(side * FRAC_PI_2 * i as f32 / 45.0);
            Pose3::from_parts(hinge + turn * (start.translation - hinge), turn * start.rotation)
        });
        let step = follow(robot, &start, door);
        assert!(step < 0.15, "{}: a joint moved {step} rad in 2 degrees of the door", robot.name);
    }
}

#[test]
fn step_follows_straight_pulls() {
    for (robot, side, (x, y, tilt)) in
        product([(0.6, 0.3, 0.0), (0.6, 0.15, FRAC_PI_4), (0.55, 0.1, FRAC_PI_2)])
    {
        let start = forward(x, side * y, 0.3, tilt);
        let pull = (1..=25).map(|i| {
            Pose3::from_parts(start.translation - 0.01 * i as f32 * Vec3::X, start.rotation)
        });
        let step = follow(robot, &start, pull);
        assert!(step < 0.1, "{}: a joint moved {step} rad in 1 cm", robot.name);
    }
}

/// Both robots on both sides with every start.
fn product<const N: usize>(
    starts: [(f32, f32, f32); N],
) -> impl Iterator<Item = (&'static Robot, f32, (f32, f32, f32))> {
    ROBOTS.into_iter().flat_map(move |robot| {
        let robot: &Robot = robot;
        [1.0, -1.0].into_iter().flat_map(move |side| starts.map(|start| (robot, side, start)))
    })
}

#[test]
fn step_stays_where_the_pose_stays() {
    for robot in ROBOTS {
        let found = robot
            .ik_step(&robot.grip(&robot.start), &robot.start)
            .expect("the pose is that of the start");
        assert!(found.max_joint_distance(&robot.start) < 1e-5, "{}: {found:?}", robot.name);
    }
}

#[test]
fn step_refuses_a_jump() {
    for robot in ROBOTS {
        let mut far = robot.grip(&robot.start);
        far.rotation *= Quat::from_rotation_z(2.0);
        assert!(robot.ik_nearest(&far, &robot.start).is_some());
        assert_eq!(robot.ik_step(&far, &robot.start), None, "{}", robot.name);
    }
}

#[test]
fn singular_configurations_are_solved() {
    // Shoulder and wrist straight (q2 = 0, q6 = 0), elbow at the end of its reach, and all at once.
    let configs: [[f32; DOF]; 5] = [
        [0.3, 0.0, 0.4, 0.9, 0.2, 1.0, 0.1],
        [0.3, 0.5, 0.4, 0.9, 0.2, 0.0, 0.1],
        [0.3, 0.5, 0.4, 0.0, 0.2, 0.8, 0.1],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0],
    ];
    for robot in ROBOTS {
        for mut config in configs.map(JointConfig::new) {
            if robot.name == "panda" {
                config[3] = -0.07 - config[3];
            }
            let pose = robot.grip(&config);
            for found in robot.ik_all_at(&pose, f64::from(config[6]), &config).iter() {
                assert_solves(robot, &found, &pose);
            }
            assert_solves(robot, &robot.ik_nearest(&pose, &config).expect("reachable"), &pose);
            assert_solves(robot, &robot.ik_step(&pose, &config).expect("reachable"), &pose);
        }
    }
}

#[test]
fn elbow_fully_stretched_is_solved() {
    // The elbow angle of the farthest wrist is no round number: ternary search.
    let reach = |q4: f32| {
        let frames = XARM7.joint_frames(&JointConfig::new([0.0, 0.0, 0.0, q4, 0.0, 0.0, 0.0]));
        (frames[5].translation - frames[0].translation).length()
    };
    let (mut low, mut high) = (-0.1f32, 1.0f32);
    for _ in 0..60 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if reach(a) < reach(b) { low = a } else { high = b }
    }
    let config = JointConfig::new([0.4, 0.7, -0.3, low, 0.5, 1.0, 0.2]);
    let pose = XARM7.grip(&config);
    let found = XARM7.ik_nearest(&pose, &config).expect("reachable");
    assert_solves(&XARM7, &found, &pose);
}

#[test]
fn unreachable_and_broken_poses_have_no_solution() {
    let far = Pose3::from_translation(Vec3::new(3.0, 0.0, 0.5));
    let nan = Pose3::from_translation(Vec3::new(f32::NAN, 0.0, 0.5));
    let no_rotation =
        Pose3::from_parts(Vec3::new(0.4, 0.0, 0.4), Quat::from_xyzw(0.0, 0.0, 0.0, 0.0));
    for robot in ROBOTS {
        for pose in [far, nan, no_rotation] {
            assert!(robot.ik_all_at(&pose, 0.3, &robot.start).is_empty());
            assert_eq!(robot.ik_nearest(&pose, &robot.start), None);
            assert_eq!(robot.ik_step(&pose, &robot.start), None);
            assert!(
                robot
                    .ik_distinct(&pose, 20, 0.2, &robot.start, &mut stream(0, Stream::Ik, 0))
                    .is_empty()
            );
        }
        assert!(robot.ik_all_at(&robot.grip(&robot.start), f64::NAN, &robot.start).is_empty());
    }
}

#[test]
fn windings_are_the_nearest_to_the_reference() {
    let mut near = XARM7.start;
    near[0] = 6.0;
    let pose = XARM7.grip(&XARM7.start);
    let found = XARM7.ik_nearest(&pose, &near).expect("reachable");
    assert!((found[0] - 6.0).abs() < 0.5, "q1 = {} should be near 2 pi", found[0]);
}

#[test]
fn both_arms_have_the_structure_that_the_closed_form_assumes() {
    for robot in ROBOTS {
        let rows: Vec<_> = robot.joints.iter().filter_map(Joint::dh).collect();
        let [joint1, joint2, joint3, joint4, joint5, joint6, joint7] = rows[..] else {
            panic!("{}: {rows:?}", robot.name)
        };
        assert_eq!(
            (joint1.alpha, joint1.a, joint2.a, joint2.d, joint3.a),
            (0.0, 0.0, 0.0, 0.0, 0.0)
        );
        assert_eq!((joint4.d, joint6.a, joint6.d), (0.0, 0.0, 0.0));
        let quarter = core::f64::consts::FRAC_PI_2;
        assert_eq!(
            [joint2, joint3, joint4, joint6].map(|joint| joint.alpha),
            [-quarter, quarter, quarter, quarter]
        );
        assert!([joint5, joint7].iter().all(|joint| joint.alpha.abs() == quarter));
    }
}
