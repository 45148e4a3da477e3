use super::arm_spheres::GroupPair;
use super::block::{Looks, Sampled};
use super::link_spheres::{LinkBits, LinkGroup, LinkSpheres};
use super::stick_arm::{is_free_by_brute_force, stick_arm};
use super::sweep::{Sweep, Unseen};
use super::*;
use crate::lanes::levels;
use crate::robot::{Joint, JointConfig, JointMotion, JointOrigin, Link, PANDA, Robot, Sphere};
use fearless_simd::Level;
use glamx::{DPose3, DQuat, DVec3, Pose3, Quat, Vec3};
use proptest::prelude::*;

/// Rounding of f32 kinematics, metres: checks that are decided by less are left out.
const ROUNDING: f32 = 2e-5;

fn config() -> impl Strategy<Value = JointConfig> {
    prop::array::uniform7(-2.5_f32..2.5).prop_map(JointConfig::new)
}

fn position() -> impl Strategy<Value = Vec3> {
    [-0.9_f32..0.9, -0.9..0.9, 0.0..1.2].prop_map(Vec3::from_array)
}

fn at_level(arm: &ArmSpheres, level: Level) -> ArmSpheres {
    let mut arm = arm.clone();
    arm.level = level;
    arm
}

fn check(scene: &Scene, config: &JointConfig) -> Result<(), TestCaseError> {
    let robot = stick_arm();
    let expected = is_free_by_brute_force(&robot, scene, config, 0.0);
    prop_assume!(
        [-ROUNDING, ROUNDING]
            .iter()
            .all(|&m| is_free_by_brute_force(&robot, scene, config, m) == expected)
    );
    for level in levels() {
        prop_assert_eq!(
            scene.is_free(&at_level(&ArmSpheres::new(&robot), level), config),
            expected,
            "{:?}",
            level
        );
    }
    Ok(())
}

/// A ball that three slides carry along x, y and z, and nothing else: where it is, is known without
/// kinematics.
fn gantry(radius: f32) -> ArmSpheres {
    let turns = [
        DQuat::from_rotation_y(core::f64::consts::FRAC_PI_2),
        DQuat::from_rotation_x(-core::f64::consts::FRAC_PI_2),
    ];
    let axes = [turns[0], turns[0].inverse() * turns[1], turns[1].inverse()];
    let slide = |rotation| Joint {
        name: "slide".to_owned(),
        origin: JointOrigin::Fixed(DPose3::from_parts(DVec3::ZERO, rotation)),
        motion: JointMotion::Slide,
        lower: -2.0,
        upper: 2.0,
        is_continuous: false,
        max_velocity: 1.0,
        max_acceleration: f32::INFINITY,
    };
    let spheres = vec![Sphere { center: Vec3::ZERO, radius }];
    let ball = Link {
        name: "ball".to_owned(),
        body: 3,
        body_from_link: DPose3::IDENTITY,
        body_from_shapes: DPose3::IDENTITY,
        spheres,
        capsules: Vec::new(),
        overshoot: 0.0,
        solids: Vec::new(),
        is_exact: false,
    };
    let chain = Robot {
        name: "gantry".to_owned(),
        joints: axes.map(slide).to_vec(),
        followers: Vec::new(),
        body_from_flange: DPose3::IDENTITY,
        flange_from_grip: DPose3::IDENTITY,
        links: vec![ball],
        allowed_self_collisions: Vec::new(),
        close_pairs: Vec::new(),
        start: JointConfig::new([0.0; 3]),
        gripper: None,
        workspace_center: None,
    };
    ArmSpheres::from_description(&chain).unwrap()
}

fn solids(at: &[Vec3], turn: [f32; 3], size: f32) -> Vec<Primitive> {
    let rotation = Quat::from_scaled_axis(Vec3::from_array(turn));
    let shapes = [
        Shape::Sphere { radius: size },
        Shape::Cuboid { half_extents: Vec3::new(size, 0.05, 0.5 * size) },
        Shape::Cylinder { radius: size, half_length: 0.1 },
        Shape::Capsule { radius: 0.5 * size, half_length: size },
        Shape::Convex {
            points: vec![Vec3::ZERO, size * Vec3::X, size * Vec3::Y, 2.0 * size * Vec3::Z],
        },
    ];
    let mut solids: Vec<Primitive> = shapes
        .iter()
        .zip(at)
        .map(|(shape, at)| Primitive::new(shape, &Pose3::from_parts(*at, rotation)))
        .collect();
    let upright = Pose3::from_parts(at[5], Quat::from_rotation_z(turn[2]));
    solids.push(Primitive::new(
        &Shape::Cuboid { half_extents: Vec3::new(0.05, size, 0.1) },
        &upright,
    ));
    solids
}

/// The arm with a group for each link.
fn each_by_itself(arm: &ArmSpheres) -> ArmSpheres {
    let mut alone = arm.clone();
    let group = |(idx, link): (usize, &LinkSpheres)| LinkGroup {
        bits: 1 << idx,
        body: link.body,
        part: link.part,
        bound: link.bound,
    };
    alone.groups = arm.links.iter().enumerate().map(group).collect();
    let lone = |&pair: &(usize, usize)| GroupPair { groups: pair, links: pair };
    alone.lone_pairs = arm.self_pairs.iter().map(lone).collect();
    alone.group_pairs.clear();
    alone
}

proptest! {
    #[test]
    fn checks_agree_with_brute_force_in_clouds(config in config(), points in prop::collection::vec(position(), 0..40)) {
        let mut scene = Scene::from_points(&points, 0.02);
        scene.hand_points = PointCloud::new(&points[points.len() / 2..], 0.02);
        check(&scene, &config)?;
    }

    #[test]
    fn checks_agree_with_brute_force_among_primitives(
        config in config(),
        at in prop::collection::vec(position(), 6),
        turn in prop::array::uniform3(-3.0_f32..3.0),
        size in 0.03_f32..0.2,
    ) {
        check(&Scene::from_primitives(solids(&at, turn, size)), &config)?;
    }

    /// Of the Panda the last link and the hand are of one body.
    #[test]
    fn links_of_one_body_decide_together_as_each_by_itself(
        config in config(),
        at in prop::collection::vec(position(), 6),
        turn in prop::array::uniform3(-3.0_f32..3.0),
        size in 0.03_f32..0.2,
        points in prop::collection::vec(position(), 0..10),
    ) {
        let mut robot = PANDA.described();
        // What the two may touch differs.
        robot.allowed_self_collisions.retain(|&pair| pair != (1, 8));
        let arm = ArmSpheres::from_description(&robot).unwrap();
        prop_assert!(arm.groups.len() < arm.links.len());
        let alone = each_by_itself(&arm);
        let mut scene = Scene::from_primitives(solids(&at, turn, size)).with_points(&points, 0.02);
        scene.allow_contact(&arm, "hand", 0).unwrap();
        prop_assert_eq!(scene.is_free(&arm, &config), scene.is_free(&alone, &config));
    }

    #[test]
    fn a_ball_is_free_as_far_from_every_solid_as_its_radius(
        at in prop::collection::vec(position(), 6),
        turn in prop::array::uniform3(-3.0_f32..3.0),
        size in 0.03_f32..0.3,
        ball in position(),
        radius in 0.01_f32..0.3,
        shape in 0..6_usize,
    ) {
        let solid = solids(&at, turn, size).swap_remove(shape);
        let distance = solid.distance(ball);
        prop_assume!((distance - radius).abs() > ROUNDING);
        let scene = Scene::from_primitives(vec![solid]);
        let config = JointConfig::new([ball.x, ball.y, ball.z]);
        for level in levels() {
            prop_assert_eq!(scene.is_free(&at_level(&gantry(radius), level), &config), distance > radius, "{:?}", level);
        }
    }

    /// Whole motions, near obstacles, so that many are decided by little: no width may decide
    /// otherwise than another.
    #[test]
    fn every_width_decides_alike(
        a in config(),
        to in prop::array::uniform7(-0.5_f32..0.5),
        at in prop::collection::vec(position(), 6),
        turn in prop::array::uniform3(-3.0_f32..3.0),
        points in prop::collection::vec(position(), 0..20),
        n_steps in 1..80_usize,
    ) {
        let b = JointConfig::from_fn(7, |j| a[j] + to[j]);
        let scene = Scene::from_primitives(solids(&at, turn, 0.1)).with_points(&points, 0.02);
        let arm = ArmSpheres::new(&stick_arm());
        let n = n_steps.next_multiple_of(8);
        for (looks, before) in [(Looks::Ends, 0.0), (Looks::Middles, 0.5)] {
            let motion = Sampled { a: &a, b: &b, n_steps, looks, links: LinkBits::MAX };
            let sweep = Sweep::new(&arm, (&a, &b), n, looks.spacing());
            let checked = levels().into_iter().map(|level| {
                block::motion_is_free(&scene, &at_level(&arm, level), motion, sweep.as_ref())
            });
            let (decisions, unseen): (Vec<bool>, Vec<Option<Unseen>>) =
                checked.map(|checked| (checked.is_free, checked.unseen)).unzip();
            prop_assert!(decisions.iter().all(|d| *d == decisions[0]), "{:?}", decisions);
            prop_assert!(unseen.iter().all(|u| *u == unseen[0]), "{:?}", unseen);
            // A motion is free when all of its configurations are.
            let free = (1..=n).all(|i| scene.is_free(&arm, &a.lerp(&b, (i as f32 - before) / n as f32)));
            prop_assert_eq!(decisions[0], free, "{:?}", looks);
        }
    }
}

#[test]
fn the_arm_that_folds_into_itself_is_not_free_and_its_start_is() {
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    assert!(Scene::empty().is_free(&arm, &robot.start));
    let folded = JointConfig::new([0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]);
    assert!(!Scene::empty().is_free(&arm, &folded));
}

#[test]
fn a_configuration_that_is_not_finite_is_not_free() {
    let robot = stick_arm();
    let mut broken = robot.start;
    broken[3] = f32::NAN;
    assert!(!Scene::empty().is_free(&ArmSpheres::new(&robot), &broken));
}

#[test]
fn a_held_object_is_part_of_the_hand_and_may_touch_the_links_that_are_named() {
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    let flange_from_grip = Pose3::from(robot.flange_from_grip);
    let ball = |z: f32| Sphere { center: flange_from_grip * Vec3::new(0.0, 0.0, z), radius: 0.04 };
    let post = robot.grip(&robot.start) * Vec3::new(0.0, 0.0, 0.2);
    let scene = Scene::from_primitives(vec![Primitive::Sphere { center: post, radius: 0.05 }]);
    assert!(scene.is_free(&arm, &robot.start));
    let holding = arm.with_attached(&[ball(0.15)], &["hand"]).unwrap();
    assert!(Scene::empty().is_free(&holding, &robot.start));
    assert!(!scene.is_free(&holding, &robot.start), "the object is in the post");
    let in_fingers = |touching: &[&str]| arm.with_attached(&[ball(0.0)], touching).unwrap();
    assert!(Scene::empty().is_free(&in_fingers(&["hand"]), &robot.start));
    assert!(
        !Scene::empty().is_free(&in_fingers(&[]), &robot.start),
        "the object is between the fingers"
    );
    assert!(arm.with_attached(&[ball(0.0)], &["hnd"]).unwrap_err().to_string().contains("hnd"));
    assert!(arm.with_attached(&[ball(f32::NAN)], &[]).is_err());
}

#[test]
fn a_contact_that_is_allowed_is_so_for_that_link_and_that_obstacle_alone() {
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    let at_hand = robot.grip(&robot.start).translation;
    let elbow = robot.link_frames(&robot.start)[4].translation;
    let ball = |center| Primitive::Sphere { center, radius: 0.06 };
    let allowing = |primitives: Vec<Primitive>| {
        let mut scene = Scene::from_primitives(primitives);
        scene.allow_contact(&arm, "hand", 0).unwrap();
        scene.is_free(&arm, &robot.start)
    };
    assert!(!Scene::from_primitives(vec![ball(at_hand)]).is_free(&arm, &robot.start));
    assert!(allowing(vec![ball(at_hand)]));
    assert!(!allowing(vec![ball(at_hand), ball(at_hand)]));
    assert!(!allowing(vec![ball(elbow)]));
    let mut scene = Scene::from_primitives(vec![ball(at_hand)]);
    assert!(scene.allow_contact(&arm, "claw", 0).unwrap_err().to_string().contains("claw"));
    assert!(scene.allow_contact(&arm, "hand", 1).unwrap_err().to_string().contains("primitive 1"));
}

#[test]
fn planners_that_optimise_do_not_shy_away_from_a_contact_that_is_allowed() {
    /// Metres.
    const REACH: f32 = 0.2;
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    let ball = Primitive::Sphere { center: robot.grip(&robot.start).translation, radius: 0.06 };
    let mut scene = Scene::from_primitives(vec![ball]);
    let deepest = |scene: &Scene| {
        scene
            .proximities(&arm, &robot.start, REACH)
            .iter()
            .fold(REACH, |least, near| near.distance.min(least))
    };
    assert!(deepest(&scene) < 0.0);
    scene.allow_contact(&arm, "hand", 0).unwrap();
    assert!(deepest(&scene) > 0.0);
}

#[test]
fn an_obstacle_of_which_nobody_knows_where_it_is_leaves_nothing_free() {
    let (robot, far) = (stick_arm(), 5.0 * Vec3::X);
    let arm = ArmSpheres::new(&robot);
    let is_free =
        |primitive: Primitive| Scene::from_primitives(vec![primitive]).is_free(&arm, &robot.start);
    let nowhere = Pose3::from_translation(Vec3::new(5.0, f32::NAN, 0.0));
    assert!(is_free(Primitive::Sphere { center: far, radius: 0.1 }));
    assert!(!is_free(Primitive::Sphere { center: far, radius: f32::NAN }));
    assert!(!is_free(Primitive::Sphere { center: far, radius: -0.1 }));
    assert!(!is_free(Primitive::Capsule { a: far, b: Vec3::new(5.0, f32::NAN, 0.0), radius: 0.1 }));
    assert!(!is_free(Primitive::Cuboid {
        world_from_box: nowhere,
        half_extents: Vec3::splat(0.1)
    }));
    assert!(!is_free(Primitive::Cylinder {
        world_from_cylinder: nowhere,
        radius: 0.1,
        half_length: 0.1
    }));
    for radius in [f32::NAN, f32::INFINITY, -0.1] {
        assert!(!Scene::from_points(&[far], radius).is_free(&arm, &robot.start), "{radius}");
    }
    // What comes later does not make it free again.
    let broken = Primitive::Sphere { center: Vec3::NAN, radius: 0.1 };
    let scene =
        Scene::from_primitives(vec![broken, Primitive::Sphere { center: far, radius: 0.1 }]);
    assert!(!scene.with_points(&[far], 0.01).is_free(&arm, &robot.start));
}

#[test]
fn an_arm_of_too_many_links_is_refused() {
    let mut chain = stick_arm().described();
    let link = chain.links[1].clone();
    chain.links.extend((0..MAX_LINKS).map(|_| link.clone()));
    assert!(
        ArmSpheres::from_description(&chain)
            .unwrap_err()
            .to_string()
            .contains(&format!("at most {MAX_LINKS}"))
    );
}

#[test]
fn a_resolution_beyond_all_bounds_is_one_that_ends() {
    let arm = gantry(0.1);
    let scene = Scene::from_primitives(vec![Primitive::Sphere { center: Vec3::ZERO, radius: 0.1 }]);
    let [a, b] = [-1.0, 1.0].map(|x| JointConfig::new([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    assert!(!MotionChecker::new(&scene, &arm, f32::MAX).motion_is_free(&a, &b));
    assert!(!MotionChecker::new(&scene, &arm, f32::INFINITY).motion_is_free(&a, &b));
}

#[test]
fn a_million_points_make_a_scene_that_answers() {
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    let grip = robot.grip(&robot.start).translation;
    // A wall of a thousand by a thousand points, 1 mm apart.
    let wall = |x: f32| -> Vec<Vec3> {
        let along = |n: u16| 0.001 * (f32::from(n) - 500.0);
        (0..1000)
            .flat_map(|y| (0..1000).map(move |z| Vec3::new(x, along(y), 0.6 + along(z))))
            .collect()
    };
    let far = Scene::from_points(&wall(grip.x + 0.5), 0.001);
    assert_eq!(far.arm_points().points().len(), 1_000_000);
    assert!(far.is_free(&arm, &robot.start));
    assert!(!Scene::from_points(&wall(grip.x), 0.001).is_free(&arm, &robot.start));
    assert_eq!(
        far.proximities(&arm, &robot.start, 0.6).iter().filter(|near| near.distance <= 0.0).count(),
        0
    );
}
