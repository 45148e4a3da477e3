//! The same world after every task's demonstration, and the same candidates: natively with one and
//! two threads, and in wasm; and the same gradients.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::text;
use lpr_core::robot::ROBOTS;
use lpr_core::sim::tasks::TASKS;
use lpr_tests::workspace;
use lpr_wasm::check::{CandidatesBench, NetworksBench, demonstration_hash};
use std::process::Command;

/// A validation scene: the test scenes are for reported results.
const SEED: u64 = 1000;

/// The page's module.
const PAGE: &str = "www/src/wasm/lpr_wasm_bg.wasm";

/// Task and robot of every demonstration.
fn scenes() -> Vec<(&'static str, &'static str)> {
    TASKS
        .iter()
        .flat_map(|task| ROBOTS.map(|robot| (task.name.as_str(), robot.name.as_str())))
        .collect()
}

fn native_hashes(n_threads: usize) -> Vec<String> {
    let hash = |(task, robot)| demonstration_hash(task, robot, SEED).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    pool.install(|| scenes().into_iter().map(hash).collect())
}

/// Output of `tests/node/NAME` for an argument; it needs `module`, a file of the workspace.
#[track_caller]
pub(crate) fn node(name: &str, argument: &str, module: &str) -> String {
    assert!(
        workspace().join(module).is_file(),
        "{module} is missing: run `make page planner` first"
    );
    let script = workspace().join("tests/node").join(name);
    let output =
        Command::new("node").arg(script).arg(argument).output().expect("node is installed");
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

fn wasm_hashes() -> Vec<String> {
    let scenes: Vec<_> = scenes().into_iter().map(|(task, robot)| (task, robot, SEED)).collect();
    let argument = serde_json::to_string(&scenes).unwrap();
    serde_json::from_str(&node("world_hash.mjs", &argument, PAGE)).unwrap()
}

#[test]
fn every_demonstration_ends_in_the_same_world_with_one_thread_two_threads_and_in_wasm() {
    let [one, two] = [1, 2].map(native_hashes);
    let wasm = wasm_hashes();
    assert_eq!(wasm.len(), scenes().len());
    for (idx, scene) in scenes().iter().enumerate() {
        assert_eq!(one[idx], two[idx], "{scene:?} with two threads");
        assert_eq!(one[idx], wasm[idx], "{scene:?} in wasm");
    }
}

#[test]
fn the_planners_paths_and_the_curves_are_the_same_with_one_thread_two_threads_and_in_wasm() {
    const STEPS: u64 = 5;
    let bench = CandidatesBench::new().unwrap();
    let [one, two] = [1, 2].map(|n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| (0..STEPS).map(|step| bench.run(step).unwrap()).collect::<Vec<String>>())
    });
    let wasm: Vec<String> =
        serde_json::from_str(&node("candidates.mjs", &STEPS.to_string(), PAGE)).unwrap();
    assert_eq!(one, two);
    assert_eq!(one, wasm);
}

#[test]
fn gradients_in_wasm_are_the_native_ones_within_a_ten_thousandth() {
    let native = NetworksBench::new().unwrap().gradients().unwrap();
    let wasm: Vec<f32> = serde_json::from_str(&node("gradients.mjs", "", PAGE)).unwrap();
    assert_eq!(wasm.len(), native.len());
    let norm = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
    let difference: Vec<_> = native.iter().zip(&wasm).map(|(native, wasm)| native - wasm).collect();
    let off = norm(&difference) / norm(&native);
    assert!(off < 1e-4 && norm(&native) > 1e-4, "{off} of {}", norm(&native));
    // Each number within a ten thousandth of the largest of all.
    let largest = native.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
    let farthest = difference.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
    assert!(farthest < 1e-4 * largest, "{farthest} of {largest}");
}
