//! Files that an earlier version wrote still open: `tests/golden/written-by-0.1.0`.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{self, Folder, files_below};
use crate::server::Server;
use lpr_tests::workspace;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn old() -> PathBuf {
    workspace().join("tests/golden/written-by-0.1.0")
}

/// A copy of a folder, since commands write beside what they read.
fn copied(from: &Path, to: &Path) {
    for (path, content) in files_below(from) {
        let copy = to.join(path.strip_prefix(from).unwrap());
        if path.is_dir() {
            fs::create_dir_all(copy).unwrap();
        } else {
            fs::create_dir_all(copy.parent().unwrap()).unwrap();
            fs::write(copy, content).unwrap();
        }
    }
}

/// A folder with a copy of the old run, and the path of the copy.
fn old_run() -> (Folder, String) {
    let folder = Folder::new();
    let run = folder.at("run");
    copied(&old().join("run"), Path::new(&run));
    (folder, run)
}

#[test]
fn an_old_checkpoint_acts() {
    let (_folder, run) = old_run();
    let report = lpr::json(&["eval", &run, "--episodes", "2"]);
    assert_eq!((&report["task"], &report["episodes"]), (&"open_drawer".into(), &2.into()));
}

#[test]
fn an_old_run_goes_on() {
    let (_folder, run) = old_run();
    let preset = format!("{run}/config.toml");
    let fixed = ["train", "open_drawer", "--preset", &preset, "--env-steps", "4", "--seed", "4"];
    let report = lpr::json(&[&fixed[..], &["--minutes", "60", "--out", &run, "--resume"]].concat());
    assert_eq!(report["env_steps"], 4);
    assert!(report["updates"].as_u64() > Some(20), "it has learned more: {report}");
}

#[test]
fn an_old_episode_is_replayed() {
    let episode = old().join("run/episodes/00000002.episode.json.gz");
    let report = lpr::json(&["replay", episode.to_str().unwrap()]);
    assert_eq!(report["task"], "open_drawer");
}

#[test]
fn an_old_demonstration_teaches() {
    let folder = Folder::new();
    copied(&old(), folder.path());
    let (preset, out) = (folder.at("run/config.toml"), folder.at("taught"));
    let fixed = ["train", "reach_target", "--preset", &preset, "--env-steps", "1"];
    let demos = folder.path().to_str().unwrap();
    let report =
        lpr::json(&[&fixed[..], &["--minutes", "60", "--demo-dir", demos, "--out", &out]].concat());
    assert_eq!(report["env_steps"], 1);
}

#[test]
fn an_old_database_still_has_its_jobs() {
    let folder = Folder::new();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    fs::copy(old().join("lpr.sqlite"), data.join("lpr.sqlite")).unwrap();
    let server = Server::start(&folder, &["--workers", "0"]);
    let jobs = server.get("/v1/jobs").json();
    let word = |job: &Value, key: &str| job[key].as_str().unwrap().to_owned();
    let jobs = jobs["jobs"].as_array().unwrap().iter();
    let found: Vec<_> = jobs.map(|job| (word(&job["spec"], "task"), word(job, "state"))).collect();
    let expected = [("open_drawer", "cancelled"), ("reach_target", "queued")];
    assert_eq!(found, expected.map(|(task, state)| (task.to_owned(), state.to_owned())));
}
