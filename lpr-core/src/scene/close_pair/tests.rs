#![cfg(feature = "hulls")]

use crate::robot::{JointConfig, Robot};
use crate::scene::{ArmSpheres, MotionChecker, OverlapKind, Scene, overlaps};

/// Two plates, one of which turns about z and slides along it, 5 mm above the other where both
/// joints are at 0. Spheres reach 1 cm beyond each.
fn plates() -> Robot {
    let plate = |name: &str| {
        format!(
            r#"<link name="{name}"><collision><origin xyz="0.2 0 0"/><geometry>
            <box size="0.4 0.1 0.04"/></geometry></collision></link>"#
        )
    };
    let joint = |name: &str, kind: &str, ends: [&str; 2], z: f32, limits: [f32; 2]| {
        let ([parent, child], [lower, upper]) = (ends, limits);
        format!(
            r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
            <origin xyz="0 0 {z}"/><axis xyz="0 0 1"/>
            <limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>"#
        )
    };
    let urdf = format!(
        r#"<robot name="plates"><link name="base"/>{}<link name="post"/>{}{}{}{}</robot>"#,
        plate("low"),
        plate("high"),
        joint("first", "revolute", ["base", "low"], 0.3, [-1.0, 1.0]),
        joint("lift", "prismatic", ["low", "post"], 0.045, [-0.02, 0.1]),
        joint("turn", "revolute", ["post", "high"], 0.0, [-3.0, 3.0]),
    );
    Robot::from_urdf(&urdf, None, None, &|_| None).expect("a sound description")
}

fn at(lift: f32, turn: f32) -> JointConfig {
    JointConfig::from_fn(3, |joint| [0.0, lift, turn][joint])
}

#[test]
fn links_that_pass_each_other_by_5_mm_are_told_apart_though_their_spheres_touch() {
    let mut robot = plates();
    let scene = Scene::empty();
    let as_spheres = ArmSpheres::from_description(&robot).unwrap();
    assert!(!scene.is_free(&as_spheres, &at(0.0, 0.0)));

    let found = overlaps(&robot).unwrap();
    let kinds: Vec<_> = found.iter().map(|overlap| (overlap.pair, overlap.kind)).collect();
    assert_eq!(kinds, [((1, 3), OverlapKind::Close)], "{found:?}");
    robot.allow(&found);
    assert_eq!(
        (robot.close_pairs.len(), robot.allowed_self_collisions.contains(&(1, 3))),
        (1, false)
    );

    let arm = ArmSpheres::from_description(&robot).unwrap();
    let checker = MotionChecker::new(&scene, &arm, 32.0);
    for (lift, is_free) in
        [(0.1, true), (0.0, true), (-0.004, true), (-0.006, false), (-0.02, false)]
    {
        assert_eq!(checker.is_free(&at(lift, 0.0)), is_free, "{lift}");
        assert_eq!(scene.deepest_contact(&arm, &at(lift, 0.0)).is_none(), is_free, "{lift}");
        let is_apart =
            scene.proximities(&arm, &at(lift, 0.0), 0.05).iter().all(|it| it.distance >= 0.0);
        assert_eq!(is_apart, is_free, "{lift}");
    }
    assert!(checker.path_is_free(&[at(0.0, -3.0), at(0.0, 3.0), at(0.1, 0.0)]));
}

#[test]
fn a_touch_of_close_links_between_two_looks_is_seen_from_1_mm_on() {
    let mut robot = plates();
    robot.allow(&overlaps(&robot).unwrap());
    let (scene, arm) = (Scene::empty(), ArmSpheres::from_description(&robot).unwrap());
    let checker = MotionChecker::new(&scene, &arm, 1.0);
    // 0.09 m in one look.
    assert!(checker.path_is_free(&[at(0.1, 0.0), at(-0.0045, 0.0), at(0.1, 0.0)]));
    for down in [-0.0061, -0.01, -0.02] {
        assert!(!checker.path_is_free(&[at(0.1, 0.0), at(down, 0.0), at(0.1, 0.0)]), "{down}");
        // Through the middle of a motion, where no look may be.
        assert!(!checker.path_is_free(&[at(down, -3.0), at(down, 3.0)]), "{down}");
    }
}
