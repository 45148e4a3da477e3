//! `lpr eval`: what it counts, and what it shows the agent.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, files_below, json, refusal};
use crate::runs::{LEARNED, ORACLE, Runs};
use lpr_core::evaluate::wilson_interval;
use serde_json::{Map, Value};

/// Standard errors on each side of a 95 % interval.
const Z: f64 = 1.959_963_984_540_054;

/// Checks all fields of a report against each other.
#[track_caller]
fn assert_consistent(report: &Value) {
    let count = |key: &str| report[key].as_u64().unwrap_or_else(|| panic!("{key}: {report}"));
    let sum = |key: &str| {
        report[key].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum::<u64>()
    };
    let (episodes, successes, steps) = (count("episodes"), count("successes"), count("steps"));
    assert_eq!(sum("failures") + successes, episodes, "{report}");
    assert!(sum("chosen") <= steps && steps >= episodes && steps <= 10 * episodes, "{report}");
    assert!(count("policy_valid") <= steps);
    let share = successes as f64 / episodes as f64;
    assert!((report["success_rate"].as_f64().unwrap() - share).abs() < 1e-12);
    // Wilson's bounds are where the observed share is Z standard errors of the true one away.
    let bounds: Vec<f64> = report["wilson95"]
        .as_array()
        .unwrap()
        .iter()
        .map(|bound| bound.as_f64().unwrap())
        .collect();
    assert_eq!(bounds.len(), 2);
    for bound in &bounds {
        let score = (share - bound).powi(2) * episodes as f64 - Z * Z * bound * (1.0 - bound);
        assert!(score.abs() < 1e-5, "{bound}: {score}");
    }
    assert!(bounds[0] <= share && share <= bounds[1] && bounds[0] < bounds[1]);
}

/// Counts of several reports together.
fn total(reports: &[Value], key: &str) -> Value {
    if reports[0][key].is_u64() {
        return reports.iter().map(|report| report[key].as_u64().unwrap()).sum::<u64>().into();
    }
    let mut counts = Map::new();
    for (name, n) in reports.iter().flat_map(|report| report[key].as_object().unwrap()) {
        let old = counts.get(name).and_then(Value::as_u64).unwrap_or_default();
        counts.insert(name.clone(), (old + n.as_u64().unwrap()).into());
    }
    counts.into()
}

#[test]
fn the_interval_is_that_of_scipy() {
    // scipy 1.17.1: binomtest(successes, trials).proportion_ci(0.95, "wilson").
    let cases = [
        ((0, 10), [0.0, 0.277_532_799_862_889_3]),
        ((1, 10), [0.017_876_213_095_072_9, 0.404_150_026_795_238_5]),
        ((1, 3), [0.061_491_944_720_396_26, 0.792_340_399_197_952_3]),
        ((5, 10), [0.236_593_090_512_564, 0.763_406_909_487_436_1]),
        ((10, 10), [0.722_467_200_137_110_9, 1.0]),
        ((8, 100), [0.041_093_461_484_380_61, 0.149_981_077_009_487_35]),
        ((50, 100), [0.403_831_530_365_995_6, 0.596_168_469_634_004_4]),
        ((97, 100), [0.915_480_635_709_472_4, 0.989_745_475_975_961_1]),
        ((100, 100), [0.963_006_501_793_014_3, 1.0]),
    ];
    for ((successes, trials), expected) in cases {
        let found = wilson_interval(successes, trials, Z);
        assert!(
            (0..2).all(|side| (found[side] - expected[side]).abs() < 1e-12),
            "{successes} of {trials}: {found:?}"
        );
    }
}

#[test]
fn every_method_without_weights_reports_all_fields() {
    let methods = ["c2farm", "linear", "shortest-free", "random", "best-of-all"];
    for method in methods {
        let report = json(&[
            "eval",
            "toilet_seat_up",
            "--oracle-poses",
            "--method",
            method,
            "--episodes",
            "2",
            "--robot",
            "panda",
        ]);
        assert_consistent(&report);
        assert_eq!(
            (&report["task"], &report["method"]),
            (&"toilet_seat_up".into(), &method.into())
        );
        assert_eq!((&report["observations"], &report["policy_valid"]), (&"own".into(), &0.into()));
    }
}

#[test]
fn episodes_do_not_depend_on_each_other() {
    let runs = Runs::new();
    for kind in [ORACLE, LEARNED] {
        let run = runs.train(kind, kind.task);
        let run = run.to_str().unwrap();
        let eval = |seed: u64, n: u64| {
            let report =
                json(&["eval", run, "--seed", &seed.to_string(), "--episodes", &n.to_string()]);
            assert_consistent(&report);
            report
        };
        let together = eval(5000, 6);
        let apart: Vec<_> = (5000..5006).map(|seed| eval(seed, 1)).collect();
        for key in ["episodes", "successes", "chosen", "failures", "policy_valid", "steps"] {
            assert_eq!(together[key], total(&apart, key), "{key}");
        }
        // The run's own final evaluation is that of its last checkpoint in the test scenes.
        let summary: Value =
            serde_json::from_slice(&std::fs::read(format!("{run}/summary.json")).unwrap()).unwrap();
        assert_eq!(summary["eval"], json(&["eval", run]));
        assert_eq!(summary["eval"]["episodes"], 100);
    }
}

#[test]
fn other_observations_change_what_is_seen_and_nothing_else() {
    // After fewer updates an agent goes to the same poses whatever it sees.
    let runs = Runs::with(&[("training.demonstration_updates", "40")]);
    let run = runs.train(LEARNED, "run");
    let run = run.to_str().unwrap();
    let before = files_below(runs.folder.path());
    let eval = |observations: &str| {
        json(&["eval", run, "--episodes", "12", "--observations", observations])
    };
    let own = eval("own");
    assert_eq!(own, json(&["eval", run, "--episodes", "12"]));
    for observations in ["blank", "foreign"] {
        let report = eval(observations);
        assert_consistent(&report);
        assert_eq!(
            (&report["observations"], &report["episodes"]),
            (&observations.into(), &12.into())
        );
        assert_eq!(report, eval(observations));
        let keys = |report: &Value| report.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(keys(&report), keys(&own));
        // Other poses lead to other candidates: an agent that does not look would do the same.
        assert!(
            ["chosen", "failures", "steps"].iter().any(|key| report[*key] != own[*key]),
            "{report}"
        );
    }
    assert!(files_below(runs.folder.path()) == before, "evaluating changes no file");
}

#[test]
fn observations_are_only_those_of_poses_that_are_learned() {
    let error = refusal(
        &[
            "eval",
            "reach_target",
            "--oracle-poses",
            "--method",
            "linear",
            "--observations",
            "blank",
        ],
        2,
    );
    assert!(error.starts_with("--observations: "), "{error}");
    let error = refusal(&["eval", "run", "--observations", "dark"], 2);
    assert!(error.contains("'dark'") && error.contains("own, blank, foreign"), "{error}");
}

#[test]
fn what_cannot_be_evaluated_is_named() {
    let folder = Folder::new();
    let oracle =
        |rest: &[&str], status: i32| refusal(&[&["eval", "--oracle-poses"], rest].concat(), status);
    assert!(refusal(&["eval", "run", "--episodes", "0"], 2).contains("0 is not in 1..=100000"));
    assert!(refusal(&["eval", "run", "--episodes", "-1"], 2).contains("'-1'"));
    let largest = u64::MAX.to_string();
    let error = refusal(&["eval", "run", "--seed", &largest, "--episodes", "2"], 2);
    assert!(error.starts_with(&format!("--seed {largest}: ")), "{error}");
    assert!(oracle(&["make_coffee"], 2).contains("task: expected one of reach_target"));
    assert!(
        oracle(&["reach_target", "--method", "guess"], 2).contains("method: expected one of lpr")
    );
    assert!(oracle(&["reach_target", "--method", "lpr"], 2).contains("--checkpoint"));
    assert!(refusal(&["eval", "run", "--method", "lpr"], 2).contains("--oracle-poses"));
    assert!(refusal(&["eval", &folder.at("none")], 1).contains("holds no checkpoint"));
}

#[test]
fn a_run_is_not_evaluated_as_something_else() {
    let runs = Runs::new();
    let run = runs.train(LEARNED, "run");
    let run = run.to_str().unwrap();
    let error = |arguments: &[&str]| {
        let error = refusal(arguments, 1);
        error
            .strip_prefix(&format!("{run}: is a run of "))
            .unwrap_or_else(|| panic!("{error}"))
            .to_owned()
    };
    assert_eq!(
        error(&["eval", run, "--robot", "panda"]),
        "robot `xarm7`, asked to evaluate `panda`"
    );
    let checkpoint = ["--oracle-poses", "--checkpoint", run];
    let with = |rest: &[&str]| error(&[&["eval"], rest, &checkpoint].concat());
    assert_eq!(with(&["open_drawer"]), "task `reach_target`, asked to evaluate `open_drawer`");
    assert_eq!(
        with(&["reach_target", "--method", "linear"]),
        "method `lpr`, asked to evaluate `linear`"
    );
    // With the demonstrator's poses, the paths that it has learned remain: its poses are poor, its
    // paths are straight enough.
    let report =
        json(&["eval", "reach_target", "--oracle-poses", "--checkpoint", run, "--episodes", "5"]);
    assert_consistent(&report);
    assert!(
        report["successes"].as_u64() >= Some(4) && report["policy_valid"].as_u64() > Some(0),
        "{report}"
    );
    assert_eq!(report["method"], "lpr");
}
