//! The command line as a script sees it: the real binary, its exit status, both of its outputs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, command, refusal, silent_json, table, text};
use serde_json::{Value, json};

/// A directory with one JSON file.
struct Input {
    _folder: Folder,
    path: String,
}

impl Input {
    fn new(content: &Value) -> Self {
        let folder = Folder::new();
        let path = folder.write("input.json", content.to_string());
        Self { _folder: folder, path }
    }

    fn path(&self) -> &str {
        &self.path
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Standard output of a successful command that leaves standard error alone.
#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let output = command(arguments).output().unwrap();
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    text(&output.stdout)
}

#[test]
fn without_arguments_five_lines_say_what_to_try() {
    assert_eq!(printed(&[]).lines().count(), 5);
}

#[test]
fn help_and_version_are_no_failures() {
    for arguments in [["--help"], ["--version"], ["help"]] {
        assert!(printed(&arguments).contains("lpr"));
    }
}

#[test]
fn wrong_usage_is_status_2_and_names_the_argument() {
    assert!(refusal(&["fly"], 2).contains("'fly'"));
    assert!(refusal(&["fk"], 2).contains("--configs <FILE>"));
    assert!(refusal(&["robots", "--jsno"], 2).contains("'--jsno'"));
    let unknown_robot = refusal(&["fk", "--robot", "ur5", "--configs", "x.json"], 2);
    assert!(
        unknown_robot.contains("robot: expected one of xarm7, panda, found 'ur5'"),
        "{unknown_robot}"
    );
    let no_solutions = refusal(&["ik", "--poses", "x.json", "--solutions", "0"], 2);
    assert!(no_solutions.contains("0 is not in 1..=1000"), "{no_solutions}");
}

#[test]
fn a_missing_file_is_status_1_and_named() {
    let error = refusal(&["fk", "--configs", "no/such/file.json"], 1);
    assert!(error.starts_with("no/such/file.json: cannot read: "), "{error}");
}

#[test]
fn a_malformed_file_is_named_with_its_field() {
    let refusal = |command: &str, option: &str, content: Value| {
        let input = Input::new(&content);
        let error = refusal(&[command, option, input.path()], 1);
        error.strip_prefix(&format!("{}: ", input.path())).unwrap().to_owned()
    };
    let error =
        refusal("fk", "--configs", json!({"configs": [[0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]}));
    assert!(error.starts_with("configs[1]: has 6 joint angles, xarm7 has 7"), "{error}");
    let error = refusal("fk", "--configs", json!({"configs": [[0, 0, 0, 0, 0, 0, 1e300]]}));
    assert!(error.starts_with("configs[0][6]: is not a finite number"), "{error}");
    let error = refusal(
        "ik",
        "--poses",
        json!({"poses": [{"position": [0, 0, 0], "rotation_xyzw": [0, 0, 0, 0]}]}),
    );
    assert_eq!(error, "poses[0].rotation_xyzw: has norm 0, expected a unit quaternion");
    let error = refusal(
        "ik",
        "--poses",
        json!({"poses": [{"position": [0, 0, 0], "quaternion": [0, 0, 0, 1]}]}),
    );
    assert!(error.contains("unknown field `quaternion`"), "{error}");
}

#[test]
fn robots_lists_limits_in_order() {
    let robots = &silent_json(&["robots"])["robots"];
    let names: Vec<_> =
        robots.as_array().unwrap().iter().map(|robot| robot["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["xarm7", "panda"]);
    for robot in robots.as_array().unwrap() {
        let limits = robot["limits"].as_array().unwrap();
        assert_eq!(robot["dof"], limits.len());
        assert!(limits.iter().map(numbers).all(|limit| limit[0] < limit[1]));
    }
    assert!(table(&["robots"]).contains("panda"));
}

/// Configurations within the limits of both arms, away from their ends.
fn test_configs() -> Vec<[f64; 7]> {
    vec![
        [0.0, -0.5, 0.1, -1.2, 0.2, 1.4, 0.3],
        [0.7, 0.3, -0.4, -1.9, -0.3, 2.0, -0.8],
        [-1.1, 0.6, 0.5, -1.0, 1.2, 0.9, 1.5],
    ]
}

fn flange_poses(robot: &str, configs: &Value) -> Value {
    let input = Input::new(&json!({"configs": configs}));
    silent_json(&["fk", "--robot", robot, "--configs", input.path()])["poses"].clone()
}

/// Farthest apart of two poses in position (metres) and quaternion.
fn pose_error(a: &Value, b: &Value) -> f64 {
    let error = |field: &str, sign: f64| -> f64 {
        numbers(&a[field])
            .iter()
            .zip(numbers(&b[field]))
            .map(|(a, b)| (a - sign * b).abs())
            .fold(0.0, f64::max)
    };
    error("position", 1.0).max(error("rotation_xyzw", 1.0).min(error("rotation_xyzw", -1.0)))
}

#[test]
fn every_ik_solution_leads_back_to_its_pose() {
    for robot in ["xarm7", "panda"] {
        let configs = if robot == "panda" {
            json!(test_configs())
        } else {
            // The elbow of the xArm7 bends the other way.
            json!(
                test_configs()
                    .into_iter()
                    .map(|q| q.map(|angle| -angle))
                    .map(|mut q| {
                        q[5] = -q[5];
                        q
                    })
                    .collect::<Vec<_>>()
            )
        };
        let poses = flange_poses(robot, &configs);
        let input = Input::new(&json!({"poses": poses}));
        let results = silent_json(&[
            "ik",
            "--robot",
            robot,
            "--poses",
            input.path(),
            "--solutions",
            "5",
        ])["results"]
            .clone();
        for (pose, result) in poses.as_array().unwrap().iter().zip(results.as_array().unwrap()) {
            let solutions = result["solutions"].as_array().unwrap();
            assert_eq!(solutions.len(), 5, "{robot}: {result}");
            assert!(result["reason"].is_null() && result["micros"].as_f64() > Some(0.0));
            for reached in flange_poses(robot, &result["solutions"]).as_array().unwrap() {
                assert!(pose_error(pose, reached) < 1e-4, "{robot}: {pose} {reached}");
            }
        }
    }
}

#[test]
fn a_seed_config_that_solves_the_pose_is_the_solution() {
    let configs = test_configs();
    let mut poses = flange_poses("panda", &json!(configs));
    for (pose, config) in poses.as_array_mut().unwrap().iter_mut().zip(&configs) {
        pose["seed_config"] = json!(config);
    }
    let input = Input::new(&json!({"poses": poses}));
    let results =
        silent_json(&["ik", "--robot", "panda", "--poses", input.path()])["results"].clone();
    for (result, config) in results.as_array().unwrap().iter().zip(configs) {
        let solution = numbers(&result["solutions"][0]);
        assert!(
            solution.iter().zip(config).all(|(a, b)| (a - b).abs() < 1e-3),
            "{solution:?} {config:?}"
        );
    }
}

#[test]
fn an_unreachable_pose_is_a_result_with_a_reason() {
    let pose = |x: f64| json!({"position": [x, 0, 0], "rotation_xyzw": [0, 0, 0, 1]});
    let input = Input::new(&json!({"poses": [pose(5.0), pose(1e300)]}));
    for solutions in ["1", "3"] {
        let results =
            silent_json(&["ik", "--poses", input.path(), "--solutions", solutions])["results"]
                .clone();
        for result in results.as_array().unwrap() {
            assert_eq!(
                (&result["solutions"], &result["reason"]),
                (&json!([]), &json!("unreachable"))
            );
        }
    }
    assert!(table(&["ik", "--poses", input.path()]).contains("unreachable"));
}

#[test]
fn the_same_seed_gives_the_same_solutions() {
    let input = Input::new(
        &json!({"poses": flange_poses("xarm7", &json!([[0.1, 0.2, 0.3, 1.0, 0.1, 1.0, 0.2]]))}),
    );
    let solve = |seed: &str| {
        silent_json(&["ik", "--poses", input.path(), "--solutions", "4", "--seed", seed])["results"]
            [0]["solutions"]
            .clone()
    };
    assert_eq!(solve("7"), solve("7"));
    assert_ne!(solve("7"), solve("8"));
}
