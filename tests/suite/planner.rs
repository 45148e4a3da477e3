//! Planning alone in wasm: as small as a page can afford, and the same bits as natively.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::world_hash::node;
use lpr_wasm::planner::{Outcome, Planner};
use lpr_wasm::trajectory::TrajectoryRequest;
use serde_json::{Value, json};

/// The module that `make planner` makes.
const MODULE: &str = "lpr-wasm/pkg/lpr_wasm_bg.wasm";

/// Most bytes of the module with gzip.
const MAX_BYTES: u64 = 400_000;

/// Robot, obstacles and request, as JSON: a post in the way, a wall of points, and a goal out of
/// reach.
fn questions() -> Vec<(&'static str, Value, Value)> {
    let start = [0.0, -0.3, 0.0, 0.9, 0.0, 1.2, 0.0];
    let panda_start = [0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8];
    let request = |start: [f32; 7], position: [f32; 3]| json!({"start": start, "goal": {"position": position, "rotation_xyzw": [1.0, 0.0, 0.0, 0.0]}, "seed": 7});
    let place = json!({"position": [0.35, 0.2, 0.3], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]});
    let post = json!({"solids": [{"shape": {"cylinder": {"radius": 0.05, "half_length": 0.3}}, "place": place}]});
    let points: Vec<_> = (0..500_u16)
        .map(|i| [0.3 + 0.02 * f32::from(i % 25), 0.15, 0.02 * f32::from(i / 25)])
        .collect();
    vec![
        ("xarm7", post.clone(), request(start, [0.35, 0.4, 0.15])),
        ("xarm7", json!({ "points": points }), request(start, [0.4, 0.35, 0.15])),
        ("panda", post, request(panda_start, [0.4, 0.35, 0.15])),
        ("xarm7", json!({}), request(start, [2.0, 0.0, 0.15])),
    ]
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

/// The answers of the module's methods, computed natively.
fn native_answers(robot: &str, obstacles: &Value, request: &Value) -> [Option<String>; 4] {
    let planner = Planner::new(robot, &serde_json::from_value(obstacles.clone()).unwrap()).unwrap();
    let request = serde_json::from_value(request.clone()).unwrap();
    let plan = planner.plan(&request).unwrap();
    [
        serde_json::to_string(&planner.configurations(&request, 20).unwrap()).ok(),
        serde_json::to_string(&plan).ok(),
        serde_json::to_string(&planner.candidates(&request).unwrap()).ok(),
        native_motion(&planner, &plan),
    ]
}

#[test]
fn planning_alone_in_wasm_is_small_and_gives_the_same_bits() {
    let questions = questions();
    let printed = node("planner.mjs", &json!([questions, motion_settings()]).to_string(), MODULE);
    let printed: Value = serde_json::from_str(&printed).unwrap();
    let bytes = printed["gzip_bytes"].as_u64().unwrap();
    assert!((1..=MAX_BYTES).contains(&bytes), "{bytes} bytes");
    let wasm: Vec<[Option<String>; 4]> =
        serde_json::from_value(printed["answers"].clone()).unwrap();
    assert_eq!(wasm.len(), questions.len());
    for ((robot, obstacles, request), wasm) in questions.iter().zip(&wasm) {
        assert_eq!(*wasm, native_answers(robot, obstacles, request), "{robot} {request}");
    }
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
    let printed = node("readme.mjs", &readme.to_string_lossy(), MODULE);
    assert!(
        printed.starts_with("20 configurations, ") && printed.contains(" rad in "),
        "{printed}"
    );
}
