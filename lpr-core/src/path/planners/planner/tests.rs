use super::*;
use crate::path::joint_path::JointPath;
use crate::path::planners::test_scenes::{is_free_densely, turned, wall_with_window};
use crate::rng::{Stream, stream};
use crate::robot::DOF;
use crate::scene::stick_arm::stick_arm;
use crate::scene::{ArmSpheres, Primitive, Scene};
use glamx::Vec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn settings() -> PlannerSettings {
    PlannerSettings::standard(RrtSettings {
        range: 1.0,
        checks_per_radian: 32.0,
        max_iterations: 2000,
    })
}

/// A post that the turning arm would hit; it passes by drawing back or rising.
fn post() -> Scene {
    let grip = stick_arm().grip(&stick_arm().start).translation;
    let top = Vec3::new(grip.x, 0.0, grip.z);
    Scene::from_primitives(vec![Primitive::Capsule {
        a: Vec3::new(grip.x, 0.0, 0.0),
        b: top,
        radius: 0.02,
    }])
}

fn plan(
    kind: PlannerKind,
    scene: &Scene,
    ends: [JointConfig; 2],
    seed: u64,
) -> Result<Plan, Rejection> {
    let arm = ArmSpheres::new(&stick_arm());
    let checker = MotionChecker::new(scene, &arm, 32.0);
    plan_with(
        kind,
        &checker,
        &ends[0],
        &ends[1..],
        &settings(),
        &mut stream(seed, Stream::Planner, 0),
    )
}

fn assert_sound(scene: &Scene, path: &JointPath, ends: [JointConfig; 2]) {
    let robot = stick_arm();
    assert_eq!([*path.start(), *path.goal()], ends);
    assert!(path.configs().iter().all(|config| robot.within_limits(config)));
    assert!(is_free_densely(&robot, scene, path));
}

#[test]
fn every_planner_finds_ways_around_a_post() {
    let (scene, ends) = (post(), [turned(-0.8), turned(0.8)]);
    for &kind in PlannerKind::ALL {
        for seed in 0..4 {
            let plan = plan(kind, &scene, ends, seed)
                .unwrap_or_else(|reason| panic!("{}: {reason:?}", kind.name()));
            assert!(plan.iterations > 0, "the post stands in the straight way");
            assert_sound(&scene, &plan.path, ends);
        }
    }
}

#[test]
fn all_but_stomp_find_ways_through_a_narrow_window() {
    let (scene, ends) = (wall_with_window(), [turned(-0.7), turned(0.7)]);
    for kind in PlannerKind::ALL.iter().copied().filter(|kind| *kind != PlannerKind::Stomp) {
        for seed in 0..5 {
            let plan = plan(kind, &scene, ends, seed)
                .unwrap_or_else(|reason| panic!("{}: {reason:?}", kind.name()));
            assert!(plan.iterations > 0, "the wall stands in the straight way");
            assert_sound(&scene, &plan.path, ends);
        }
    }
}

#[test]
fn an_optimisation_that_does_not_get_through_says_so() {
    let (scene, arm) = (wall_with_window(), ArmSpheres::new(&stick_arm()));
    let checker = MotionChecker::new(&scene, &arm, 32.0);
    let mut settings = settings();
    (settings.trajopt.beginnings, settings.trajopt.steps) = (1, 2);
    (settings.stomp.beginnings, settings.stomp.steps) = (1, 2);
    for kind in [PlannerKind::TrajOpt, PlannerKind::Stomp] {
        let rng = &mut stream(0, Stream::Planner, 0);
        let plan = plan_with(kind, &checker, &turned(-0.7), &[turned(0.7)], &settings, rng);
        assert_eq!(
            plan,
            Err(Rejection::OptimizationFailed),
            "{}: two steps do not lead out of the wall",
            kind.name()
        );
    }
}

#[test]
fn a_seed_gives_one_path() {
    let (scene, ends) = (post(), [turned(-0.8), turned(0.8)]);
    for &kind in PlannerKind::ALL {
        assert_eq!(plan(kind, &scene, ends, 1), plan(kind, &scene, ends, 1), "{}", kind.name());
    }
}

#[test]
fn a_straight_way_is_taken_by_every_planner() {
    let ends = [turned(-0.7), turned(-1.2)];
    for &kind in PlannerKind::ALL {
        let straight = Plan { path: JointPath(ends.to_vec()), iterations: 0 };
        assert_eq!(plan(kind, &wall_with_window(), ends, 0), Ok(straight));
    }
}

#[test]
fn failures_have_their_reasons() {
    let (scene, arm) = (wall_with_window(), ArmSpheres::new(&stick_arm()));
    let checker = MotionChecker::new(&scene, &arm, 32.0);
    let mut settings = settings();
    settings.rrt.max_iterations = 0;
    settings.sbl.max_iterations = 0;
    settings.kpiece.max_iterations = 0;
    settings.trajopt.beginnings = 0;
    settings.stomp.beginnings = 0;
    for &kind in PlannerKind::ALL {
        let plan = |start, goals: &[JointConfig]| {
            plan_with(kind, &checker, &start, goals, &settings, &mut stream(0, Stream::Planner, 0))
        };
        let exhausted = match kind {
            PlannerKind::RrtConnect | PlannerKind::Sbl | PlannerKind::Kpiece => {
                Rejection::IterationLimit
            }
            PlannerKind::TrajOpt | PlannerKind::Stomp => Rejection::OptimizationFailed,
        };
        assert_eq!(plan(turned(0.0), &[turned(0.7)]), Err(Rejection::StartCollides));
        assert_eq!(plan(turned(-0.7), &[turned(0.0)]), Err(Rejection::GoalCollides));
        assert_eq!(plan(turned(-0.7), &[turned(0.7)]), Err(exhausted));
        assert_eq!(plan(turned(-0.7), &[]), Err(Rejection::Unreachable));
    }
}

#[test]
fn goals_outside_the_limits_are_no_goals_and_ends_that_are_no_numbers_no_ends() {
    let far = turned(-1.2).map(|q| q + 9.0);
    let broken = JointConfig::new([f32::NAN; DOF]);
    for &kind in PlannerKind::ALL {
        let plan = |start, goals: &[JointConfig]| {
            let (scene, arm) = (Scene::empty(), ArmSpheres::new(&stick_arm()));
            let checker = MotionChecker::new(&scene, &arm, 32.0);
            plan_with(
                kind,
                &checker,
                &start,
                goals,
                &settings(),
                &mut stream(0, Stream::Planner, 0),
            )
        };
        assert_eq!(plan(turned(-0.7), &[far]), Err(Rejection::OutsideLimits));
        assert_eq!(plan(turned(-0.7), &[broken]), Err(Rejection::OutsideLimits));
        assert_eq!(plan(broken, &[turned(-0.7)]), Err(Rejection::OutsideLimits));
        let found = plan(turned(-0.7), &[far, broken, turned(-1.2)]).expect("the last goal is one");
        assert_eq!(*found.path.goal(), turned(-1.2));
    }
}

#[test]
fn an_arm_that_stands_beyond_its_limits_is_led_back() {
    let robot = stick_arm();
    let mut beyond = turned(-0.7);
    beyond[5] = robot.joints[5].upper + 0.02;
    assert!(!robot.within_limits(&beyond));
    for &kind in PlannerKind::ALL {
        let found = plan(kind, &wall_with_window(), [beyond, turned(-1.2)], 0)
            .expect("nothing is in the way");
        assert_eq!((*found.path.start(), *found.path.goal()), (beyond, turned(-1.2)));
    }
}

#[test]
fn the_world_may_be_empty() {
    for &kind in PlannerKind::ALL {
        let found = plan(kind, &Scene::empty(), [turned(-0.7), turned(0.7)], 0)
            .expect("nothing is in the way");
        assert_eq!(found.iterations, 0);
    }
}

#[test]
fn a_planner_stops_when_it_is_told_to_and_asks_in_every_iteration() {
    let (scene, arm) = (wall_with_window(), ArmSpheres::new(&stick_arm()));
    for &kind in PlannerKind::ALL {
        let questions = core::cell::Cell::new(0);
        let stop = || {
            questions.set(questions.get() + 1);
            questions.get() > 3
        };
        let checker = MotionChecker::new(&scene, &arm, 32.0).stopped_by(&stop);
        let plan = plan_with(
            kind,
            &checker,
            &turned(-0.7),
            &[turned(0.7)],
            &settings(),
            &mut stream(0, Stream::Planner, 0),
        );
        assert!(
            matches!(plan, Err(Rejection::Stopped)) || plan.is_ok_and(|plan| plan.iterations <= 4),
            "{}",
            kind.name()
        );
        let never = MotionChecker::new(&scene, &arm, 32.0).stopped_by(&|| true);
        let plan = plan_with(
            kind,
            &never,
            &turned(-0.7),
            &[turned(0.7)],
            &settings(),
            &mut stream(0, Stream::Planner, 0),
        );
        assert_eq!(plan, Err(Rejection::Stopped), "{}", kind.name());
    }
}

#[test]
fn a_planner_that_was_left_out_is_told_from_one_that_there_is_not() {
    for name in FURTHER {
        assert_eq!(PlannerKind::by_name(name).map(PlannerKind::name), Ok(name));
        let expected = format!(
            "planner: expected one of rrt-connect, found '{name}' (built without the feature planners)"
        );
        assert_eq!(refusal(name, &[PlannerKind::RrtConnect]), expected);
    }
    let expected = "planner: expected one of rrt-connect, sbl, kpiece, trajopt, stomp, found 'prm'";
    assert_eq!(refusal("prm", PlannerKind::ALL), expected);
}

#[test]
fn names_are_those_of_settings_files() {
    for &kind in PlannerKind::ALL {
        assert_eq!(toml::Value::try_from(kind), Ok(toml::Value::String(kind.name().to_owned())));
    }
}

/// Numbers that no settings file should have.
fn odd_number() -> impl Strategy<Value = f32> {
    prop::sample::select(vec![
        0.0,
        -1.0,
        1e-30,
        0.5,
        1e30,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ])
}

/// Settings of small searches, in which any number may be odd.
fn odd_settings() -> impl Strategy<Value = PlannerSettings> {
    let budgets = prop::array::uniform6(0..4_usize);
    (prop::array::uniform20(odd_number()), budgets).prop_map(|(x, n)| PlannerSettings {
        rrt: RrtSettings { range: x[0], checks_per_radian: 32.0, max_iterations: 20 },
        sbl: SblSettings {
            range: x[1],
            neighbourhoods: n[0] as u32,
            milestones_per_grid: n[1] as u32,
            max_iterations: 20,
        },
        kpiece: KpieceSettings {
            range: x[2],
            cell: x[3],
            exterior_share: x[4],
            failure_score: x[5],
            max_iterations: 20,
        },
        trajopt: TrajoptSettings {
            waypoints: n[2],
            looks: n[3],
            safe_distance: x[6],
            seen_distance: x[7],
            penalty: x[8],
            penalty_growth: x[9],
            growths: 2,
            trust: x[10],
            least_trust: x[11],
            trust_growth: x[12],
            trust_shrink: x[13],
            accepted_gain: x[14],
            least_gain: x[15],
            sweeps: 3,
            steps: 5,
            beginnings: 3,
        },
        stomp: StompSettings {
            waypoints: n[2],
            looks: n[3],
            copies: n[4],
            kept_copies: n[5],
            noise: x[16],
            sensitivity: x[17],
            safe_distance: x[18],
            steps: 5,
            beginnings: 3,
        },
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn settings_that_make_no_sense_give_a_free_path_or_a_reason(settings in odd_settings(), seed in 0..1000_u64) {
        let (scene, arm) = (wall_with_window(), ArmSpheres::new(&stick_arm()));
        let checker = MotionChecker::new(&scene, &arm, 32.0);
        for &kind in PlannerKind::ALL {
            let rng = &mut stream(seed, Stream::Planner, 0);
            if let Ok(plan) = plan_with(kind, &checker, &turned(-0.7), &[turned(0.7)], &settings, rng) {
                prop_assert!(checker.path_is_free(plan.path.configs()), "{}", kind.name());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_planner_returns_a_path_that_collides(
        balls in prop::collection::vec((0.2_f32..0.8, -0.6_f32..0.6, 0.1_f32..0.9, 0.02_f32..0.12), 1..8),
        turns in prop::array::uniform2(-1.2_f32..1.2),
        seed in 0..1000_u64,
    ) {
        let ball = |&(x, y, z, radius): &(f32, f32, f32, f32)| Primitive::Sphere { center: Vec3::new(x, y, z), radius };
        let scene = Scene::from_primitives(balls.iter().map(ball).collect());
        let ends = turns.map(turned);
        for &kind in PlannerKind::ALL {
            if let Ok(plan) = plan(kind, &scene, ends, seed) {
                assert_sound(&scene, &plan.path, ends);
            }
        }
    }
}
