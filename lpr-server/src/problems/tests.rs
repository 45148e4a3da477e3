use super::*;
use lpr_tests::mistake;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::fs;

/// One obstacle of each kind.
const PROBLEMS: &str = r#"{"robot": "xarm7", "problems": [{"name": "all",
  "start": [-0.8, 0.2, 0, 1.0, 0, 1.2, 0],
  "goals": [[0.8, 0.2, 0, 1.0, 0, 1.2, 0]],
  "capsules": [{"a": [0.45, 0, 0], "b": [0.45, 0.5, 0.6], "radius": 0.03}],
  "cuboids": [{"center": [0.4, 0, -0.05], "rotation_xyzw": [0, 0, 0, 1], "half_extents": [0.1, 0.1, 0.04]}],
  "spheres": [{"center": [0, 0.9, 0.9], "radius": 0.1}],
  "cylinders": [{"center": [-0.6, 0, 0.3], "rotation_xyzw": [0, 0, 0, 1], "radius": 0.1, "half_length": 0.3}],
  "points": [[0.45, 0.0, 0.62]], "point_radius": 0.02}]}
"#;

/// The scenes of a file, or what is said of it after its path.
fn scenes(text: &[u8]) -> Result<Vec<Scene>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.json");
    fs::write(&path, text).unwrap();
    let scene = |(idx, problem): (usize, &Problem)| problem.scene(&path, idx);
    let scenes =
        read_problems(&path).and_then(|file| file.problems.iter().enumerate().map(scene).collect());
    scenes.map_err(|error| {
        let error = error.to_string();
        error
            .strip_prefix(&format!("{}: ", path.display()))
            .unwrap_or_else(|| panic!("{error}"))
            .to_owned()
    })
}

#[test]
fn a_length_that_is_no_length_is_told_with_its_field() {
    for (from, field) in [
        ("0.45, 0, 0]", "capsules[0].a"),
        ("0.45, 0.5, 0.6", "capsules[0].b"),
        ("0.03", "capsules[0].radius"),
        ("0.4, 0, -0.05", "cuboids[0].center"),
        ("0.1, 0.1, 0.04", "cuboids[0].half_extents"),
        ("0, 0.9, 0.9", "spheres[0].center"),
        ("0.1}", "spheres[0].radius"),
        ("-0.6, 0, 0.3", "cylinders[0].center"),
        ("0.1, \"half_length\"", "cylinders[0].radius"),
        ("0.3}", "cylinders[0].half_length"),
        ("0.45, 0.0, 0.62", "points[0]"),
        ("0.02", "point_radius"),
    ] {
        assert_eq!(PROBLEMS.matches(from).count(), 1, "{from}");
        let number = from.split([',', '}', ']']).next().unwrap();
        for bad in ["1e39", "-1e39", "1e20"] {
            let error =
                scenes(PROBLEMS.replacen(from, &from.replacen(number, bad, 1), 1).as_bytes())
                    .unwrap_err();
            let is_told = ["expected", "out of range"].iter().any(|it| error.contains(it));
            assert!(error.starts_with(&format!("problems[0].{field}")) && is_told, "{error}");
        }
    }
}

#[test]
fn a_capsule_too_long_to_be_squared_does_not_vanish() {
    let long = PROBLEMS
        .replace("0.45, 0, 0]", "0.45, 0, -1e20]")
        .replace("0.45, 0.5, 0.6", "0.45, 0, 1e20");
    let error = scenes(long.as_bytes()).unwrap_err();
    assert_eq!(
        error,
        "problems[0].capsules[0].a: has -100000000000000000000, expected -1000 to 1000"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_file_with_one_mistake_makes_scenes_or_a_message_that_says_where(mistake in mistake()) {
        match scenes(&mistake.made_in(PROBLEMS.as_bytes())) {
            Ok(scenes) => {
                let is_somewhere = |solid: &Primitive| solid.distance(Vec3::ZERO).is_finite();
                prop_assert!(scenes.iter().flat_map(Scene::primitives).all(is_somewhere));
            }
            Err(message) => prop_assert!(message.contains("problems") || message.contains("line "), "{message}"),
        }
    }

    #[test]
    fn arbitrary_bytes_are_a_message(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(scenes(&bytes).is_err_and(|message| message.contains("line ")));
    }
}
