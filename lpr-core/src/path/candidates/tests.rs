use super::sampler::goal_configs;
use super::*;
use crate::error::Error;
use crate::path::curves::BezierSettings;
use crate::path::joint_path::JointPath;
use crate::path::planners::{PlannerKind, RrtSettings};
use crate::path::rejection::Rejection;
use crate::path::source::Source;
use crate::robot::{JointConfig, ROBOTS, Robot, XARM7};
use crate::scene::stick_arm::stick_arm;
use crate::scene::{
    ArmSpheres, Held, MotionChecker, ObstacleQuery, Primitive, Scene, obstacle_scene,
};
use glamx::{Pose3, Quat, Vec2, Vec3};
use proptest::prelude::*;

const STREAMS: CandidateStreams = CandidateStreams { seed: 11, step: 3 };

fn settings() -> CandidateSettings {
    CandidateSettings {
        planner_paths: 8,
        bezier_paths: 6,
        bezier: BezierSettings { sigma: 0.1 },
        ..CandidateSettings::EXAMPLE
    }
}

/// The grip of the arm's start, moved.
fn goal(robot: &Robot, by: [f32; 3]) -> Pose3 {
    let start = robot.grip(&robot.start);
    Pose3::from_parts(start.translation + Vec3::from_array(by), start.rotation)
}

fn query<'a>(robot: &'a Robot, scene: &'a Scene, goal: Pose3) -> PathQuery<'a> {
    PathQuery { robot, start: robot.start, goal, scene }
}

/// A table and a post, as a camera's cloud.
fn tabletop(robot: &Robot, goal: &Pose3) -> Scene {
    let table = (0..50_u8).flat_map(|x| {
        (0..60_u8).map(move |y| Vec3::new(f32::from(x), f32::from(y) - 30.0, 0.0) * 0.02)
    });
    let post = (0..30_u8).map(|z| Vec3::new(0.5, 0.1, 0.02 * f32::from(z)));
    let points: Vec<Vec3> = table.chain(post).collect();
    let query =
        ObstacleQuery { robot, measured: &robot.start, goal: Some(goal), holding: Held::Nothing };
    obstacle_scene(&query, &points)
}

fn of_source(set: &CandidateSet, source: Source) -> Vec<&CandidatePath> {
    set.candidates.iter().filter(|candidate| candidate.source == source).collect()
}

fn reasons(set: &CandidateSet, source: Source) -> Vec<Rejection> {
    set.rejected
        .iter()
        .filter(|rejected| rejected.source == source)
        .map(|rejected| rejected.reason)
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn candidates_run_from_the_start_to_the_goal_within_limits(
        by in prop::array::uniform2(-0.1_f32..0.1),
        height in 0.05_f32..0.3,
        yaw in -1.0_f32..1.0,
        seed in 0..1000_u64,
    ) {
        for robot in ROBOTS {
            let at = (robot.workspace_center().unwrap() + Vec2::from_array(by)).extend(height);
            let goal = Pose3::from_parts(at, Quat::from_rotation_x(core::f32::consts::PI) * Quat::from_rotation_z(yaw));
            let scene = tabletop(robot, &goal);
            check(&query(robot, &scene, goal), CandidateStreams { seed, step: 0 })?;
        }
    }
}

/// Checks the rules of every candidate set whose goal is within reach.
fn check(query: &PathQuery<'_>, streams: CandidateStreams) -> Result<(), TestCaseError> {
    let PathQuery { robot, start, goal, scene } = *query;
    let set = candidates(query, &settings(), streams);
    prop_assert_eq!(&set, &candidates(query, &settings(), streams));
    prop_assert!(!set.candidates.is_empty());
    let arm = ArmSpheres::new(robot);
    for candidate in &set.candidates {
        let path = &candidate.path;
        prop_assert_eq!(path.configs().len(), 10);
        prop_assert_eq!(path.start(), &start);
        prop_assert!(path.configs().iter().all(|config| robot.within_limits(config)));
        let end = robot.grip(path.goal());
        prop_assert!(end.translation.distance(goal.translation) < 1e-3);
        prop_assert!(end.rotation.angle_between(goal.rotation) < 2e-3);
        let checker = MotionChecker::new(scene, &arm, 32.0);
        prop_assert_eq!(candidate.collides, !checker.path_is_free(path.configs()));
    }
    let shortest = set.shortest_free();
    for free in set.candidates.iter().filter(|candidate| !candidate.collides) {
        prop_assert!(shortest.unwrap().path.length() <= free.path.length());
    }
    Ok(())
}

#[cfg(feature = "parallel")]
#[test]
fn the_number_of_threads_changes_nothing() {
    let robot = stick_arm();
    let goal = goal(&robot, [-0.05, 0.3, -0.5]);
    let scene = tabletop(&robot, &goal);
    let with_threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| candidates(&query(&robot, &scene, goal), &settings(), STREAMS))
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn in_free_space_all_paths_are_admitted_and_none_collides() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let query = query(&robot, &scene, goal(&robot, [-0.05, 0.2, -0.4]));
    let set = candidates(
        &query,
        &CandidateSettings { bezier: BezierSettings { sigma: 0.02 }, ..settings() },
        STREAMS,
    );
    assert_eq!(
        (of_source(&set, Source::Planner).len(), of_source(&set, Source::Bezier).len()),
        (8, 6),
        "{:?}",
        set.rejected
    );
    assert!(of_source(&set, Source::Bezier).iter().all(|candidate| !candidate.collides));
}

#[test]
fn the_streams_of_planner_and_curves_are_apart() {
    let robot = stick_arm();
    let goal = goal(&robot, [-0.05, 0.3, -0.5]);
    let scene = tabletop(&robot, &goal);
    let query = query(&robot, &scene, goal);
    let reference = candidates(&query, &settings(), STREAMS);
    let more = candidates(&query, &CandidateSettings { bezier_paths: 12, ..settings() }, STREAMS);
    assert_eq!(of_source(&reference, Source::Planner), of_source(&more, Source::Planner));
    assert_eq!(
        of_source(&reference, Source::Bezier),
        of_source(&more, Source::Bezier)[..of_source(&reference, Source::Bezier).len()]
    );
    let other = candidates(&query, &settings(), CandidateStreams { step: 4, ..STREAMS });
    assert_ne!(of_source(&reference, Source::Bezier), of_source(&other, Source::Bezier));
}

#[test]
fn checks_on_give_free_paths_and_checks_off_straight_ones() {
    let robot = stick_arm();
    let goal = goal(&robot, [-0.1, 0.35, -0.35]);
    // A post between start and goal.
    let at = robot.grip(&robot.start).translation + Vec3::new(-0.05, 0.17, -0.17);
    let post = Primitive::Capsule { a: Vec3::new(at.x, at.y, 0.0), b: at, radius: 0.02 };
    let scene = Scene::from_primitives(vec![post]);
    let query = query(&robot, &scene, goal);
    let with_share = |planner_collision_free_fraction| {
        let settings = CandidateSettings {
            planner_collision_free_fraction,
            path_len: 30,
            bezier_paths: 0,
            ..settings()
        };
        candidates(&query, &settings, STREAMS).candidates
    };
    let checked = with_share(1.0);
    assert!(!checked.is_empty() && checked.iter().all(|candidate| !candidate.collides));
    let straight = with_share(0.0);
    assert!(straight.iter().any(|candidate| candidate.collides));
    for CandidatePath { path, .. } in &straight {
        assert!((path.length() - path.start().distance(path.goal())).abs() < 1e-4);
    }
}

#[test]
fn curves_around_a_curve_stay_near_it_and_are_those_of_their_draws() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let query = query(&robot, &scene, goal(&robot, [-0.1, 0.25, -0.2]));
    let around = |sigma: f32| {
        let refinement = Some(Refinement { best: 1, paths: 5, sigma });
        let settings = CandidateSettings { refinement, path_len: 30, ..settings() };
        let mut set = candidates(&query, &settings, STREAMS);
        let n = set.candidates.len();
        let is_curve = |&idx: &usize| set.candidates[idx].source == Source::Bezier;
        let center = (0..n).find(is_curve).expect("a curve");
        let further = PathSampler::new(&query, &settings, STREAMS).curves_around(&set, &[center]);
        set.add(further);
        let middle = |idx: usize| robot.grip(&set.candidates[idx].path.configs()[15]).translation;
        (n..set.candidates.len())
            .map(|idx| middle(idx).distance(middle(center)))
            .collect::<Vec<_>>()
    };
    let near = around(0.01);
    assert!(near.len() >= 4 && near.iter().all(|&off| off < 0.03), "{near:?}");
    assert_eq!(near, around(0.01));
    let far = around(0.1);
    assert!(far.iter().any(|&off| off > 0.03), "{far:?}");
    let none = settings();
    let sampler = PathSampler::new(&query, &none, STREAMS);
    assert!(sampler.curves_around(&candidates(&query, &none, STREAMS), &[0]).outcomes.is_empty());
}

#[test]
fn a_pose_out_of_reach_is_unreachable_for_every_path() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let query = query(&robot, &scene, goal(&robot, [3.0, 0.0, 0.0]));
    let set = candidates(&query, &settings(), STREAMS);
    assert!(set.candidates.is_empty());
    assert_eq!(reasons(&set, Source::Planner), [Rejection::Unreachable; 8]);
    assert_eq!(reasons(&set, Source::Bezier), [Rejection::Unreachable; 6]);
    assert_eq!(c2farm_path(&query, &settings(), STREAMS), Err(Rejection::Unreachable));
}

#[test]
fn a_start_or_goal_that_is_not_finite_gives_no_candidates() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let mut broken_start = query(&robot, &scene, goal(&robot, [0.0; 3]));
    broken_start.start[3] = f32::NAN;
    for query in [broken_start, query(&robot, &scene, goal(&robot, [f32::NAN, 0.0, 0.0]))] {
        let set = candidates(&query, &settings(), STREAMS);
        assert!(set.candidates.is_empty());
        assert!(set.rejected.iter().all(|rejected| rejected.reason == Rejection::Unreachable));
        assert!(c2farm_path(&query, &settings(), STREAMS).is_err());
    }
}

#[test]
fn a_start_or_goal_in_an_obstacle_leaves_the_paths_without_checks() {
    let robot = stick_arm();
    let goal = goal(&robot, [0.0, 0.3, -0.4]);
    for (at, reason) in
        [(robot.grip(&robot.start), Rejection::StartCollides), (goal, Rejection::GoalCollides)]
    {
        let scene =
            Scene::from_primitives(vec![Primitive::Sphere { center: at.translation, radius: 0.1 }]);
        let set = candidates(&query(&robot, &scene, goal), &settings(), STREAMS);
        assert_eq!(reasons(&set, Source::Planner), [reason; 4]);
        assert_eq!(of_source(&set, Source::Planner).len(), 4);
        assert!(set.candidates.iter().all(|candidate| candidate.collides));
        assert_eq!(set.shortest_free(), None);
    }
}

#[test]
fn too_few_goals_are_said_and_no_path_comes_twice() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let query = query(&robot, &scene, goal(&robot, [-0.05, 0.2, -0.4]));
    let settings = CandidateSettings { min_goal_distance: 3.2, ..settings() };
    let n_goals = goal_configs(&query, &settings, STREAMS).len();
    assert!(n_goals < 4, "the test asks for fewer goals than paths without checks");
    let set = candidates(&query, &settings, STREAMS);
    assert_eq!(of_source(&set, Source::Planner).len() + reasons(&set, Source::Planner).len(), 8);
    assert!(reasons(&set, Source::Planner).contains(&Rejection::TooFewGoals));
    for (i, a) in set.candidates.iter().enumerate() {
        assert!(set.candidates[i + 1..].iter().all(|b| a.path != b.path));
    }
}

#[test]
fn the_policy_path_is_admitted_when_short_and_its_ends_are_moved() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let goal = goal(&robot, [-0.05, 0.2, -0.4]);
    let near_goal = robot.ik_nearest(&goal, &robot.start).unwrap();
    let with_policy = |configs: Vec<JointConfig>, settings: &CandidateSettings| {
        let proposal = JointPath(configs);
        let query = query(&robot, &scene, goal);
        let paths = PathSampler::new(&query, settings, STREAMS);
        paths.join(paths.planner_paths(), paths.bezier_paths(), Some(Ok(proposal)))
    };
    let mut slightly_off = near_goal;
    slightly_off[2] += 0.05;
    let set = with_policy(vec![slightly_off, slightly_off], &settings());
    let admitted = of_source(&set, Source::Policy);
    assert_eq!(admitted.len(), 1, "{:?}", reasons(&set, Source::Policy));
    assert_eq!(admitted[0].path.start(), &robot.start);
    assert!(robot.grip(admitted[0].path.goal()).translation.distance(goal.translation) < 1e-3);

    let mut far = robot.start;
    far[0] = -2.8;
    let set = with_policy([robot.start, far].repeat(6), &settings());
    assert_eq!(reasons(&set, Source::Policy), [Rejection::LongerThanMean]);

    far[0] = -3.1;
    let set = with_policy(vec![far; 10], &settings());
    assert_eq!(reasons(&set, Source::Policy), [Rejection::OutsideLimits]);

    let alone = CandidateSettings { planner_paths: 0, bezier_paths: 0, ..settings() };
    let set = with_policy(vec![robot.start, near_goal], &alone);
    assert_eq!(set.candidates.len(), 1, "nothing to be longer than");
}

#[test]
fn the_baseline_goes_straight_and_where_it_cannot_takes_the_nearest_goal() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let near = query(&robot, &scene, goal(&robot, [-0.05, 0.2, -0.4]));
    let straight = c2farm_path(&near, &settings(), STREAMS).unwrap();
    assert_eq!(straight.source, Source::Linear);
    assert_eq!(straight, linear_candidate(&near, &settings()).unwrap());

    // Turned almost about: the last joint meets its limit on the way.
    let start = robot.grip(&robot.start);
    let turned =
        Pose3::from_parts(near.goal.translation, start.rotation * Quat::from_rotation_z(2.9));
    let about = query(&robot, &scene, turned);
    assert!(linear_candidate(&about, &settings()).is_err());
    let path = c2farm_path(&about, &settings(), STREAMS).unwrap();
    assert_eq!(path.source, Source::Planner);
    for goal in goal_configs(&about, &settings(), STREAMS) {
        assert!(path.path.length() <= robot.start.distance(&goal) + 1e-4);
    }
}

#[cfg(feature = "planners")]
#[test]
fn every_planner_gives_candidates_that_do_not_collide() {
    let robot = stick_arm();
    let (at, goal) = (robot.grip(&robot.start).translation, goal(&robot, [-0.05, 0.35, -0.05]));
    let foot = Vec3::new(at.x, 0.17, 0.0);
    let post = Primitive::Capsule { a: foot, b: foot + at.z * Vec3::Z, radius: 0.02 };
    let scene = Scene::from_primitives(vec![post]);
    let mut sets = Vec::new();
    for &planner in PlannerKind::ALL {
        let settings = CandidateSettings {
            planner,
            planner_collision_free_fraction: 1.0,
            path_len: 30,
            bezier_paths: 0,
            ..settings()
        };
        let set = candidates(&query(&robot, &scene, goal), &settings, STREAMS);
        let free = set.candidates.iter().filter(|candidate| !candidate.collides).count();
        assert!(free > 0, "{}: {:?}", planner.name(), set.rejected);
        sets.push(set);
    }
    assert!(sets[1..].iter().all(|set| *set != sets[0]), "the choice changes nothing");
}

#[test]
fn settings_that_name_no_planner_mean_rrt_connect_and_are_written_as_they_were() {
    let written = toml::to_string(&settings()).unwrap();
    assert!(!written.contains("planner ="), "{written}");
    assert_eq!(toml::from_str::<CandidateSettings>(&written), Ok(settings()));
}

#[cfg(feature = "planners")]
#[test]
fn settings_name_a_planner_by_its_word() {
    let other = CandidateSettings { planner: PlannerKind::Stomp, ..settings() };
    let written = toml::to_string(&other).unwrap();
    assert!(written.contains("planner = \"stomp\""), "{written}");
    assert_eq!(toml::from_str::<CandidateSettings>(&written), Ok(other));
}

/// The planner that settings with that word name, or what is wrong with it.
fn planner_named(word: &str) -> Result<PlannerKind, String> {
    let mut table: toml::Table = toml::to_string(&settings()).unwrap().parse().unwrap();
    table.insert("planner".to_owned(), word.into());
    let text = toml::to_string(&table).unwrap();
    let settings = toml::from_str::<CandidateSettings>(&text);
    settings.map(|settings| settings.planner).map_err(|error| error.to_string())
}

#[test]
fn an_unknown_planner_is_named_with_those_that_there_are() {
    assert_eq!(planner_named("rrt-connect"), Ok(PlannerKind::RrtConnect));
    let message = planner_named("prm").unwrap_err();
    assert!(message.contains("planner: expected one of rrt-connect"), "{message}");
    assert!(message.contains("found 'prm'") && !message.contains("built without"), "{message}");
}

#[test]
fn settings_out_of_range_are_named() {
    assert_eq!(settings().check(), Ok(()));
    for (settings, name) in [
        (
            CandidateSettings {
                refinement: Some(Refinement { best: 0, paths: 5, sigma: 0.1 }),
                ..settings()
            },
            "refinement.best",
        ),
        (
            CandidateSettings {
                refinement: Some(Refinement { best: 1, paths: 20_000, sigma: 0.1 }),
                ..settings()
            },
            "refinement.paths",
        ),
        (CandidateSettings { path_len: 1, ..settings() }, "path_len"),
        (
            CandidateSettings { planner_collision_free_fraction: 1.5, ..settings() },
            "planner_collision_free_fraction",
        ),
        (CandidateSettings { draws_per_path: 0, ..settings() }, "draws_per_path"),
        (
            CandidateSettings { bezier: BezierSettings { sigma: f32::NAN }, ..settings() },
            "candidates.bezier.sigma: expected a finite number from 0, found NaN",
        ),
        (
            CandidateSettings { rrt: RrtSettings { range: 0.0, ..settings().rrt }, ..settings() },
            "candidates.rrt.range: expected a number above 0, found 0",
        ),
        (
            CandidateSettings {
                rrt: RrtSettings { checks_per_radian: f32::INFINITY, ..settings().rrt },
                ..settings()
            },
            "candidates.rrt.checks_per_radian: expected a finite number above 0, found inf",
        ),
        (
            CandidateSettings { planner_paths: 20_000, ..settings() },
            "candidates.planner_paths: expected at most 65536 draws, paths times draws_per_path, found 100000",
        ),
    ] {
        let Err(Error::Config(message)) = settings.check() else { panic!("{name} was accepted") };
        assert!(message.contains(name), "{message}");
    }
}

#[test]
fn a_screw_motion_joins_the_set_where_it_is_asked_for_and_moves_no_other_path() {
    let (robot, scene) = (&XARM7, Scene::empty());
    let start = robot.grip(&robot.start);
    // A door's handle, 30 cm from its hinge, opened by half a radian.
    let hinge = start.translation + Vec3::new(0.0, 0.3, 0.0);
    let turn = Quat::from_rotation_z(-0.5);
    let opened =
        Pose3::from_parts(hinge + turn * (start.translation - hinge), turn * start.rotation);
    let query = query(robot, &scene, opened);
    let without = candidates(&query, &settings(), STREAMS);
    let with = candidates(&query, &CandidateSettings { screw_paths: 1, ..settings() }, STREAMS);
    let (screws, others): (Vec<_>, Vec<_>) =
        with.candidates.into_iter().partition(|candidate| candidate.source == Source::Screw);
    assert_eq!((others, with.rejected), (without.candidates, without.rejected));
    let [CandidatePath { path, .. }] = screws.as_slice() else { panic!("{} screws", screws.len()) };
    assert_eq!(path.configs().len(), settings().path_len);
    for config in path.configs() {
        let grip = robot.grip(config).translation;
        assert!(
            (grip.distance(hinge) - 0.3).abs() < 2e-3,
            "{} from the hinge",
            grip.distance(hinge)
        );
    }
}

#[test]
fn a_screw_motion_out_of_reach_is_rejected_with_the_reason() {
    let (robot, scene) = (stick_arm(), Scene::empty());
    let query = query(&robot, &scene, goal(&robot, [3.0, 0.0, 0.0]));
    let set = candidates(&query, &CandidateSettings { screw_paths: 1, ..settings() }, STREAMS);
    assert_eq!(reasons(&set, Source::Screw), [Rejection::Unreachable]);
    let two = CandidateSettings { screw_paths: 2, ..settings() };
    assert!(two.check().unwrap_err().to_string().contains("screw_paths"));
}
