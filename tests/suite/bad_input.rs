//! Errors of every command about input that it cannot use: one line that names it, and nothing
//! half-written.

use crate::lpr::{Folder, command, files_below, json, refusal, refusal_of};
use crate::runs::preset;
use serde_json::Value;
use std::fs;

/// Runs `arguments` in an empty directory that has to stay empty.
#[track_caller]
fn refused(arguments: &[&str], status: i32) -> String {
    let folder = Folder::new();
    let mut command = command(arguments);
    command.current_dir(folder.path());
    let error = refusal_of(command, status);
    assert!(files_below(folder.path()).is_empty(), "{arguments:?}: {error}");
    error
}

#[test]
fn unknown_names_are_told_with_those_that_exist() {
    let train = ["train", "reach_target", "--out", "run"];
    let cases: [(&[&str], &str); 16] = [
        (&["demo", "make_coffee", "--out", "run"], "task: expected one of reach_target"),
        (&["paths", "make_coffee"], "task: expected one of reach_target"),
        (&["render", "make_coffee", "--out", "a.png"], "task: expected one of reach_target"),
        (&["train", "make_coffee", "--out", "run"], "task: expected one of reach_target"),
        (&["eval", "make_coffee", "--oracle-poses"], "task: expected one of reach_target"),
        (
            &["demo", "reach_target", "--robot", "ur5", "--out", "run"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (
            &["paths", "reach_target", "--robot", "ur5"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (
            &["render", "reach_target", "--robot", "ur5", "--out", "a.png"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (
            &["fk", "--robot", "ur5", "--configs", "a.json"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (
            &["ik", "--robot", "ur5", "--poses", "a.json"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (
            &["train", "reach_target", "--out", "run", "--robot", "ur5"],
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        (&["eval", "run", "--robot", "ur5"], "robot: expected one of xarm7, panda, found 'ur5'"),
        (
            &["train", "reach_target", "--out", "run", "--method", "guess"],
            "method: expected one of lpr",
        ),
        (
            &["eval", "reach_target", "--oracle-poses", "--method", "guess"],
            "method: expected one of lpr",
        ),
        (&["fly"], "'fly'"),
        (&["tasks", "--jsno"], "'--jsno'"),
    ];
    for (arguments, says) in cases {
        let error = refused(arguments, 2);
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
    let error = refused(&[&train[..], &["--preset", "quick"]].concat(), 1);
    assert!(
        error.contains("preset: expected one of fast, paper, paper-narrow, found 'quick'"),
        "{error}"
    );
}

#[test]
fn numbers_out_of_their_range_are_told_with_their_option() {
    let train = |rest: &[&'static str]| [&["train", "reach_target", "--out", "run"], rest].concat();
    for (arguments, status, says) in [
        (vec!["demo", "reach_target", "--episodes", "0"], 2, "--episodes"),
        (vec!["demo", "reach_target", "--seed", "-1"], 2, "'-1'"),
        (vec!["paths", "reach_target", "--episodes", "many"], 2, "--episodes"),
        (vec!["paths", "reach_target", "--keyframe", "9"], 2, "--keyframe 9"),
        (vec!["paths", "reach_target", "--sigma", "nan"], 1, "bezier.sigma"),
        (vec!["ik", "--poses", "a.json", "--solutions", "0"], 2, "--solutions"),
        (train(&["--minutes", "0"]), 1, "--minutes"),
        (train(&["--minutes", "nan"]), 1, "--minutes"),
        (train(&["--minutes", "soon"]), 2, "--minutes"),
        (train(&["--demos", "-3"]), 2, "'-3'"),
        (train(&["--env-steps", "1.5"]), 2, "--env-steps"),
        (train(&["--method", "linear"]), 1, "`linear` has nothing to train"),
        (train(&["--seed", "18446744073709551616"]), 2, "--seed"),
    ] {
        let error = refused(&arguments, status);
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
}

/// The error of `lpr train` about a preset file, after its path.
#[track_caller]
fn preset_refusal(text: impl AsRef<[u8]>) -> String {
    preset_refusal_for("reach_target", text)
}

#[track_caller]
fn preset_refusal_for(task: &str, text: impl AsRef<[u8]>) -> String {
    let folder = Folder::new();
    let file = folder.write("mine.toml", text);
    let out = folder.at("run");
    let error = refusal(
        &["train", task, "--oracle-poses", "--preset", &file, "--out", &out, "--env-steps", "1"],
        1,
    );
    assert_eq!(files_below(folder.path()).len(), 1, "{error}");
    error.strip_prefix(&format!("{file}: ")).unwrap_or(&error).to_owned()
}

#[test]
fn a_preset_file_is_refused_by_the_setting_at_fault() {
    let small = preset(&[]);
    let replaced = |from: &str, to: &str| {
        assert!(small.contains(from), "{from} is not in {small}");
        small.replacen(from, to, 1)
    };
    for (text, says) in [
        (replaced("bezier_paths", "bezeir_paths"), "unknown field `bezeir_paths`"),
        (replaced("bezier_paths = 2\n", ""), "missing field `bezier_paths`"),
        (replaced("[policy]", "[polcy]"), "polcy"),
        (
            replaced("bezier_paths = 2", "bezier_paths = -2"),
            "candidates.bezier_paths: expected a finite number from 0, found -2",
        ),
        (replaced("bezier_paths = 2", "bezier_paths = \"two\""), "invalid type: string \"two\""),
        (replaced("bezier_paths = 2", "bezier_paths = 2.5"), "invalid type: floating point `2.5`"),
        (replaced("bezier_paths = 2", "bezier_paths ="), "TOML parse error"),
        (replaced("config_widths = [8, 16]", "config_widths = 8"), "invalid type: integer `8`"),
        (
            replaced("sigma = 0.07", "sigma = nan"),
            "candidates.bezier.sigma: expected a finite number from 0, found NaN",
        ),
        (replaced("sigma = 0.07", "sigma = -inf"), "candidates.bezier.sigma"),
        (replaced("sigma = 0.07", "sigma = 1e400"), "TOML parse error"),
        (String::new(), "missing field `candidates`"),
    ] {
        let error = preset_refusal(text);
        assert!(error.contains(says), "{error}");
    }
    assert!(preset_refusal([0xff, 0xfe, 0x00]).contains("cannot read"));
}

#[test]
fn settings_that_cannot_work_are_named_before_anything_is_written() {
    for (setting, value) in [
        ("candidates.path_len", "1"),
        ("candidates.path_len", "1000000000"),
        ("candidates.draws_per_path", "0"),
        ("candidates.planner_paths", "1000000000"),
        ("ranker.config_widths", "[]"),
        ("ranker.config_widths", "[8, 0]"),
        ("ranker.head_widths", "[1000000000]"),
        ("ranker.discount", "1.5"),
        ("ranker.target_mix", "1.5"),
        ("policy.widths", "[0]"),
        ("policy.widths", "[1000000000, 1000000000]"),
        ("q_attention.voxels_per_side", "1000000000"),
        ("q_attention.network.cell_channels", "0"),
        ("q_attention.network.block_channels", "0"),
        ("q_attention.network.hidden", "1000000000"),
        ("q_attention.rotation_bins", "1000000000"),
        ("replay.capacity", "0"),
        ("replay.capacity", "1000000000000"),
        ("training.path_batch", "0"),
        ("training.path_batch", "1000000000"),
        ("training.validation_interval", "0"),
        ("training.cloud_spacing", "1e-9"),
        ("timing.max_velocity", "0"),
        ("timing.max_acceleration", "0.0"),
        ("simulator.dt", "0.0"),
        ("simulator.solver_iterations", "0"),
    ] {
        let error = preset_refusal(preset(&[(setting, value)]));
        let (module, name) = setting.split_once('.').unwrap();
        let name = name.rsplit('.').next().unwrap();
        let says_which = error.contains(name) || error.contains("every layer");
        assert!(error.contains(module) && says_which, "{setting} = {value}: {error}");
    }
}

#[test]
fn a_world_in_which_no_demonstration_succeeds_leaves_no_run() {
    let error = preset_refusal_for("toilet_seat_up", preset(&[("simulator.abort_force", "0.0")]));
    assert_eq!(error, "environment: only 0 of 2 demonstrations succeeded");
}

#[test]
fn a_run_that_is_called_like_a_preset_does_not_hide_it() {
    let folder = Folder::new();
    fs::create_dir(folder.path().join("fast")).unwrap();
    folder.write("fast/config.toml", "");
    let mut train = command(&["train", "reach_target", "--out", "fast"]);
    train.current_dir(folder.path());
    assert!(refusal_of(train, 1).starts_with("fast: is not empty"));
    let mut eval = command(&[
        "eval",
        "reach_target",
        "--oracle-poses",
        "--method",
        "linear",
        "--episodes",
        "1",
    ]);
    assert!(eval.current_dir(folder.path()).output().unwrap().status.success());
}

#[test]
fn files_of_poses_and_configurations_are_refused_by_their_field() {
    let config = "[0, 0, 0, 0, 0, 0, 0]";
    let pose = |text: &str| format!(r#"{{"poses": [{{"position": [0, 0, 0], {text}}}]}}"#);
    let nested = "[".repeat(100_000);
    for (command, text, says) in [
        ("fk", String::new(), "EOF"),
        ("fk", "{".to_owned(), "EOF"),
        ("fk", "robots".to_owned(), "expected"),
        ("fk", nested, "invalid type: sequence"),
        ("fk", "{}".to_owned(), "missing field `configs`"),
        ("fk", format!(r#"{{"configs": [{config}], "poses": []}}"#), "unknown field `poses`"),
        (
            "fk",
            format!(r#"{{"configs": [{config}, [0, 0, 0]]}}"#),
            "configs[1]: has 3 joint angles, xarm7 has 7",
        ),
        (
            "fk",
            r#"{"configs": [[0, 0, 0, "0", 0, 0, 0]]}"#.to_owned(),
            "configs[0][3]: invalid type: string",
        ),
        ("fk", r#"{"configs": [[0, 0, 0, NaN, 0, 0, 0]]}"#.to_owned(), "expected value"),
        ("fk", r#"{"configs": [[0, 0, 0, 1e39, 0, 0, 0]]}"#.to_owned(), "configs[0]"),
        ("fk", format!(r#"{{"configs": [{config}]}} and more"#), "trailing characters"),
        ("ik", pose(r#""rotation_xyzw": [0, 0, 0, 2]"#), "poses[0].rotation_xyzw: has norm 2"),
        (
            "ik",
            pose(r#""rotation_xyzw": [1e200, 0, 0, 0]"#),
            "poses[0].rotation_xyzw: has norm inf",
        ),
        ("ik", pose(r#""rotation_xyzw": [0, 0, 1]"#), "poses[0].rotation_xyzw: invalid length 3"),
        ("ik", pose(r#""quaternion": [0, 0, 0, 1]"#), "poses[0].quaternion: unknown field"),
        (
            "ik",
            pose(r#""rotation_xyzw": [0, 0, 0, 1], "seed_config": [0]"#),
            "poses[0].seed_config: has 1 joint angles, xarm7 has 7",
        ),
        ("ik", r#"{"poses": {}}"#.to_owned(), "poses: invalid type: map"),
    ] {
        let error = file_refusal(command, "a.json", text.as_bytes());
        assert!(error.contains(says), "{command} {text:.60}: {error}");
    }
    assert!(file_refusal("fk", "a.json", &[b'"', 0xff, b'"']).contains("invalid unicode"));
    assert!(
        file_refusal("fk", "a.json.gz", br#"{"configs": []}"#)
            .contains("cannot read: invalid gzip header")
    );
    for option in [["fk", "--configs"], ["ik", "--poses"]] {
        let folder = Folder::new();
        let path = folder.at("");
        assert!(refusal(&[option[0], option[1], &path], 1).contains("cannot read: Is a directory"));
    }
}

/// The error of `command` about a file, after its path.
#[track_caller]
fn file_refusal(command: &str, name: &str, content: &[u8]) -> String {
    let folder = Folder::new();
    let file = folder.write(name, content);
    let option = if command == "fk" { "--configs" } else { "--poses" };
    let error = refusal(&[command, option, &file], 1);
    error.strip_prefix(&format!("{file}: ")).unwrap_or_else(|| panic!("{error}")).to_owned()
}

#[test]
fn what_is_there_is_not_overwritten() {
    let folder = Folder::new();
    let kept = folder.at("kept");
    fs::create_dir(&kept).unwrap();
    folder.write("kept/notes.txt", "mine");
    folder.write("file", "mine");
    let preset = folder.write("small.toml", preset(&[]));
    let before = files_below(folder.path());
    let below_file = folder.at("file/run");
    for out in [&kept, &folder.at("file"), &below_file] {
        let train = [
            "train",
            "reach_target",
            "--oracle-poses",
            "--preset",
            &preset,
            "--env-steps",
            "1",
            "--out",
            out,
        ];
        for arguments in [&["demo", "reach_target", "--episodes", "1", "--out", out][..], &train] {
            let error = refusal(arguments, 1);
            assert!(error.starts_with(&format!("{out}: ")), "{error}");
        }
        let error = refusal(&[&train[..], &["--resume"]].concat(), 1);
        assert!(error.starts_with(out.as_str()), "{error}");
    }
    assert!(files_below(folder.path()) == before, "something was written");
    // Without a name it would be the current directory.
    let mut here =
        command(&["train", "reach_target", "--oracle-poses", "--preset", &preset, "--out", ""]);
    here.current_dir(folder.path());
    assert!(refusal_of(here, 2).contains("--out"));
    let picture = folder.at("no/such/directory/a.png");
    assert!(refusal(&["render", "reach_target", "--out", &picture], 1).starts_with(&picture));
    assert!(files_below(folder.path()) == before, "something was written");
}

#[test]
fn commands_that_take_any_seed_take_the_largest() {
    let largest = u64::MAX.to_string();
    let successes = |report: &Value| report["successes"].as_u64();
    let report = json(&["demo", "reach_target", "--seed", &largest, "--episodes", "2"]);
    assert_eq!(successes(&report), Some(2), "{report}");
    let report = json(&["paths", "reach_target", "--seed", &largest]);
    assert!(!report["candidates"].as_array().unwrap().is_empty());
}
