//! Robot descriptions as they are found: each test is named after what went wrong with a file.

use crate::lpr::{Folder, command, json, refusal, refusal_of, text};
use serde_json::{Value, json as value};

/// A link with a ball at x 0.3 that turns about z without end.
const TURNTABLE: &str = r#"<robot name="turntable"><link name="base"/>
  <link name="arm"><collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1"/></joint></robot>"#;

/// A link with a mesh that turns.
fn with_mesh(file: &str) -> String {
    format!(
        r#"<robot name="r"><link name="base"/>
        <link name="arm"><collision><geometry><mesh filename="{file}"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1"/></joint></robot>"#
    )
}

const TETRAHEDRON: &str =
    "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// The result of one problem.
fn plan(folder: &Folder, arm: &[&str], start: &Value, goal: &Value, balls: &Value) -> Value {
    let problem = value!({"name": "p", "start": start, "goals": [goal], "spheres": balls});
    let problems =
        folder.write("problems.json", value!({"robot": "r", "problems": [problem]}).to_string());
    json(&[&["plan", "--simplify", "--problems", &problems, "--robot"], arm].concat())["results"][0]
        .clone()
}

#[test]
fn a_joint_without_end_takes_the_short_way_round_and_starts_anywhere() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let ball = |x: f64, y: f64| value!([{"center": [x, y, 0], "radius": 0.05}]);
    let none = value!([]);
    for (start, goal, balls, cost) in [
        (3.1, -3.1, &none, 0.0832),
        (15.0, 15.1, &none, 0.1),
        (3.0, -3.0, &ball(0.3, 0.0), 0.2832),
        (-3.0, 3.0, &ball(0.3, 0.0), 0.2832),
        // Something is in the short way: the other way round.
        (2.7, -2.7, &ball(-0.3, 0.0), 5.4),
        // Many turns from home.
        (1e9, 1e9 + 0.1, &none, 0.1),
    ] {
        let result = plan(&folder, &[&arm], &value!([start]), &value!([goal]), balls);
        let found = result["cost"].as_f64().unwrap_or(f64::NAN);
        assert!((found - cost).abs() < 1e-3, "{start} to {goal}: {result}");
    }
    let kept = plan(&folder, &[&arm, "--limit-continuous"], &value!([0.0]), &value!([2.0]), &none);
    assert_eq!(kept["reason"], "outside_limits", "{kept}");
}

#[test]
fn a_joint_without_end_is_solved_near_the_seed_wherever_that_is() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let pose = json(&["fk", "--robot", &arm, "--configs", &configs])["poses"][0].clone();
    for seed in [0.0, 7.0, -20.0, 1e6] {
        let mut query = pose.clone();
        query["seed_config"] = value!([seed]);
        let poses = folder.write("poses.json", value!({"poses": [query]}).to_string());
        let found = json(&["ik", "--robot", &arm, "--poses", &poses]);
        let q = found["results"][0]["solutions"][0][0].as_f64().unwrap();
        let turns = (q - 0.5) / core::f64::consts::TAU;
        assert!((turns - turns.round()).abs() < 1e-4, "{found}");
        assert!(seed > 100.0 || (q - seed).abs() < 3.15, "{seed}: {found}");
    }
}

#[test]
fn a_seed_outside_the_limits_of_a_built_in_arm_is_turned_back_inside() {
    let folder = Folder::new();
    let start = lpr_core::robot::XARM7.start;
    let configs = folder.write("configs.json", value!({"configs": [start.to_vec()]}).to_string());
    let pose = json(&["fk", "--configs", &configs])["poses"][0].clone();
    for (joint, q) in [(6, 9.0), (6, -9.0), (0, 40.0), (3, 9.0), (1, -5.0)] {
        let mut seed = start.to_vec();
        seed[joint] = q;
        let mut query = pose.clone();
        query["seed_config"] = value!(seed);
        let poses = folder.write("poses.json", value!({"poses": [query]}).to_string());
        let found = json(&["ik", "--poses", &poses]);
        let solutions = found["results"][0]["solutions"].as_array().unwrap();
        assert_eq!(solutions.len(), 1, "joint {joint} at {q}: {found}");
    }
}

#[test]
fn files_in_latin_letters_with_a_mark_or_a_name_in_capitals_are_read() {
    let folder = Folder::new();
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let expected = {
        let arm = folder.write("plain.urdf", TURNTABLE);
        json(&["fk", "--robot", &arm, "--configs", &configs])
    };
    let latin =
        [b"<?xml version='1.0' encoding='ISO-8859-1'?><!-- caf\xe9 -->", TURNTABLE.as_bytes()]
            .concat();
    let marked = [b"\xef\xbb\xbf", TURNTABLE.as_bytes()].concat();
    let prefixed = TURNTABLE.replace("</robot>", "<gazebo><sensor:ray a:b='1'/></gazebo></robot>");
    for (name, bytes) in [
        ("latin.urdf", latin.as_slice()),
        ("marked.urdf", &marked),
        ("CAPITALS.URDF", TURNTABLE.as_bytes()),
        ("prefixed.urdf", prefixed.as_bytes()),
    ] {
        let arm = folder.write(name, bytes);
        assert_eq!(json(&["fk", "--robot", &arm, "--configs", &configs]), expected, "{name}");
    }
    let broken = folder.write("broken.urdf", [TURNTABLE.as_bytes(), b"\n\xff"].concat());
    let error = refusal(&["fk", "--robot", &broken, "--configs", &configs], 1);
    assert!(error.contains("line 5: expected UTF-8 text, found byte 0xff"), "{error}");
}

#[test]
fn a_xacro_file_is_refused_with_the_command_that_expands_it() {
    let folder = Folder::new();
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let xacro = folder.write("arm.urdf.xacro", TURNTABLE);
    let error = refusal(&["fk", "--robot", &xacro, "--configs", &configs], 1);
    assert!(error.contains("`xacro ") && error.contains("arm.urdf.xacro > FILE.urdf`"), "{error}");
    let inside = folder.write("arm.urdf", TURNTABLE.replace("0.3 0 0", "${reach} 0 0"));
    let error = refusal(&["fk", "--robot", &inside, "--configs", &configs], 1);
    assert!(error.contains("link 'arm'") && error.contains("`xacro FILE > FILE.urdf`"), "{error}");
}

#[test]
fn meshes_are_found_in_packages_and_missed_only_where_collisions_count() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path().join("elsewhere/meshes")).unwrap();
    folder.write("elsewhere/meshes/a.obj", TETRAHEDRON);
    let arm = folder.write("arm.urdf", with_mesh("package://parts/meshes/a.obj"));
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    json(&["fk", "--robot", &arm, "--configs", &configs]);

    let (zero, one, none) = (value!([0.0]), value!([0.9]), value!([]));
    let elsewhere = folder.at("elsewhere");
    let package = format!("parts={elsewhere}");
    assert_eq!(plan(&folder, &[&arm, "--package", &package], &zero, &one, &none)["solved"], true);
    let problems = folder.at("problems.json");
    let arguments = ["plan", "--robot", &arm, "--problems", &problems];
    let error = refusal(&arguments, 1);
    assert!(
        error.contains(
            "link 'arm', <mesh> on line 2: there is no mesh 'package://parts/meshes/a.obj'"
        ),
        "{error}"
    );
    assert!(error.contains("--ignore-missing-meshes"), "{error}");
    let lenient = command(&[&arguments[..], &["--ignore-missing-meshes", "--json"]].concat())
        .output()
        .unwrap();
    assert!(lenient.status.success());
    assert!(text(&lenient.stderr).starts_with("warning: link 'arm'"), "{}", text(&lenient.stderr));

    // A workspace of packages, as ROS lists them.
    std::fs::rename(folder.path().join("elsewhere"), folder.path().join("parts")).unwrap();
    let workspace = Folder::new();
    let moved = workspace.write("arm.urdf", with_mesh("package://parts/meshes/a.obj"));
    let arguments = ["plan", "--robot", &moved, "--problems", &problems];
    refusal(&arguments, 1);
    for listed in [folder.at(""), folder.at("parts")] {
        let mut command = command(&arguments);
        let output =
            command.env("ROS_PACKAGE_PATH", format!("/nowhere:{listed}")).output().unwrap();
        assert!(output.status.success(), "{listed}: {}", text(&output.stderr));
    }
    let mut wrong = command(&arguments);
    wrong.args(["--package", "parts"]);
    assert!(refusal_of(wrong, 2).contains("expected NAME=DIR"));
}

#[test]
fn a_group_of_the_semantics_is_chosen_by_name() {
    let folder = Folder::new();
    let arm = folder.write("turntable.urdf", TURNTABLE);
    let srdf = folder.write(
        "turntable.srdf",
        r#"<robot name="turntable"><group name="table"><joint name="turn"/></group>
        <disable_collisions link1="base" link2="lamp"/></robot>"#,
    );
    let configs = folder.write("configs.json", r#"{"configs": [[0.5]]}"#);
    let fk = |rest: &[&'static str]| {
        let given = ["fk", "--robot", &arm, "--configs", &configs];
        given.iter().chain(rest).map(|it| (*it).to_owned()).collect::<Vec<String>>()
    };
    let with_srdf =
        |rest: &[&'static str]| [fk(rest), vec!["--srdf".to_owned(), srdf.clone()]].concat();
    let output = command(&with_srdf(&["--group", "table"])).output().unwrap();
    assert!(output.status.success());
    assert!(
        text(&output.stderr).contains("warning: SRDF: 1 links that the URDF does not have: 'lamp'")
    );
    let error = refusal(&with_srdf(&["--group", "leg"]), 1);
    assert!(error.contains("group: expected one of 'table', found 'leg'"), "{error}");
    refusal(&fk(&["--group", "table"]), 2);
}
