use super::stick_arm::{is_free_by_brute_force, stick_arm};
use super::*;
use crate::robot::{Chain, ChainJoint, ChainLink, Motion, Sphere};
use fearless_simd::Level;
use glamx::{DPose3, DQuat, DVec3, Pose3, Quat};
use proptest::prelude::*;

/// Rounding of f32 kinematics, metres: checks that are decided by less are left out.
const ROUNDING: f32 = 2e-5;

fn config() -> impl Strategy<Value = JointConfig> {
    prop::array::uniform7(-2.5_f32..2.5).prop_map(JointConfig)
}

fn position() -> impl Strategy<Value = Vec3> {
    [-0.9_f32..0.9, -0.9..0.9, 0.0..1.2].prop_map(Vec3::from_array)
}

/// Every width of vectors that this machine has.
fn levels() -> Vec<Level> {
    let best = Level::new();
    #[cfg(target_arch = "x86_64")]
    let narrower = [best.as_sse2().map(Level::Sse2), best.as_sse4_2().map(Level::Sse4_2), best.as_avx2().map(Level::Avx2)];
    #[cfg(not(target_arch = "x86_64"))]
    let narrower: [Option<Level>; 0] = [];
    narrower.into_iter().flatten().chain([best]).collect()
}

fn at_level(arm: &ArmSpheres, level: Level) -> ArmSpheres {
    let mut arm = arm.clone();
    arm.level = level;
    arm
}

fn check(scene: &Scene, config: &JointConfig) -> Result<(), TestCaseError> {
    let robot = stick_arm();
    let expected = is_free_by_brute_force(&robot, scene, config, 0.0);
    prop_assume!([-ROUNDING, ROUNDING].iter().all(|&m| is_free_by_brute_force(&robot, scene, config, m) == expected));
    for level in levels() {
        prop_assert_eq!(scene.is_free(&at_level(&ArmSpheres::new(&robot), level), config), expected, "{:?}", level);
    }
    Ok(())
}

/// A ball that three slides carry along x, y and z, and nothing else: where it is, is known without kinematics.
fn gantry(radius: f32) -> ArmSpheres {
    let turns = [DQuat::from_rotation_y(core::f64::consts::FRAC_PI_2), DQuat::from_rotation_x(-core::f64::consts::FRAC_PI_2)];
    let axes = [turns[0], turns[0].inverse() * turns[1], turns[1].inverse()];
    let slide = |rotation| ChainJoint {
        name: "slide".to_owned(),
        parent_from_joint: DPose3::from_parts(DVec3::ZERO, rotation),
        motion: Motion::Slide,
        lower: -2.0,
        upper: 2.0,
        max_velocity: 1.0,
    };
    let spheres = vec![Sphere { center: Vec3::ZERO, radius }];
    let ball = ChainLink { name: "ball".to_owned(), body: 3, body_from_link: DPose3::IDENTITY, spheres, overshoot: 0.0 };
    ArmSpheres::from_chain(&Chain {
        name: "gantry".to_owned(),
        joints: axes.map(slide).to_vec(),
        body_from_tip: DPose3::IDENTITY,
        links: vec![ball],
        allowed_self_collisions: Vec::new(),
    })
}

fn solids(at: &[Vec3], turn: [f32; 3], size: f32) -> Vec<Primitive> {
    let rotation = Quat::from_scaled_axis(Vec3::from_array(turn));
    let shapes = [
        Shape::Sphere { radius: size },
        Shape::Cuboid { half_extents: Vec3::new(size, 0.05, 0.5 * size) },
        Shape::Cylinder { radius: size, half_length: 0.1 },
        Shape::Capsule { radius: 0.5 * size, half_length: size },
        Shape::Convex { points: vec![Vec3::ZERO, size * Vec3::X, size * Vec3::Y, 2.0 * size * Vec3::Z] },
    ];
    let mut solids: Vec<Primitive> =
        shapes.iter().zip(at).map(|(shape, at)| Primitive::new(shape, &Pose3::from_parts(*at, rotation))).collect();
    let upright = Pose3::from_parts(at[5], Quat::from_rotation_z(turn[2]));
    solids.push(Primitive::new(&Shape::Cuboid { half_extents: Vec3::new(0.05, size, 0.1) }, &upright));
    solids
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
        let config = JointConfig([ball.x, ball.y, ball.z, 0.0, 0.0, 0.0, 0.0]);
        for level in levels() {
            prop_assert_eq!(scene.is_free(&at_level(&gantry(radius), level), &config), distance > radius, "{:?}", level);
        }
    }

    /// Whole motions, near obstacles, so that many are decided by little: no width may decide otherwise than another.
    #[test]
    fn every_width_decides_alike(
        a in config(),
        to in prop::array::uniform7(-0.5_f32..0.5),
        at in prop::collection::vec(position(), 6),
        turn in prop::array::uniform3(-3.0_f32..3.0),
        points in prop::collection::vec(position(), 0..20),
        n_steps in 1..80_usize,
    ) {
        let b = JointConfig(core::array::from_fn(|j| a[j] + to[j]));
        let scene = Scene::from_primitives(solids(&at, turn, 0.1)).with_points(&points, 0.02);
        let arm = ArmSpheres::new(&stick_arm());
        let decisions: Vec<bool> =
            levels().into_iter().map(|level| block::motion_is_free(&scene, &at_level(&arm, level), &a, &b, n_steps).is_free).collect();
        prop_assert!(decisions.iter().all(|d| *d == decisions[0]), "{:?}", decisions);
        // A motion is free when all of its configurations are.
        let n = n_steps.next_multiple_of(8);
        let free = (1..=n).all(|i| scene.is_free(&arm, &a.lerp(&b, i as f32 / n as f32)));
        prop_assert_eq!(decisions[0], free);
    }
}

#[test]
fn the_arm_that_folds_into_itself_is_not_free_and_its_start_is() {
    let robot = stick_arm();
    let arm = ArmSpheres::new(&robot);
    assert!(Scene::empty().is_free(&arm, &robot.start));
    let folded = JointConfig([0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]);
    assert!(!Scene::empty().is_free(&arm, &folded));
}

#[test]
fn a_configuration_that_is_not_finite_is_not_free() {
    let robot = stick_arm();
    let mut broken = robot.start;
    broken[3] = f32::NAN;
    assert!(!Scene::empty().is_free(&ArmSpheres::new(&robot), &broken));
}
