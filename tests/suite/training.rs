//! `lpr train` and what works on its run directory, as a script sees them: a run of seconds.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{command, json, refusal, text};
use serde_json::{Value, json as value};
use std::path::{Path, PathBuf};

fn utf8(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The preset `fast` made small enough for a test.
fn small_preset(directory: &Path) -> PathBuf {
    let mut config = lpr_core::config::Config::preset("fast").unwrap();
    config.candidates.planner_paths = 4;
    config.candidates.bezier_paths = 4;
    config.training.demonstration_updates = 25;
    config.training.validation_interval = 4;
    config.training.validation_episodes = 2;
    let path = directory.join("small.toml");
    std::fs::write(&path, config.to_toml()).unwrap();
    path
}

#[test]
fn a_run_learns_from_files_and_leaves_what_its_readers_need() {
    let root = tempfile::tempdir().unwrap();
    let (demos, run, preset) =
        (root.path().join("demos"), root.path().join("run"), small_preset(root.path()));
    json(&["demo", "reach_target", "--episodes", "2", "--seed", "70", "--out", utf8(&demos)]);
    let arguments = [
        "train",
        "reach_target",
        "--oracle-poses",
        "--preset",
        utf8(&preset),
        "--demo-dir",
        utf8(&demos),
    ];
    let options = ["--cameras", "front,overhead", "--env-steps", "4", "--out", utf8(&run)];
    let output = command(&[&arguments[..], &options, &["--json"]].concat()).output().unwrap();
    let (report, stderr): (Value, _) =
        (serde_json::from_slice(&output.stdout).unwrap(), text(&output.stderr));
    assert_eq!((&report["env_steps"], &report["stopped_by"]), (&value!(4), &value!("env_steps")));
    assert!(
        stderr.contains("networks: ranker 0.") && stderr.contains("updates per second"),
        "{stderr}"
    );

    // The configuration says what it was a run of, and is a preset all the same.
    let config: toml::Table =
        std::fs::read_to_string(run.join("config.toml")).unwrap().parse().unwrap();
    assert_eq!(config["run"]["demonstrations"], toml::Value::from(vec![70, 71]));
    assert_eq!(config["run"]["cameras"], toml::Value::from(vec!["front", "overhead"]));
    assert_eq!(config["training"]["demonstrations"], toml::Value::from(2));

    let metrics = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let points: Vec<Value> =
        metrics.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let validations: Vec<_> =
        points.iter().filter(|point| !point["validation/success_rate"].is_null()).collect();
    assert_eq!(
        validations.iter().map(|point| point["env_steps"].as_u64().unwrap()).collect::<Vec<_>>(),
        [0, 4]
    );
    assert!(validations.iter().all(|point| point["validation/value_chosen"].is_f64()));

    let episode = run.join("episodes/00000004.episode.json.gz");
    assert!(
        run.join("episodes/00000000.gif").exists() && run.join("episodes/00000004.gif").exists()
    );
    let replayed = json(&["replay", utf8(&episode)]);
    assert_eq!((&replayed["identical"], &replayed["scene_seed"]), (&value!(true), &value!(1000)));

    let paths = json(&["paths", "reach_target", "--checkpoint", utf8(&run)]);
    let rows = paths["candidates"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["value"].is_f64() != row["rejected"].is_string()), "{paths}");
    assert_eq!(paths["summary"]["policy"]["drawn"], 1);
    let error =
        refusal(&["paths", "reach_target", "--robot", "panda", "--checkpoint", utf8(&run)], 2);
    assert!(error.contains("of the robot xarm7"), "{error}");
    let evaluated = json(&["eval", utf8(&run), "--episodes", "2"]);
    assert_eq!(evaluated["episodes"], 2);

    let again = root.path().join("again");
    let preset = run.join("config.toml");
    let error = refusal(
        &[
            "train",
            "open_drawer",
            "--preset",
            utf8(&preset),
            "--demo-dir",
            utf8(&demos),
            "--out",
            utf8(&again),
        ],
        1,
    );
    assert!(
        error.contains("reach_target-xarm7-70.demo.json.gz: task: expected open_drawer"),
        "{error}"
    );
    assert!(!again.exists(), "a run that cannot begin leaves nothing");
}

#[test]
fn wrong_demonstrations_cameras_and_backends_are_refused() {
    let root = tempfile::tempdir().unwrap();
    let (demos, run) = (root.path().join("demos"), root.path().join("run"));
    let train = |options: &[&str], status| {
        refusal(
            &[&["train", "reach_target", "--oracle-poses", "--out", utf8(&run)], options].concat(),
            status,
        )
    };
    assert!(train(&["--backend", "torch"], 2).contains("backend: expected one of flex"));
    assert!(train(&["--cameras", "front,rear"], 2).contains("camera: expected one of front"));
    assert!(train(&["--demo-dir", "a", "--demos", "3"], 2).contains("--demos"));
    std::fs::create_dir(&demos).unwrap();
    assert!(train(&["--demo-dir", utf8(&demos)], 1).contains("holds no demonstration"));
    std::fs::remove_dir(&demos).unwrap();
    json(&["demo", "reach_target", "--episodes", "1", "--seed", "5000", "--out", utf8(&demos)]);
    assert!(train(&["--demo-dir", utf8(&demos)], 1).contains("scene_seed: 5000 is held out"));
    assert!(!run.exists());
}
