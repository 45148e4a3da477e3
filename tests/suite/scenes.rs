//! Scenes as files, and what an agent's camera sees of them.

use crate::lpr::{Folder, files_below, json, refusal};
use serde_json::{Value, json};
use std::fs;

/// `arguments` with `options` after them.
fn with<'a>(arguments: &[&'a str], options: &[&'a str]) -> Vec<&'a str> {
    [arguments, options].concat()
}

#[test]
fn the_scene_of_a_file_is_drawn_as_that_of_its_task_and_seed() {
    let folder = Folder::new();
    let [scene, from_file, from_task] =
        ["a.scene.json", "file.png", "task.png"].map(|name| folder.at(name));
    let report = json(&["scene", "stack_wine", "--robot", "panda", "--seed", "4", "--out", &scene]);
    assert_eq!(
        (&report["task"], &report["robot"], &report["seed"]),
        (&json!("stack_wine"), &json!("panda"), &json!(4))
    );
    assert!(report["bodies"].as_array().unwrap().contains(&json!("table")));
    for options in [
        &["--size", "64x48"][..],
        &["--show", "rgb"],
        &["--show", "depth", "--camera", "wrist"],
        &["--show", "mask"],
    ] {
        let mut reports = [
            json(&with(&["render", "--scene", &scene, "--out", &from_file], options)),
            json(&with(
                &["render", "stack_wine", "--robot", "panda", "--seed", "4", "--out", &from_task],
                options,
            )),
        ];
        reports.iter_mut().for_each(|report| report["file"] = Value::Null);
        assert_eq!(reports[0], reports[1]);
        assert_eq!(fs::read(&from_file).unwrap(), fs::read(&from_task).unwrap(), "{options:?}");
    }
}

#[test]
fn a_scene_that_was_changed_is_built_as_changed_or_refused_with_the_field() {
    let folder = Folder::new();
    let [scene, picture] = ["a.scene.json", "a.png"].map(|name| folder.at(name));
    json(&["scene", "pick_up_cup", "--out", &scene]);
    let good: Value = serde_json::from_slice(&fs::read(&scene).unwrap()).unwrap();
    let drawn = || {
        json(&["render", "--scene", &scene, "--show", "rgb", "--out", &picture]);
        fs::read(&picture).unwrap()
    };
    let before = drawn();
    let mut moved = good.clone();
    moved["scene"]["bodies"][0]["pose"]["translation"][0] = json!(0.3);
    fs::write(&scene, moved.to_string()).unwrap();
    assert_ne!(drawn(), before);
    fs::remove_file(&picture).unwrap();
    let broken = [
        ("/scene/bodies/0/kind", json!("soft"), "scene.bodies[0].kind: unknown variant `soft`"),
        ("/scene/bodies/0/mass", json!(-1), "expected mass and friction from 0"),
        ("/scene/task", json!("make_coffee"), "task: expected one of reach_target"),
        ("/version", json!(9), "version: 9 is unknown"),
        ("/robot", json!("ur5"), "robot: "),
    ];
    for (field, value, says) in broken {
        let mut file = good.clone();
        *file.pointer_mut(field).unwrap() = value;
        fs::write(&scene, file.to_string()).unwrap();
        let error = refusal(&["render", "--scene", &scene, "--out", &picture], 1);
        assert!(error.contains(says), "{field}: {error}");
    }
    assert_eq!(files_below(folder.path()).len(), 1, "nothing but the scene is left");
}

#[test]
fn a_mask_is_told_by_the_names_of_bodies_and_links() {
    let folder = Folder::new();
    let (scene, picture) = (folder.at("a.scene.json"), folder.at("a.png"));
    let bodies =
        json(&["scene", "open_drawer", "--out", &scene])["bodies"].as_array().unwrap().clone();
    let report =
        json(&["render", "open_drawer", "--show", "mask", "--size", "100x80", "--out", &picture]);
    let rows = report["mask"].as_array().unwrap();
    for row in rows {
        let value = row["value"].as_u64().unwrap() as usize;
        let expected = bodies.get(value - 1);
        assert!(expected.is_none_or(|name| row["name"] == *name), "{row}");
    }
    let n_pixels = |name: &str| {
        rows.iter().find(|row| row["name"] == name).map_or(0, |row| row["pixels"].as_u64().unwrap())
    };
    assert!(n_pixels("table") > 1000 && n_pixels("hand") > 10, "{report}");
}

#[test]
fn noise_and_random_looks_are_those_of_the_seed() {
    let folder = Folder::new();
    let picture = folder.at("a.png");
    let drawn = |options: &[&str]| {
        let report =
            json(&with(&["render", "open_box", "--seed", "7", "--out", &picture], options));
        (fs::read(&picture).unwrap(), report)
    };
    for (plain, changed) in [
        (&["--show", "depth"][..], &["--show", "depth", "--noise"][..]),
        (&["--show", "rgb"], &["--show", "rgb", "--randomize"]),
        (
            &["--show", "mask", "--camera", "wrist"],
            &["--show", "mask", "--camera", "wrist", "--randomize"],
        ),
    ] {
        assert_eq!(drawn(changed), drawn(changed));
        assert_ne!(drawn(changed).0, drawn(plain).0);
    }
    let share = |options: &[&str]| drawn(options).1["share"].as_f64().unwrap();
    assert!(share(&["--show", "depth", "--noise"]) < share(&["--show", "depth"]) - 0.003, "holes");
    assert_eq!(
        drawn(&["--show", "rgb", "--noise"]),
        drawn(&["--show", "rgb"]),
        "noise is of the depth alone"
    );
}

#[test]
fn options_that_do_not_go_together_are_told() {
    let folder = Folder::new();
    let picture = folder.at("a.png");
    let refused = |options: &[&str]| {
        refusal(&with(&["render", "reach_target", "--out", &picture], options), 2)
    };
    assert!(refused(&["--noise"]).contains("--show"));
    assert!(refused(&["--randomize"]).contains("--show"));
    assert!(refused(&["--show", "depth", "--demo"]).contains("--demo"));
    assert!(refused(&["--show", "depth", "--camera", "beauty"]).contains("no camera of an agent"));
    assert!(refused(&["--show", "heat"]).contains("rgb, depth, mask"));
    assert!(refused(&["--scene", "a.json"]).contains("--scene"));
    assert!(files_below(folder.path()).is_empty());
    let file = folder.write("something", "here");
    let error = refusal(&["gallery", "--out", folder.path().to_str().unwrap()], 1);
    assert!(error.contains("is not empty"), "{error}");
    assert_eq!(fs::read(file).unwrap(), b"here");
}
