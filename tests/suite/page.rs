//! The demo page in headless Chromium, from `lpr serve`, against the same agent and scene computed
//! natively.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, text};
use crate::runs::ORACLE;
use crate::server::Server;
use lpr_tests::workspace;
use lpr_wasm::demo::Demo;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

/// A validation scene: the test scenes are for reported results.
const SEED: u64 = 1000;
const TASK: &str = "take_lid_off_saucepan";
/// Greatest difference of a network's value from its native one.
const VALUE_TOLERANCE: f64 = 1e-4;

/// The native episode of the agent that the page brings along, with the page's choices.
fn native_episode(chosen: &[u64]) -> (Vec<Value>, Vec<Value>) {
    let weights =
        fs::read(workspace().join(format!("www/public/weights/{TASK}.safetensors"))).unwrap();
    let mut demo = Demo::new(&weights, SEED).unwrap();
    let (mut plans, mut outcomes) = (Vec::new(), Vec::new());
    for &candidate in chosen {
        plans.push(serde_json::to_value(demo.plan().unwrap()).unwrap());
        let outcome = demo.execute(usize::try_from(candidate).unwrap()).unwrap().outcome;
        outcomes.push(serde_json::to_value(outcome).unwrap());
    }
    (plans, outcomes)
}

/// Candidates of planner and Bézier curves are equal to the bit; what a network had a hand in is
/// close.
#[track_caller]
fn assert_same_candidates(page: &Value, native: &Value) {
    let [page, native] = [page, native].map(|plan| plan["candidates"].as_array().unwrap());
    assert_eq!(page.len(), native.len());
    for (idx, (page, native)) in page.iter().zip(native).enumerate() {
        assert_eq!(
            (&page["source"], &page["collides"]),
            (&native["source"], &native["collides"]),
            "candidate {idx}"
        );
        let values = [page, native].map(|candidate| candidate["value"].as_f64().unwrap());
        assert!(
            (values[0] - values[1]).abs() <= VALUE_TOLERANCE,
            "candidate {idx}: values {values:?}"
        );
        let [path, expected] = [page, native].map(|candidate| angles(&candidate["path"]));
        if native["source"] == "policy" {
            let worst = path
                .iter()
                .zip(&expected)
                .map(|(a, b)| f64::from((a - b).abs()))
                .fold(0.0, f64::max);
            assert!(
                path.len() == expected.len() && worst <= VALUE_TOLERANCE,
                "candidate {idx}: {worst} rad off"
            );
        } else {
            assert!(path == expected, "candidate {idx}: {path:?}, natively {expected:?}");
        }
    }
}

/// Every angle of a path, which JavaScript may have printed with other digits.
fn angles(path: &Value) -> Vec<f32> {
    let configs = path.as_array().unwrap().iter().flat_map(|config| config.as_array().unwrap());
    configs.map(|angle| angle.as_f64().unwrap() as f32).collect()
}

/// The page as a visitor sees it in scene [`SEED`]; the tour leaves its screenshots in
/// `screenshots`.
fn tour(server: &Server, screenshots: &Path) -> Value {
    fs::create_dir_all(screenshots).unwrap();
    let url = format!("http://{}/#task={TASK}&seed={SEED}", server.host());
    let script = workspace().join("www/tests/tour.mjs");
    let output = Command::new("node")
        .arg(script)
        .arg(url)
        .arg(screenshots)
        .output()
        .expect("node is installed");
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_visitor_sees_what_is_computed_natively_and_the_winner_does_the_task() {
    let page = workspace().join("www/dist");
    assert!(
        page.join("index.html").is_file(),
        "{} is missing: run `make page` first",
        page.display()
    );
    let folder = Folder::new();
    let server = Server::start(&folder, &["--page", page.to_str().unwrap()]);
    let job = server.submit(ORACLE);
    let end = server.events(&job, 0).last().unwrap();
    assert_eq!((end.kind.as_str(), &end.data["state"]), ("end", &Value::from("succeeded")));
    let seen = tour(&server, &Path::new(env!("CARGO_TARGET_TMPDIR")).join("page"));

    assert_eq!(seen["complaints"], Value::Array(Vec::new()), "the browser's console is quiet");
    assert_eq!(seen["failure"], "", "nothing went wrong");
    assert_ne!(seen["failure_without_weights"], "", "a page that lacks its weights says so");
    assert_eq!(seen["rows"].as_array().unwrap().len(), 41);
    let plans = seen["plans"].as_array().unwrap();
    let chosen: Vec<u64> = plans.iter().map(|plan| plan["chosen"].as_u64().unwrap()).collect();
    let (native_plans, native_outcomes) = native_episode(&chosen);
    for (page, native) in plans.iter().zip(&native_plans) {
        assert_same_candidates(page, native);
        assert_eq!((&page["chosen"], &page["rejected"]), (&native["chosen"], &native["rejected"]));
    }
    let outcomes = seen["outcomes"].as_array().unwrap();
    assert_same_worlds(plans, outcomes, &native_outcomes);
    let last = outcomes.last().unwrap();
    assert_eq!((last["reward"].as_f64(), last["ended"].as_bool()), (Some(1.0), Some(true)));
    assert!(
        seen["outcome_text"].as_str().unwrap().starts_with("Success"),
        "{}",
        seen["outcome_text"]
    );
    assert_eq!(seen["same_plan_again"], true, "a reset scene begins with the same plan");

    let row = &seen["job_rows"][0];
    assert_eq!([&row[0], &row[2]], [ORACLE.task, "succeeded"]);
    assert_eq!(
        floats(&seen["job_points"]),
        floats(&server.points(&job)),
        "the curve has every log point of the job"
    );
}

/// A value whose numbers are all floats: JavaScript prints 1.0 as 1.
fn floats(value: &Value) -> Value {
    match value {
        Value::Number(number) => number.as_f64().into(),
        Value::Array(values) => values.iter().map(floats).collect(),
        Value::Object(object) => {
            object.iter().map(|(key, value)| (key.clone(), floats(value))).collect()
        }
        other => other.clone(),
    }
}

/// The simulated worlds are equal to the bit for as long as no network had a hand in what ran.
#[track_caller]
fn assert_same_worlds(plans: &[Value], page: &[Value], native: &[Value]) {
    for ((plan, page), native) in plans.iter().zip(page).zip(native) {
        let chosen = usize::try_from(plan["chosen"].as_u64().unwrap()).unwrap();
        if plan["candidates"][chosen]["source"] == "policy" {
            return;
        }
        assert_eq!(page["world_hash"], native["world_hash"], "step {}", page["step"]);
    }
}
