//! Descriptions as they are found: each test is named after its symptom.

use super::*;

fn describe(srdf: &str, group: Option<&str>) -> Result<Described> {
    let options = UrdfOptions { srdf: Some(srdf), group, ..UrdfOptions::default() };
    Robot::describe(ARM, &options, &no_meshes)
}

#[test]
fn unknown_links_in_semantics_are_a_counted_warning() {
    let srdf = SEMANTICS
        .replace("link2=\"base\"", "link2=\"palm\"")
        .replace("link2=\"left\"", "link2=\"thumb\"");
    let found = describe(&srdf, None).expect("the arm is clear");
    assert_eq!(found.warnings, ["SRDF: 2 links that the URDF does not have: 'palm', 'thumb'"]);
    let in_other_group = SEMANTICS.replace("link name=\"hand\"", "link name=\"palm\"");
    let found = describe(&in_other_group, None).expect("a group that is not used");
    assert_eq!((found.groups.len(), found.groups[0].name.as_str()), (1, "arm"));
    let error = describe(&in_other_group, Some("all")).expect_err("it is asked for").to_string();
    assert!(error.contains("group 'all': the URDF has no link 'palm'"), "{error}");
    let error = describe("<robot", None).expect_err("not XML").to_string();
    assert!(error.contains("SRDF, line 1"), "{error}");
}

#[test]
fn groups_by_joints_links_chains_and_other_groups_have_ends() {
    let srdf = |inside: &str| format!("<robot name='two'>{inside}</robot>");
    for (group, base, tip) in [
        ("<chain base_link='base' tip_link='tool'/>", "base", "tool"),
        ("<joint name='shoulder'/><joint name='elbow'/>", "base", "fore"),
        ("<joint name='elbow'/><joint name='shoulder'/><joint name='flange'/>", "base", "tool"),
        ("<link name='upper'/><link name='fore'/><link name='hand'/>", "base", "hand"),
        ("<group name='first'/><joint name='elbow'/>", "base", "fore"),
    ] {
        let first = "<group name='first'><joint name='shoulder'/></group>";
        let text = srdf(&format!("{first}<group name='g'>{group}</group>"));
        let found = describe(&text, Some("g")).expect(group);
        let it = found.groups.iter().find(|it| it.name == "g").expect("it is a chain");
        assert_eq!((it.base.as_str(), it.tip.as_str(), it.n_joints), (base, tip, 2), "{group}");
        assert_eq!(found.robot.dof(), 2);
        assert_eq!(describe(&text, None).expect("the longer one").robot.dof(), 2);
    }
    let text = srdf("<group name='g'><joint name='grasp'/><joint name='elbow'/></group>");
    assert_eq!(describe(&text, Some("g")).expect("a part of the arm").robot.dof(), 2);
    for (group, why) in [
        ("<joint name='shoulder'/><joint name='grasp'/>", "it leaves out joint 'elbow'"),
        ("<joint name='knee'/>", "the URDF has no joint 'knee'"),
        ("<group name='g'/><joint name='elbow'/>", "group 'g' contains itself"),
        ("<link name='base'/>", "no joint of it moves"),
        ("<group name='h'/>", "there is no group 'h'"),
    ] {
        let text = srdf(&format!("<group name='g'>{group}</group>"));
        let error = describe(&text, Some("g")).expect_err(group).to_string();
        assert!(error.contains(why), "{group}: {error}");
    }
    let error = describe(SEMANTICS, Some("leg")).expect_err("there is none").to_string();
    assert!(error.contains("group: expected one of 'all', 'arm', found 'leg'"), "{error}");
}

#[test]
fn collisions_that_are_disabled_by_default_may_be_enabled_again() {
    let srdf = SEMANTICS.replace(
        "</robot>",
        "<disable_default_collisions link='base'/><enable_collisions link1='base' link2='hand'/></robot>",
    );
    let robot = describe(&srdf, None).expect("a valid document").robot;
    let found = allowed(&robot);
    let with_base: Vec<_> =
        found.iter().filter(|(a, b)| *a == "base" || *b == "base").copied().collect();
    assert_eq!(with_base, [("base", "upper"), ("base", "fore"), ("base", "right")]);
}

#[test]
fn what_is_not_in_the_chain_may_have_any_velocity_limits_or_axis() {
    for (from, to) in [
        (
            "lower=\"0.01\" upper=\"0.04\" effort=\"1\" velocity=\"1\"",
            "lower=\"1\" upper=\"0\" velocity=\"0\"",
        ),
        ("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 0 0\"/>"),
    ] {
        assert!(ARM.contains(from), "{from}");
        let text = ARM.replace(from, to);
        let chain = Robot::from_urdf(&text, None, Some("tool"), &no_meshes).expect(to);
        assert_eq!(chain.dof(), 2);
        let error = Robot::from_urdf(&text, None, Some("left"), &no_meshes)
            .expect_err("now it is in the chain")
            .to_string();
        assert!(error.contains("joint 'grasp'") && error.contains("on line"), "{error}");
    }
}

/// A ball at x 0.2 behind a joint that follows another.
fn follower(mimic: &str) -> String {
    format!(
        "<robot name='r'><link name='base'/><link name='arm'/><link name='tip'/><link name='side'>\
        <collision><origin xyz='0.2 0 0'/><geometry><sphere radius='0.02'/></geometry></collision></link>\
        <link name='far'/>\
        <joint name='j' type='revolute'><parent link='base'/><child link='arm'/><axis xyz='0 0 1'/>\
        <limit lower='-3' upper='3' velocity='1'/></joint>\
        <joint name='wheel' type='continuous'><parent link='arm'/><child link='tip'/><axis xyz='0 0 1'/></joint>\
        <joint name='f' type='revolute'><parent link='base'/><child link='side'/><axis xyz='0 0 1'/>\
        <limit lower='-9' upper='9' velocity='1'/>{mimic}</joint>\
        <joint name='g' type='revolute'><parent link='side'/><child link='far'/><axis xyz='0 0 1'/>\
        <limit lower='-9' upper='9' velocity='1'/><mimic joint='f' multiplier='2' offset='0.1'/></joint></robot>"
    )
}

#[test]
fn a_mimic_joint_beside_the_chain_moves_with_its_driver() {
    use crate::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
    let read = |mimic: &str| Robot::from_urdf(&follower(mimic), None, Some("arm"), &no_meshes);
    let at = |robot: &Robot, q: f32, center: Vec3| {
        let ball = Primitive::Sphere { center, radius: 0.01 };
        let (scene, arm) =
            (Scene::from_primitives(vec![ball]), ArmSpheres::from_description(robot).unwrap());
        !MotionChecker::new(&scene, &arm, 32.0).is_free(&JointConfig::new([q]))
    };
    let (x, y) = (Vec3::new(0.2, 0.0, 0.0), Vec3::new(0.0, 0.2, 0.0));
    let still = read("<mimic joint='j' multiplier='0' offset='1.5708'/>").unwrap();
    assert!(at(&still, 0.0, y) && !at(&still, 0.0, x), "the offset alone");
    let turning = read("<mimic joint='j' multiplier='-2'/>").unwrap();
    assert_eq!((turning.dof(), turning.followers.len()), (1, 2));
    assert!(at(&turning, 0.0, x) && at(&turning, -FRAC_PI_2 as f32 / 2.0, y));
    assert!(!at(&turning, FRAC_PI_2 as f32 / 2.0, y));
    // 2 (-2 q) + 0.1 on top of -2 q.
    let far = turning.links.iter().find(|link| link.name == "far").unwrap();
    let frame = turning.body_frames(&JointConfig::new([0.3]))[far.body] * far.body_from_link;
    let turn = frame.rotation * DVec3::X;
    assert!(turn.distance(DVec3::new((-1.7_f64).cos(), (-1.7_f64).sin(), 0.0)) < 1e-6, "{turn}");
}

#[test]
fn a_mimic_joint_in_the_chain_moves_the_tip() {
    let text = follower("<mimic joint='j' multiplier='-2'/>")
        .replace("<child link='side'/><axis", "<child link='side'/><origin xyz='0 0 0.5'/><axis")
        .replace(
            "<parent link='base'/><child link='side'/>",
            "<parent link='arm'/><child link='side'/>",
        );
    let arm = Robot::from_urdf(&text, None, Some("far"), &no_meshes).unwrap();
    assert_eq!(arm.dof(), 1);
    let turned = |q: f32| arm.grip_f64(&JointConfig::new([q])).rotation * DVec3::X;
    // q - 2 q + (2 (-2 q) + 0.1)
    let expected = |q: f64| DVec3::new((0.1 - 5.0 * q).cos(), (0.1 - 5.0 * q).sin(), 0.0);
    for q in [0.0, 0.25, -0.5] {
        assert!(turned(q).distance(expected(f64::from(q))) < 1e-7, "{q}: {}", turned(q));
    }
}

#[test]
fn mimic_joints_of_a_driver_that_stands_still_are_moved_by_it_and_broken_ones_are_refused() {
    let still = follower("<mimic joint='wheel' offset='1.5708'/>");
    let robot = Robot::from_urdf(&still, None, Some("arm"), &no_meshes).unwrap();
    assert!(robot.followers.is_empty());
    let ball = robot.links.iter().find(|link| link.name == "side").unwrap().spheres[0].center;
    assert!(ball.distance(Vec3::new(0.0, 0.2, 0.0)) < 1e-5, "{ball}");
    for (mimic, why) in [
        ("<mimic joint='g'/>", "it follows itself: a loop"),
        ("<mimic/>", "'joint' is missing"),
        ("<mimic joint='j' multiplier='x'/>", "'multiplier' is not made of numbers"),
    ] {
        let error = Robot::from_urdf(&follower(mimic), None, Some("arm"), &no_meshes)
            .expect_err(why)
            .to_string();
        assert!(error.contains("<mimic> on line 1") && error.contains(why), "{error}");
    }
}

#[test]
fn a_mimic_joint_of_an_unknown_driver_is_refused_in_the_chain_and_stands_still_beside_it() {
    let text = follower("<mimic joint='k'/>");
    let error = Robot::from_urdf(&text, None, Some("side"), &no_meshes).expect_err("in the chain");
    assert!(error.to_string().contains("<mimic> on line 1: there is no joint 'k'"), "{error}");
    let options = UrdfOptions { tip: Some("arm"), ..UrdfOptions::default() };
    let found = Robot::describe(&text, &options, &no_meshes).unwrap();
    assert!(
        found.warnings[0].contains("1 joints beside the arm stand still"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn a_velocity_limit_of_nothing_is_a_warning() {
    for stated in ["", "velocity=\"0\"", "velocity=\"-1\""] {
        let text = ARM.replace("velocity=\"3\"", stated);
        let options = UrdfOptions { tip: Some("tool"), ..UrdfOptions::default() };
        let found = Robot::describe(&text, &options, &no_meshes).unwrap();
        assert_eq!(found.robot.joints[0].max_velocity, 1.0);
        assert!(found.warnings[0].contains("joint 'shoulder'"), "{:?}", found.warnings);
    }
    let found = Robot::from_urdf(
        &ARM.replace("lower=\"-1.5\" upper=\"2\"", ""),
        None,
        Some("tool"),
        &no_meshes,
    );
    assert_eq!(found.unwrap().limits()[0], (0.0, 0.0), "as the format has it");
}

#[test]
fn prefixes_that_nobody_declared_are_no_concern_outside_of_what_is_read() {
    let vendor = "<gazebo><sensor:camera sensor:rate='5'/><plugin file='${x}'/></gazebo><drake:tag/></robot>";
    let text = ARM.replace("</robot>", vendor);
    let chain = Robot::from_urdf(&text, None, Some("tool"), &no_meshes).expect("it is skipped");
    assert_eq!(chain, arm());
    assert_eq!(
        Robot::from_urdf(&format!("\u{feff}{ARM}"), None, Some("tool"), &no_meshes),
        Ok(arm())
    );
    let error = message(
        &ARM.replace(" xmlns:xacro=\"http://www.ros.org/wiki/xacro\"", "")
            .replace("<material name=\"grey\"/>", "<xacro:arm/>"),
    );
    assert!(
        error.contains("<arm> on line 3") && error.contains("`xacro FILE > FILE.urdf`"),
        "{error}"
    );
}

#[test]
fn a_long_path_in_a_message_keeps_its_end() {
    let long = format!("package://{}/link_7.obj", "folder/".repeat(20));
    let text =
        ARM.replace("<box size=\"0.02 0.1 0.03\"/>", &format!("<mesh filename=\"{long}\"/>"));
    let error = message(&text);
    assert!(error.contains("package://folder") && error.contains("/link_7.obj'"), "{error}");
}

#[test]
fn meshes_are_opened_only_where_something_asks_for_collisions() {
    let text = ARM.replace("<box size=\"0.02 0.1 0.03\"/>", "<mesh filename=\"a.dae\"/>");
    let options =
        UrdfOptions { tip: Some("tool"), without_geometry: true, ..UrdfOptions::default() };
    let found = Robot::describe(&text, &options, &|_| panic!("nobody asked")).unwrap();
    assert_eq!(found.robot.grip_f64(&config(0.3, 0.4)), arm().grip_f64(&config(0.3, 0.4)));
    let options = UrdfOptions { without_geometry: false, ignore_missing_meshes: true, ..options };
    let found = Robot::describe(&text, &options, &no_meshes).unwrap();
    assert!(link(&found.robot, "hand").spheres.is_empty());
    assert!(found.warnings[0].contains("link 'hand', <mesh> on line"), "{:?}", found.warnings);
}
