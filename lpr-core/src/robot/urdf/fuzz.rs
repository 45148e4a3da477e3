//! Documents that are broken in ways nobody thought of: an arm or a message, never a panic; with
//! `make fuzz` many of them, each within a second.

use super::tests::{ARM, SEMANTICS, snake};
use super::*;
use lpr_tests::{few_or_many, in_time, mistake};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::RngSeed;
use std::ops::Range;

const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// The semantics with a number in them, which nobody reads.
const NUMBERED_SEMANTICS: &str = r#"<robot name="two">
  <group name="all"><link name="hand"/><joint name="elbow"/></group>
  <group name="arm"><chain base_link="base" tip_link="tool"/></group>
  <group_state name="home" group="arm"><joint name="elbow" value="0.5"/></group_state>
  <disable_collisions link1="upper" link2="base" reason="Adjacent"/>
</robot>"#;

/// Place of a change, and the text that is put there.
#[derive(Debug, Clone)]
enum Change {
    Cut(Index),
    Remove(Index, Index),
    Replace(Index, &'static str),
    /// The value of an attribute.
    Value(Index, &'static str),
    /// Two values, so that what refers to one refers to the other.
    Swap(Index, Index),
    /// A whole joint, which is lost or there twice.
    Joint(Index, bool),
}

fn change() -> impl Strategy<Value = Change> {
    let words = [
        "\"",
        "<",
        "/>",
        "NaN",
        "-1",
        "1e300",
        "0",
        "",
        " ",
        "\u{0}",
        "&amp;",
        "&x;",
        "<!--",
        "<![CDATA[",
        "<joint/>",
        "<link name='base'/>",
        "mesh",
        "name",
        "base",
        "hand",
        "xacro:",
        "é",
    ];
    let values = [
        "",
        "0",
        "-1",
        "nan",
        "inf",
        "1e300",
        "-1e-300",
        "0 0 0",
        "1 2 3 4",
        "1,5",
        "0x10",
        "base",
        "world",
        "elbow",
        "fixed",
        "continuous",
        "prismatic",
        "floating",
        "<",
    ];
    let any_index = any::<Index>;
    prop_oneof![
        any_index().prop_map(Change::Cut),
        (any_index(), any_index()).prop_map(|(a, b)| Change::Remove(a, b)),
        (any_index(), prop::sample::select(words.to_vec()))
            .prop_map(|(at, word)| Change::Replace(at, word)),
        (any_index(), prop::sample::select(values.to_vec()))
            .prop_map(|(at, value)| Change::Value(at, value)),
        (any_index(), any_index()).prop_map(|(a, b)| Change::Swap(a, b)),
        (any_index(), any::<bool>()).prop_map(|(at, is_lost)| Change::Joint(at, is_lost)),
    ]
}

/// The values of attributes.
fn values(text: &str) -> Vec<Range<usize>> {
    let quotes: Vec<usize> = text.match_indices('"').map(|(at, _)| at).collect();
    quotes.chunks_exact(2).map(|pair| pair[0] + 1..pair[1]).collect()
}

/// Changes values and joints, which leaves XML, and then whole words, which often does.
fn changed(text: &str, changes: &[Change]) -> String {
    let mut text = text.to_owned();
    for change in changes {
        let values = values(&text);
        match change {
            Change::Value(at, value) if !values.is_empty() => {
                text.replace_range(at.get(&values).clone(), value);
            }
            Change::Swap(a, b) if !values.is_empty() => {
                let (a, b) = (a.get(&values).clone(), b.get(&values).clone());
                let (first, second) = if a.start <= b.start { (a, b) } else { (b, a) };
                let (of_first, of_second) =
                    (text[first.clone()].to_owned(), text[second.clone()].to_owned());
                text.replace_range(second, &of_first);
                text.replace_range(first, &of_second);
            }
            Change::Joint(at, is_lost) => {
                let starts: Vec<usize> = text.match_indices("<joint").map(|(at, _)| at).collect();
                let Some(&start) = starts.get(at.index(starts.len().max(1))) else { continue };
                let Some(length) = text[start..].find("</joint>") else { continue };
                let end = start + length + "</joint>".len();
                let joint = text[start..end].to_owned();
                text.replace_range(start..end, "");
                if !is_lost {
                    text.insert_str(start, &joint.repeat(2));
                }
            }
            _ => {}
        }
    }
    changed_by_words(&text, changes)
}

fn changed_by_words(text: &str, changes: &[Change]) -> String {
    let mut words: Vec<String> =
        text.split_inclusive(['"', ' ', '<', '>', '=']).map(str::to_owned).collect();
    for change in changes.iter().filter(|_| !text.is_empty()) {
        if words.is_empty() {
            break;
        }
        match change {
            Change::Cut(at) if at.index(4) == 0 => words.truncate(at.index(words.len())),
            Change::Cut(at) => drop(words.remove(at.index(words.len()))),
            Change::Remove(a, b) => {
                let (a, n) = (a.index(words.len()), b.index(12));
                drop(words.drain(a..(a + n).min(words.len())));
            }
            Change::Replace(at, word) => {
                let at = at.index(words.len());
                let ending: String = words[at]
                    .chars()
                    .last()
                    .filter(|last| "\" <>=".contains(*last))
                    .into_iter()
                    .collect();
                words[at] = format!("{word}{ending}");
            }
            _ => {}
        }
    }
    words.concat()
}

fn config() -> ProptestConfig {
    ProptestConfig {
        cases: few_or_many(128),
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// With an arm, its poses are finite; without one, the message names a line, a link or a joint.
fn check(
    urdf: &str,
    srdf: Option<&str>,
    tip: Option<&str>,
    mesh: &[u8],
) -> Result<(), TestCaseError> {
    let found = in_time(|| Robot::from_urdf(urdf, srdf, tip, &|_| Some(mesh.to_vec())));
    match found {
        Ok(chain) => {
            prop_assert!((1..=MAX_JOINTS).contains(&chain.dof()));
            prop_assert!(chain.grip_f64(&chain.middle()).is_finite());
            let spheres = || chain.links.iter().flat_map(|link| &link.spheres);
            prop_assert!(spheres().all(|ball| ball.center.is_finite()
                && ball.radius > 0.0
                && ball.radius.is_finite()));
            prop_assert!(
                chain.allowed_self_collisions.iter().all(|&(a, b)| a < b && b < chain.links.len())
            );
        }
        Err(error) => {
            let message = error.to_string();
            prop_assert!(
                message.starts_with("robot: ")
                    && ["line ", "'"].iter().any(|it| message.contains(it)),
                "{message}"
            );
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn changed_documents_are_an_arm_or_a_message(
        changes in prop::collection::vec(change(), 0..4), in_semantics in prop::collection::vec(change(), 0..3),
    ) {
        // A mesh instead of the box takes the parsers of both through it, too.
        let arm = ARM.replace("<box size=\"0.02 0.1 0.03\"/>", "<mesh filename=\"a.obj\" scale=\"0.1 0.1 0.1\"/>");
        check(&changed(&arm, &changes), Some(&changed(SEMANTICS, &in_semantics)), None, b"v 1 2 3\nf 1 1 1")?;
        check(&changed(ARM, &changes), None, Some("tool"), &[])?;
    }

    #[test]
    fn a_document_with_one_mistake_is_an_arm_or_a_message_that_names_it(mistake in mistake()) {
        // Boxes take a while to cover.
        let valid = ARM.replace("<box size=\"0.02 0.1 0.03\"/>", "<sphere radius=\"0.03\"/>");
        let arm = String::from_utf8_lossy(&mistake.made_in(valid.as_bytes())).into_owned();
        let semantics = String::from_utf8_lossy(&mistake.made_in(NUMBERED_SEMANTICS.as_bytes())).into_owned();
        check(&arm, None, Some("tool"), &[])?;
        check(&arm, Some(SEMANTICS), None, &[])?;
        check(&valid, Some(&semantics), None, &[])?;
    }

    #[test]
    fn changed_meshes_are_covered_or_a_message(changes in prop::collection::vec(change(), 0..4)) {
        let arm = ARM.replace("<box size=\"0.02 0.1 0.03\"/>", "<mesh filename=\"a.obj\" scale=\"0.1 0.1 0.1\"/>");
        check(&arm, None, Some("tool"), changed(MESH, &changes).as_bytes())?;
    }

    #[test]
    fn arbitrary_text_is_a_message(text in "\\PC{0,80}", bytes in prop::collection::vec(any::<u8>(), 0..80)) {
        check(&text, None, None, &[])?;
        check(&String::from_utf8_lossy(&bytes), Some(&text), None, &[])?;
        check(ARM, Some(&text), None, &[])?;
    }
}

#[test]
fn documents_may_be_deep_long_and_full_of_elements() {
    const N: usize = 200_000;
    let nested = format!("<robot>{}{}</robot>", "<a>".repeat(N), "</a>".repeat(N));
    let many = format!("<robot name='r'>{}</robot>", "<link name='a'/>".repeat(N));
    let long = format!("<robot name='{}'><link name='{}'/></robot>", "n".repeat(N), "m".repeat(N));
    let entities =
        "<!DOCTYPE r [<!ENTITY a 'aaaaaaaa'><!ENTITY b '&a;&a;&a;&a;'>]><robot name='&b;'/>";
    for text in [nested.as_str(), &many, &long, &snake(N), entities] {
        let error = Robot::from_urdf(text, None, None, &|_| None).expect_err("no arm").to_string();
        assert!(error.len() < 1000, "{} characters", error.len());
    }
}

#[test]
fn a_link_may_be_deep_in_the_tree_if_few_joints_move() {
    const N: usize = 100_000;
    let fixed = snake(N)
        .replacen("continuous", "revolving", 3)
        .replace("continuous", "fixed")
        .replace("revolving", "continuous");
    let chain = Robot::from_urdf(&fixed, None, None, &|_| None).expect("three joints move");
    assert_eq!((chain.dof(), chain.links.len()), (3, N + 1));
}

#[test]
fn too_many_links_with_geometry_are_refused() {
    let ball = "<collision><geometry><sphere radius='1'/></geometry></collision>";
    let text = snake(3).replace("<link name='l3'/>", &format!("<link name='l3'>{ball}</link>"));
    let joint = |i: usize| {
        format!("<joint name='k{i}' type='fixed'><parent link='l3'/><child link='k{i}'/></joint>")
    };
    let leaves: String =
        (0..600).map(|i| format!("<link name='k{i}'>{ball}</link>{}", joint(i))).collect();
    let text = text.replace("</robot>", &format!("{leaves}</robot>"));
    let error =
        Robot::from_urdf(&text, None, Some("l3"), &|_| None).expect_err("601 links").to_string();
    assert!(error.contains("601 links have collision geometry, at most 500"), "{error}");
}
