mod as_found;

use super::*;
use crate::robot::{JointConfig, JointMotion, Link};
use core::f64::consts::FRAC_PI_2;
use glamx::Vec3;

/// Two joints about y and z, then a hand with two fingers, of which one slides and one mimics it.
pub(super) const ARM: &str = r#"<?xml version="1.0"?>
<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <material name="grey"/>
  <link name="base">
    <visual><geometry><mesh filename="not there"/></geometry></visual>
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <link name="upper">
    <collision><origin xyz="0 0 0.2"/><geometry><capsule radius="0.05" length="0.2"/></geometry></collision>
    <collision><origin xyz="0 0 0.4"/><geometry><sphere radius="0.07"/></geometry></collision>
  </link>
  <link name="fore">
    <collision><origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/><geometry><sphere radius="0.04"/></geometry></collision>
  </link>
  <link name="hand"><collision><geometry><box size="0.02 0.1 0.03"/></geometry></collision></link>
  <link name="left"/>
  <link name="right"><collision><origin xyz="0 0 0.01"/><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.3" rpy="0 0 0"/><parent link="base"/><child link="upper"/>
    <axis xyz="0 2 0"/><limit lower="-1.5" upper="2" effort="1" velocity="3"/>
  </joint>
  <joint name="elbow" type="continuous">
    <origin xyz="0 0 0.4"/><parent link="upper"/><child link="fore"/><axis xyz="0 0 -1"/>
  </joint>
  <joint name="wrist" type="fixed"><origin xyz="0.2 0 0" rpy="0 0 0.5"/><parent link="fore"/><child link="hand"/></joint>
  <joint name="grasp" type="prismatic">
    <parent link="hand"/><child link="left"/><axis xyz="0 1 0"/><limit lower="0.01" upper="0.04" effort="1" velocity="1"/>
  </joint>
  <joint name="follow" type="prismatic">
    <parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/><mimic joint="grasp"/>
    <limit lower="0.01" upper="0.04" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed"><origin xyz="0.1 0 0"/><parent link="hand"/><child link="tool"/></joint>
</robot>"#;

pub(super) const SEMANTICS: &str = r#"<robot name="two">
  <group name="all"><link name="hand"/><joint name="elbow"/></group>
  <group name="arm"><chain base_link="base" tip_link="tool"/></group>
  <disable_collisions link1="upper" link2="base" reason="Adjacent"/>
  <disable_collisions link1="base" link2="left" reason="it has no geometry"/>
</robot>"#;

fn no_meshes(_: &str) -> Option<Vec<u8>> {
    None
}

fn arm() -> Robot {
    Robot::from_urdf(ARM, None, Some("tool"), &no_meshes).expect("a valid document")
}

fn link<'a>(chain: &'a Robot, name: &str) -> &'a Link {
    chain.links.iter().find(|link| link.name == name).expect("a link of the document")
}

fn config(first: f32, second: f32) -> JointConfig {
    JointConfig::new([first, second])
}

/// The names of allowed pairs.
fn allowed(chain: &Robot) -> Vec<(&str, &str)> {
    let name = |link: usize| chain.links[link].name.as_str();
    chain.allowed_self_collisions.iter().map(|&(a, b)| (name(a), name(b))).collect()
}

/// The frame of a link as the format defines it, computed without bodies.
fn world_from_hand(shoulder: f64, elbow: f64) -> DPose3 {
    let at = DPose3::translation;
    let turned = |axis: DVec3, by: f64| DPose3::from_rotation(DQuat::from_axis_angle(axis, by));
    at(0.0, 0.0, 0.3)
        * turned(DVec3::Y, shoulder)
        * at(0.0, 0.0, 0.4)
        * turned(-DVec3::Z, elbow)
        * at(0.2, 0.0, 0.0)
        * turned(DVec3::Z, 0.5)
}

#[test]
fn joints_have_names_limits_and_motions_of_the_document() {
    let chain = arm();
    assert_eq!((chain.name.as_str(), chain.dof()), ("two", 2));
    let [shoulder, elbow] = &chain.joints[..] else { panic!("two joints move") };
    assert_eq!((shoulder.name.as_str(), shoulder.motion), ("shoulder", JointMotion::Turn));
    assert_eq!((shoulder.lower, shoulder.upper, shoulder.max_velocity), (-1.5, 2.0, 3.0));
    assert_eq!(
        (elbow.lower, elbow.upper, elbow.max_velocity),
        (f32::NEG_INFINITY, f32::INFINITY, 1.0)
    );
}

#[test]
fn links_are_where_the_documents_transforms_put_them() {
    let chain = arm();
    for (first, second) in [(0.0, 0.0), (0.4, -1.2), (-1.5, 3.0)] {
        let bodies = chain.body_frames(&config(first, second));
        let expected = world_from_hand(f64::from(first), f64::from(second));
        let hand = link(&chain, "hand");
        let found = bodies[hand.body] * hand.body_from_link;
        assert!(
            found.translation.distance(expected.translation) < 1e-12,
            "{found:?} instead of {expected:?}"
        );
        assert!(found.rotation.dot(expected.rotation).abs() > 1.0 - 1e-12);
        let tip = chain.grip_f64(&config(first, second));
        assert!(tip.translation.distance(expected * DVec3::new(0.1, 0.0, 0.0)) < 1e-12);
    }
}

#[test]
fn what_hangs_on_the_hand_stays_at_rest_within_its_limits() {
    let chain = arm();
    let hand = link(&chain, "hand").body_from_link;
    for (name, y) in [("left", 0.01), ("right", -0.01)] {
        let finger = link(&chain, name);
        let hand_from_finger = hand.inverse() * finger.body_from_link;
        assert!(
            hand_from_finger.translation.distance(DVec3::new(0.0, y, 0.0)) < 1e-9,
            "{name}: {hand_from_finger:?}"
        );
        assert_eq!(finger.body, 2);
    }
}

#[test]
fn given_spheres_are_used_as_they_are_and_other_geometry_is_covered() {
    let chain = arm();
    let base = link(&chain, "base");
    assert_eq!(base.spheres, [crate::robot::Sphere { center: Vec3::ZERO, radius: 0.1 }]);
    assert_eq!((base.overshoot, link(&chain, "fore").overshoot), (0.0, 0.0));
    let upper = link(&chain, "upper");
    let last = upper.spheres.last().expect("spheres of both elements");
    // In the frame of the body, whose z is the shoulder's axis: y of the link.
    let body_from_upper = upper.body_from_link;
    assert_eq!(last.radius, 0.07);
    assert!(last.center.as_dvec3().distance(body_from_upper * DVec3::new(0.0, 0.0, 0.4)) < 1e-7);
    assert!((body_from_upper * DVec3::Y).distance(DVec3::Z) < 1e-12);
    assert!(
        upper.spheres.len() > 2 && upper.overshoot > 0.0 && upper.overshoot < 0.011,
        "{}",
        upper.overshoot
    );
    assert!(link(&chain, "hand").spheres.len() > 1);
}

#[test]
fn without_semantics_neighbouring_bodies_may_touch() {
    let expected = [
        ("base", "upper"),
        ("upper", "fore"),
        ("upper", "hand"),
        ("upper", "right"),
        ("fore", "hand"),
        ("fore", "right"),
        ("hand", "right"),
    ];
    assert_eq!(allowed(&arm()), expected);
}

#[test]
fn semantics_say_which_link_is_the_tip_and_which_pairs_are_allowed() {
    let chain = Robot::from_urdf(ARM, Some(SEMANTICS), None, &no_meshes).expect("a valid document");
    assert_eq!(chain.grip(&config(0.3, 0.4)), arm().grip(&config(0.3, 0.4)));
    assert_eq!(
        allowed(&chain),
        [("base", "upper"), ("fore", "hand"), ("fore", "right"), ("hand", "right")]
    );
    let other_tip = Robot::from_urdf(ARM, Some(SEMANTICS), Some("upper"), &no_meshes)
        .expect("a valid document");
    assert_eq!(other_tip.dof(), 1);
}

/// Obstacles of a problem set were taken to be in the frame of the group's base, 0.9 m above the root
/// that they are given in.
#[test]
fn the_root_is_the_world_also_where_the_base_of_the_group_is_above_it() {
    let from_upper = SEMANTICS.replace("base_link=\"base\"", "base_link=\"upper\"");
    let chain =
        Robot::from_urdf(ARM, Some(&from_upper), None, &no_meshes).expect("a valid document");
    assert_eq!((chain.dof(), chain.joints[0].name.as_str()), (1, "elbow"));
    let (base, upper) = (link(&chain, "base"), link(&chain, "upper"));
    assert_eq!((base.body, base.body_from_link), (0, DPose3::IDENTITY));
    let up = DVec3::new(0.0, 0.0, 0.3);
    assert_eq!(upper.body, 0);
    assert!(upper.body_from_link.translation.distance(up) < 1e-12);
    let expected = DVec3::new(0.0, 0.0, 0.7);
    assert!(chain.body_frames(&config(0.0, 0.0))[1].translation.distance(expected) < 1e-12);
}

#[test]
fn the_only_leaf_of_the_longest_chain_is_the_tip() {
    // A finger with a motor of its own belongs to the longest chain: such a document needs a tip or
    // semantics.
    let to_finger = Robot::from_urdf(ARM, None, None, &no_meshes)
        .expect("one finger has the most motors above it");
    assert_eq!(to_finger.joints[2].name, "grasp");
    let without_fingers = ARM.replace("type=\"prismatic\"", "type=\"fixed\"").replace(
        "<joint name=\"flange\" type=\"fixed\">",
        "<joint name=\"flange\" type=\"continuous\">",
    );
    let chain = Robot::from_urdf(&without_fingers, None, None, &no_meshes)
        .expect("the tool is the one tip");
    assert_eq!((chain.dof(), chain.joints[2].name.as_str()), (3, "flange"));
    let ambiguous = message(&ARM.replace("type=\"prismatic\"", "type=\"fixed\""));
    assert!(
        ["left", "right", "tool", "tip: expected"].iter().all(|name| ambiguous.contains(name)),
        "{ambiguous}"
    );
}

#[test]
fn an_axis_is_x_where_none_is_stated_and_any_direction_where_one_is() {
    for (stated, axis) in [
        ("", DVec3::X),
        ("<axis xyz='1 1 -1'/>", DVec3::new(1.0, 1.0, -1.0).normalize()),
        ("<axis xyz='1e-9 0 -1'/>", DVec3::NEG_Z),
        ("<axis xyz='0 0 5'/>", DVec3::Z),
    ] {
        let text = ARM.replace("<axis xyz=\"0 0 -1\"/>", stated);
        let chain =
            Robot::from_urdf(&text, None, Some("fore"), &no_meshes).expect("a valid document");
        let [before, after] =
            [0.0, FRAC_PI_2 as f32].map(|q| chain.grip_f64(&config(0.0, q)).rotation);
        let turn = after * before.inverse();
        let expected = DQuat::from_axis_angle(axis, FRAC_PI_2);
        assert!(
            turn.dot(expected).abs() > 1.0 - 1e-12,
            "{stated}: {turn:?} instead of {expected:?}"
        );
    }
}

#[test]
fn meshes_are_asked_for_by_the_name_in_the_document() {
    let text = ARM.replace(
        "<box size=\"0.02 0.1 0.03\"/>",
        "<mesh filename=\"package://two/hand.OBJ\" scale=\"0.001 0.001 0.001\"/>",
    );
    let reader = |file: &str| {
        (file == "package://two/hand.OBJ")
            .then(|| b"v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n".to_vec())
    };
    let chain = Robot::from_urdf(&text, None, Some("tool"), &reader).expect("the mesh is there");
    let hand = link(&chain, "hand");
    assert!(
        hand.spheres
            .iter()
            .all(|ball| (hand.body_from_link.inverse() * ball.center.as_dvec3()).length() < 0.15)
    );
    let error = message(&text);
    assert!(
        error.contains("link 'hand'")
            && error.contains("<mesh> on line")
            && error.contains("package://two/hand.OBJ"),
        "{error}"
    );
}

fn message(urdf: &str) -> String {
    Robot::from_urdf(urdf, None, None, &no_meshes)
        .expect_err("a document with a mistake")
        .to_string()
}

/// Fails unless `ARM` with that change is an error that contains all of `expected`.
#[track_caller]
fn check(from: &str, to: &str, expected: &[&str]) {
    assert!(ARM.contains(from), "nothing to change: {from}");
    let error = message(&ARM.replacen(from, to, 1));
    assert!(expected.iter().all(|part| error.contains(part)), "{error}");
}

#[test]
fn mistakes_in_numbers_name_element_line_and_attribute() {
    check(
        "xyz=\"0 0 0.3\"",
        "xyz=\"0 0\"",
        &["joint 'shoulder'", "<origin> on line 20", "'xyz' needs 3 numbers, not '0 0'"],
    );
    check("xyz=\"0 0 0.3\"", "xyz=\"0 0 0 0.3\"", &["joint 'shoulder'", "needs 3 numbers"]);
    check("rpy=\"0 0 0\"", "rpy=\"0 NaN 0\"", &["joint 'shoulder'", "'rpy' is not finite"]);
    check("rpy=\"0 0 0\"", "rpy=\"0 0 1e400\"", &["'rpy' is not finite"]);
    check(
        "xyz=\"0 0 0.3\"",
        "xyz=\"0 0 ${height}\"",
        &["joint 'shoulder'", "<origin> on line 20", "not expanded"],
    );
    check("xyz=\"0 0 0.3\"", "xyz=\"0 0 300000\"", &["'xyz' is more than 1000 m"]);
    check(
        "xyz=\"0 2 0\"",
        "xyz=\"0 0 0\"",
        &["joint 'shoulder'", "<axis> on line 21", "other than 0 0 0"],
    );
    check("xyz=\"0 2 0\"", "", &["joint 'shoulder'", "<axis>", "'xyz' is missing"]);
    check(
        "radius=\"0.1\"",
        "radius=\"-0.1\"",
        &["link 'base'", "<sphere> on line 6", "'radius' must be positive: '-0.1'"],
    );
    check("radius=\"0.1\"", "radius=\"0\"", &["'radius' must be positive"]);
    check("radius=\"0.1\"", "", &["link 'base'", "'radius' is missing"]);
    check(
        "size=\"0.02 0.1 0.03\"",
        "size=\"0.02 0.1\"",
        &["link 'hand'", "<box>", "'size' needs 3 numbers"],
    );
    check(
        "lower=\"-1.5\" upper=\"2\"",
        "lower=\"2\" upper=\"1\"",
        &["joint 'shoulder'", "<limit>", "'lower' 2 is above 'upper' 1"],
    );
    check(
        "<limit lower=\"-1.5\" upper=\"2\" effort=\"1\" velocity=\"3\"/>",
        "",
        &["joint 'shoulder'", "<limit> is missing"],
    );
}

#[test]
fn mistakes_in_structure_name_links_and_joints() {
    check(
        "<child link=\"fore\"/>",
        "<child link=\"four\"/>",
        &["joint 'elbow'", "<child>", "no link 'four'"],
    );
    check("<child link=\"fore\"/>", "", &["joint 'elbow'", "<child> is missing"]);
    check(
        "<child link=\"fore\"/>",
        "<child link=\"upper\"/>",
        &["link 'upper' is the child of two joints, 'shoulder' and 'elbow'"],
    );
    check(
        "<link name=\"fore\">",
        "<link name=\"upper\">",
        &["link 'upper'", "a second link of that name"],
    );
    check(
        "<joint name=\"elbow\"",
        "<joint name=\"shoulder\"",
        &["joint 'shoulder'", "a second joint of that name"],
    );
    check("<link name=\"fore\">", "<link>", &["<link> on line 12", "'name' is missing"]);
    check("type=\"continuous\"", "type=\"ball\"", &["joint 'elbow'", "unknown type 'ball'"]);
    check("type=\"continuous\"", "", &["joint 'elbow'", "'type' is missing"]);
    check(
        "<sphere radius=\"0.1\"/>",
        "<cone radius=\"0.1\"/>",
        &["link 'base'", "<cone> on line 6", "unknown geometry 'cone'"],
    );
    check("<sphere radius=\"0.1\"/>", "", &["link 'base'", "<geometry> on line 6", "it is empty"]);
    check("<material name=\"grey\"/>", "<xacro:arm prefix=\"a\"/>", &["<arm> on line 3", "xacro"]);
    check("</robot>", "", &["URDF, line"]);
    check("<robot name=\"two\"", "<model name=\"two\"", &["URDF, line"]);
    assert!(message("<model/>").contains("not <robot>"));
    assert!(message("<robot/>").contains("no <link>"));
    assert!(message("").contains("URDF, line 1"));
    assert!(message("<robot name='one'><link name='a'/></robot>").contains("no joint moves"));
}

#[test]
fn loops_and_several_roots_are_named() {
    let joint = |i: usize, parent: &str, child: &str| {
        format!(
            "<joint name='j{i}' type='fixed'><parent link='{parent}'/><child link='{child}'/></joint>"
        )
    };
    let robot = |joints: &str| {
        message(&format!(
            "<robot name='r'><link name='a'/><link name='b'/><link name='c'/>{joints}</robot>"
        ))
    };
    let error =
        robot(&format!("{}{}{}", joint(0, "a", "b"), joint(1, "b", "c"), joint(2, "c", "a")));
    assert!(error.contains("hangs on itself: a loop"), "{error}");
    let error = robot(&format!("{}{}", joint(0, "b", "c"), joint(1, "c", "b")));
    assert!(
        error.contains("link 'b' hangs on itself") || error.contains("link 'c' hangs on itself"),
        "{error}"
    );
    assert!(
        robot(&joint(0, "b", "b")).contains("more than one link hangs on none"),
        "{}",
        robot(&joint(0, "b", "b"))
    );
    let error = robot(&joint(0, "a", "b"));
    assert!(error.contains("more than one link hangs on none: 'a', 'c'"), "{error}");
}

#[test]
fn a_tip_that_cannot_be_reached_by_sixteen_joints_or_fewer_is_refused() {
    let tip = |text: &str, srdf: Option<&str>, tip| {
        Robot::from_urdf(text, srdf, tip, &no_meshes).expect_err("no arm").to_string()
    };
    let unknown = tip(ARM, None, Some("nose"));
    assert!(unknown.contains("'left', 'right', 'tool', found 'nose'"), "{unknown}");
    let stands = tip(ARM, None, Some("base"));
    assert!(
        stands.contains("the tip 'base': tips that move are 'left', 'right', 'tool'"),
        "{stands}"
    );
    let floating = ARM.replace("type=\"continuous\"", "type=\"floating\"");
    assert!(
        tip(&floating, None, Some("tool"))
            .contains("joint 'elbow' stands between base and tip, but moves in more")
    );
    let upside_down = SEMANTICS.replace("base_link=\"base\"", "base_link=\"left\"");
    let options =
        UrdfOptions { srdf: Some(&upside_down), group: Some("arm"), ..UrdfOptions::default() };
    let error = Robot::describe(ARM, &options, &no_meshes).expect_err("no chain").to_string();
    assert!(error.contains("link 'tool' does not hang on link 'left'"), "{error}");
    assert!(
        tip(&snake(17), None, None)
            .contains("17 joints move between the base and the tip 'l17', at most 16")
    );
    let longest = Robot::from_urdf(&snake(16), None, None, &no_meshes).expect("sixteen joints");
    assert_eq!(longest.dof(), 16);
}

/// A chain of so many joints.
pub(super) fn snake(n: usize) -> String {
    let links: String = (0..=n).map(|i| format!("<link name='l{i}'/>")).collect();
    let joint = |i: usize| {
        format!(
            "<joint name='j{i}' type='continuous'><parent link='l{i}'/><child link='l{}'/></joint>",
            i + 1
        )
    };
    format!("<robot name='snake'>{links}{}</robot>", (0..n).map(joint).collect::<String>())
}
