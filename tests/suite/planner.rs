//! Planning alone in wasm: as small as a page can afford, and the same bits as natively.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::world_hash::node;
use lpr_wasm::arm_file::ArmFile;
use lpr_wasm::planner::{Outcome, Planner};
use lpr_wasm::trajectory::TrajectoryRequest;
use serde_json::{Value, json};

/// Where `make planner` puts the module.
const PLAIN: &str = "lpr-wasm/pkg";
/// The same with arms from files.
const WITH_FILES: &str = "lpr-wasm/pkg-files";

/// Most bytes of them with gzip.
const MAX_BYTES: u64 = 400_000;
const MAX_BYTES_WITH_FILES: u64 = 600_000;

/// Robot, obstacles and request, as JSON: a post in the way, a wall of points, and a goal out of
/// reach.
fn questions() -> Vec<(Value, Value, Value)> {
    let start = [0.0, -0.3, 0.0, 0.9, 0.0, 1.2, 0.0];
    let panda_start = [0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8];
    let request = |start: [f32; 7], position: [f32; 3]| json!({"start": start, "goal": {"position": position, "rotation_xyzw": [1.0, 0.0, 0.0, 0.0]}, "seed": 7});
    let place = json!({"position": [0.35, 0.2, 0.3], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]});
    let post = json!({"solids": [{"shape": {"cylinder": {"radius": 0.05, "half_length": 0.3}}, "place": place}]});
    let points: Vec<_> = (0..500_u16)
        .map(|i| [0.3 + 0.02 * f32::from(i % 25), 0.15, 0.02 * f32::from(i / 25)])
        .collect();
    vec![
        (json!("xarm7"), post.clone(), request(start, [0.35, 0.4, 0.15])),
        (json!("xarm7"), json!({ "points": points }), request(start, [0.4, 0.35, 0.15])),
        (json!("panda"), post, request(panda_start, [0.4, 0.35, 0.15])),
        (json!("xarm7"), json!({}), request(start, [2.0, 0.0, 0.15])),
    ]
}

/// An arm of four joints, a box, a cylinder and two meshes: the links after the elbow pass each other
/// by 5 mm.
fn from_file() -> Value {
    let link = |name: &str, geometry: &str| {
        format!(
            r#"<link name="{name}"><collision><origin xyz="0.15 0 0"/><geometry>{geometry}</geometry></collision></link>"#
        )
    };
    let joint = |name: &str, [parent, child]: [&str; 2], at: &str, axis: &str| {
        format!(
            r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
            <axis xyz="{axis}"/><limit lower="-2.8" upper="2.8" velocity="1.5" effort="1"/></joint>"#
        )
    };
    let mesh = r#"<mesh filename="package://arm/plate.obj"/>"#;
    let urdf = [
        r#"<robot name="four"><link name="base"/>"#.to_owned(),
        link("shoulder", r#"<box size="0.36 0.06 0.04"/>"#),
        link("upper", mesh),
        link("lower", mesh),
        link("hand", r#"<cylinder radius="0.02" length="0.06"/>"#),
        joint("a", ["base", "shoulder"], "0 0 0.3", "0 0 1"),
        joint("b", ["shoulder", "upper"], "0.3 0 0.035", "0 0 1"),
        joint("c", ["upper", "lower"], "0.3 0 0.035", "0 0 1"),
        joint("d", ["lower", "hand"], "0.3 0 0.05", "0 0 1"),
        "</robot>".to_owned(),
    ];
    let plate = "v -.17 -.03 -.015\nv .17 -.03 -.015\nv -.17 .03 -.015\nv .17 .03 -.015\nv -.17 -.03 .015\nv .17 -.03 .015\n\
        v -.17 .03 .015\nv .17 .03 .015\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    json!({"urdf": urdf.concat(), "options": {"tip": "hand"}, "meshes": {"package://arm/plate.obj": plate}})
}

fn post_of_file() -> Value {
    let place = json!({"position": [0.6, 0.35, 0.3], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]});
    json!({"solids": [{"shape": {"cylinder": {"radius": 0.05, "half_length": 0.3}}, "place": place}]})
}

fn request_of_file() -> Value {
    let (sin, cos) = 0.6_f32.sin_cos();
    json!({"start": [0.0, 0.0, 0.0, 0.0], "goal": {"position": [0.3, 0.65, 0.42], "rotation_xyzw": [0.0, 0.0, sin, cos]}, "seed": 7})
}

/// Speeds at which a plan is driven.
fn motion_settings() -> Value {
    json!({"speed": 0.5, "max_jerk": 300.0, "max_grip_speed": 0.5, "period": 0.02})
}

/// The motion along a plan, natively, if there is one.
fn native_motion(planner: &Planner, plan: &Outcome) -> Option<String> {
    let Outcome::Found(found) = plan else { return None };
    let mut request = motion_settings();
    request["path"] = json!(found.path);
    let request: TrajectoryRequest = serde_json::from_value(request).unwrap();
    let motion = planner.trajectory(&request).unwrap();
    assert!(motion.times.len() > 10);
    Some(serde_json::to_string(&motion).unwrap())
}

/// The planner of an arm by its name, or from its file.
fn native_planner(robot: &Value, obstacles: &Value) -> Planner {
    let obstacles = serde_json::from_value(obstacles.clone()).unwrap();
    let Some(urdf) = robot["urdf"].as_str() else {
        return Planner::new(robot.as_str().unwrap(), &obstacles).unwrap();
    };
    let options = serde_json::from_value(robot["options"].clone()).unwrap();
    let mut file = ArmFile::new(urdf.as_bytes(), options).unwrap();
    for name in file.mesh_names().unwrap() {
        file.add_mesh(&name, robot["meshes"][&name].as_str().unwrap().into());
    }
    file.planner(&obstacles).unwrap()
}

/// The answers of the module's methods, computed natively.
fn native_answers(robot: &Value, obstacles: &Value, request: &Value) -> [Option<String>; 4] {
    let planner = native_planner(robot, obstacles);
    let request = serde_json::from_value(request.clone()).unwrap();
    let plan = planner.plan(&request).unwrap();
    [
        serde_json::to_string(&planner.configurations(&request, 20).unwrap()).ok(),
        serde_json::to_string(&plan).ok(),
        serde_json::to_string(&planner.candidates(&request).unwrap()).ok(),
        native_motion(&planner, &plan),
    ]
}

/// What a module answers: as natively, and of no more bytes with gzip.
fn wasm_answers(
    folder: &str,
    questions: &[(Value, Value, Value)],
    max_bytes: u64,
) -> Vec<[Option<String>; 4]> {
    let argument = json!([folder, questions, motion_settings()]).to_string();
    let printed = node("planner.mjs", &argument, &format!("{folder}/lpr_wasm_bg.wasm"));
    let printed: Value = serde_json::from_str(&printed).unwrap();
    let bytes = printed["gzip_bytes"].as_u64().unwrap();
    assert!((1..=max_bytes).contains(&bytes), "{bytes} bytes");
    let wasm: Vec<[Option<String>; 4]> =
        serde_json::from_value(printed["answers"].clone()).unwrap();
    assert_eq!(wasm.len(), questions.len());
    for ((robot, obstacles, request), wasm) in questions.iter().zip(&wasm) {
        assert_eq!(*wasm, native_answers(robot, obstacles, request), "{robot} {request}");
    }
    wasm
}

#[test]
fn an_arm_from_a_file_plans_in_wasm_with_the_same_bits() {
    let questions = [(from_file(), post_of_file(), request_of_file())];
    let wasm = wasm_answers(WITH_FILES, &questions, MAX_BYTES_WITH_FILES);
    let [configurations, plan, _, motion] = &wasm[0];
    assert!(configurations.as_ref().is_some_and(|found| found.len() > 2), "{configurations:?}");
    assert!(plan.as_ref().is_some_and(|plan| plan.contains("\"found\"")), "{plan:?}");
    assert!(motion.is_some());
}

#[test]
fn planning_alone_in_wasm_is_small_and_gives_the_same_bits() {
    let wasm = wasm_answers(PLAIN, &questions(), MAX_BYTES);
    let configurations: Vec<Value> = serde_json::from_str(wasm[0][0].as_ref().unwrap()).unwrap();
    assert_eq!(configurations.len(), 20);
    for (found, [_, plan, _, motion]) in [true, true, true, false].iter().zip(&wasm) {
        assert_eq!(
            plan.as_ref().is_some_and(|plan| plan.contains("\"found\"")),
            *found,
            "{plan:?}"
        );
        assert_eq!(motion.is_some(), *found);
    }
    let bends = |motion: &str| {
        serde_json::from_str::<Value>(motion).unwrap()["deviation"].as_f64() > Some(0.0)
    };
    assert!(
        wasm.iter().any(|[.., motion]| motion.as_deref().is_some_and(bends)),
        "some plan is not straight"
    );
    assert_eq!(
        wasm[3][..2],
        ["[]", r#"{"rejected":"unreachable"}"#].map(|answer| Some(answer.to_owned()))
    );
}

#[test]
fn the_program_of_the_readme_plans_a_motion() {
    let readme = lpr_tests::workspace().join("lpr-wasm/README.md");
    let printed =
        node("readme.mjs", &readme.to_string_lossy(), &format!("{PLAIN}/lpr_wasm_bg.wasm"));
    assert!(
        printed.starts_with("20 configurations, ") && printed.contains(" rad in "),
        "{printed}"
    );
}
