use super::closed_form::exact_pose;
use super::*;
use crate::rng::{Stream, stream};
use crate::robot::ROBOTS;
use glamx::DPose3;
use proptest::prelude::*;

fn config_at(robot: &Robot, fractions: [f32; DOF]) -> JointConfig {
    JointConfig(core::array::from_fn(|j| {
        let joint = &robot.joints[j];
        (joint.lower + fractions[j] * (joint.upper - joint.lower)).clamp(joint.lower, joint.upper)
    }))
}

/// Distance in metres and angle in radians.
fn pose_error(a: &DPose3, b: &DPose3) -> (f64, f64) {
    let turn = a.rotation.inverse() * b.rotation;
    let sine = (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z).sqrt();
    ((a.translation - b.translation).length(), 2.0 * sine.atan2(turn.w.abs()))
}

fn grip_at(robot: &Robot, angles: &Angles) -> DPose3 {
    robot.frames_at(angles)[DOF - 1] * robot.link7_from_flange * robot.flange_from_grip
}

fn assert_solves(robot: &Robot, config: &JointConfig, pose: &Pose3) {
    let (distance, angle) = pose_error(&robot.grip_f64(config), &exact_pose(pose));
    assert!(distance < 1e-4 && angle < 1e-3, "{}: {distance} m, {angle} rad off at {config:?}", robot.name);
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
            let found = robot.ik_nearest(&pose, &near).expect("the pose was made by a configuration within the limits");
            assert_solves(robot, &found, &pose);
            n_worse += usize::from(found.distance(&near) > config.distance(&near) + 1e-2);
        }
        // The scan may miss intervals of q7 narrower than its spacing.
        assert!(n_worse <= 5, "{}: {n_worse} of 1000", robot.name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

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
            // Near singular configurations the joints are ill-conditioned in the pose, which is rounded to f32.
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
                prop_assert!(found[..i].iter().all(|other| differ(config, other) > 0.2));
            }
        }
    }
}
