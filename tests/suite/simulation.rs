//! The commands that run the simulator, as a script sees them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{command, refusal, silent_json, table};
use serde_json::{Value, json};
use std::path::Path;

fn utf8(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn names(directory: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn tasks_are_listed_with_their_set_and_keyframes() {
    let tasks = &silent_json(&["tasks"])["tasks"];
    let rows: Vec<_> = tasks
        .as_array()
        .unwrap()
        .iter()
        .map(|task| (&task["name"], &task["set"], &task["keyframes"]))
        .collect();
    assert!(rows.contains(&(&json!("reach_target"), &json!("1"), &json!(1))));
    assert!(rows.contains(&(&json!("toilet_seat_up"), &json!("2"), &json!(3))));
    assert!(
        tasks
            .as_array()
            .unwrap()
            .iter()
            .all(|task| !task["description"].as_str().unwrap().is_empty())
    );
    assert!(table(&["tasks"]).contains("open_drawer"));
}

#[test]
fn both_arms_do_every_task_by_script_and_with_quantised_keyframes() {
    for task in ["reach_target", "take_lid_off_saucepan", "open_drawer", "toilet_seat_up"] {
        for robot in ["xarm7", "panda"] {
            for quantised in [&[][..], &["--quantised"]] {
                let report = silent_json(
                    &[&["demo", task, "--robot", robot, "--episodes", "6"], quantised].concat(),
                );
                assert_eq!(
                    (&report["task"], &report["robot"], &report["episodes"]),
                    (&json!(task), &json!(robot), &json!(6))
                );
                assert_eq!(report["quantised"], json!(!quantised.is_empty()));
                let failed = report["failed"].as_array().unwrap().len() as u64;
                assert_eq!(report["successes"].as_u64().unwrap() + failed, 6, "{report}");
                assert!(failed <= 1, "{report}");
                assert!(report["seconds"].as_f64() > Some(0.0));
            }
        }
    }
}

#[test]
fn demonstrations_are_written_whole_and_never_over_others() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("demos");
    let arguments = ["demo", "reach_target", "--episodes", "2", "--seed", "7", "--out", utf8(&out)];
    assert_eq!(silent_json(&arguments)["successes"], 2);
    assert_eq!(
        names(&out),
        ["reach_target-xarm7-7.demo.json.gz", "reach_target-xarm7-8.demo.json.gz"]
    );
    let file = out.join("reach_target-xarm7-8.demo.json.gz");
    let demo: lpr_server::formats::DemoFile =
        lpr_server::files::read_versioned_json(&file, 1).unwrap();
    assert_eq!(
        (demo.task.as_deref(), demo.robot.as_str(), demo.scene_seed),
        (Some("reach_target"), "xarm7", Some(8))
    );
    assert!(demo.success && demo.frames.len() > 10 && demo.frames[0].gripper_open);
    // What was written moves as it says: the next frame is where the velocity leads.
    for pair in demo.frames.windows(2) {
        let error = (0..7)
            .map(|j| (pair[0].q[j] + pair[0].qd[j] * demo.control_dt - pair[1].q[j]).abs())
            .fold(0.0, f32::max);
        assert!(error < 1e-5, "{error}");
    }
    let error = refusal(&arguments, 1);
    assert!(error.starts_with(utf8(&out)) && error.contains("is not empty"), "{error}");
    let file = out.join("reach_target-xarm7-7.demo.json.gz");
    assert!(
        refusal(&["demo", "reach_target", "--out", utf8(&file.join("x"))], 1)
            .starts_with(utf8(&file))
    );
}

#[test]
fn candidates_are_listed_and_executed_from_snapshots() {
    let arguments = ["paths", "take_lid_off_saucepan", "--keyframe", "all", "--seed", "3"];
    let drawn = silent_json(&arguments);
    let executed = silent_json(&[&arguments[..], &["--execute"]].concat());
    let rows = |report: &Value| report["candidates"].as_array().unwrap().clone();
    assert_eq!(rows(&drawn).len(), rows(&executed).len());
    for (drawn, executed) in rows(&drawn).iter().zip(rows(&executed)) {
        assert_eq!((&drawn["path"], &drawn["executed"]), (&executed["path"], &json!(false)));
        assert!(drawn["value"].is_null() && drawn["success"].is_null());
        let is_rejected = !executed["rejected"].is_null();
        assert_eq!(executed["executed"], json!(!is_rejected));
        assert_eq!(executed["path"].is_null(), is_rejected);
        assert_eq!(
            executed["reason"].is_null(),
            is_rejected || executed["success"] == true,
            "{executed}"
        );
    }
    let count = |source: &str, holds: &dyn Fn(&Value) -> bool| {
        rows(&executed).iter().filter(|row| row["source"] == source && holds(row)).count()
    };
    for source in ["planner", "bezier"] {
        let summary = &executed["summary"][source];
        assert_eq!(summary["drawn"], count(source, &|_| true));
        assert_eq!(summary["admitted"], count(source, &|row| row["rejected"].is_null()));
        assert_eq!(summary["successes"], count(source, &|row| row["success"] == true));
        assert!(drawn["summary"][source]["successes"].is_null());
    }
    assert!(executed["summary"]["best_of_all"].as_f64() > Some(0.0));
    assert_eq!(executed["keyframes"].as_array().unwrap().len(), 3);
    assert!(table(&arguments).contains("best-of-all"));
}

/// The box's lid turns about a hinge, and the grip with it.
#[test]
fn a_screw_motion_that_is_asked_for_opens_the_box() {
    let arguments = ["paths", "open_box", "--keyframe", "2", "--execute"];
    let (without, with) =
        (silent_json(&arguments), silent_json(&[&arguments[..], &["--screw"]].concat()));
    assert_eq!(with["summary"]["screw"], json!({"drawn": 1, "admitted": 1, "successes": 1}));
    assert_eq!(with["keyframes"][0]["screw"], 1.0);
    assert!(
        without["summary"].get("screw").is_none() && without["keyframes"][0].get("screw").is_none()
    );
    let others = |report: &Value| {
        let rows = report["candidates"].as_array().unwrap().iter();
        rows.filter(|row| row["source"] != "screw").cloned().collect::<Vec<_>>()
    };
    assert_eq!(others(&with), others(&without));
    assert!(table(&[&arguments[..], &["--screw"]].concat()).contains("screw"));
}

#[test]
fn the_same_seed_gives_the_same_candidates_with_any_thread_count() {
    let output = |threads: &str| {
        let arguments = ["paths", "open_drawer", "--keyframe", "2", "--execute", "--json"];
        command(&arguments).env("RAYON_NUM_THREADS", threads).output().unwrap()
    };
    let (one, three) = (output("1"), output("3"));
    assert!(one.status.success() && one.stdout == three.stdout);
}

#[test]
fn pictures_have_the_size_that_is_printed() {
    let root = tempfile::tempdir().unwrap();
    let picture = root.path().join("scene.png");
    let options =
        ["--camera", "beauty", "--size", "160x90", "--candidates", "outcome", "--keyframe", "2"];
    let report = silent_json(
        &[&["render", "toilet_seat_up", "--out", utf8(&picture)][..], &options].concat(),
    );
    assert_eq!(report, json!({"file": utf8(&picture), "width": 160, "height": 90}));
    let decoder =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&picture).unwrap()));
    let reader = decoder.read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (160, 90));
    let animation = root.path().join("demo.gif");
    let options = ["--demo", "--candidates", "--size", "64x48", "--out"];
    let report =
        silent_json(&[&["render", "reach_target"][..], &options, &[utf8(&animation)]].concat());
    let mut decoder =
        gif::DecodeOptions::new().read_info(std::fs::File::open(&animation).unwrap()).unwrap();
    let mut frames = 0;
    while decoder.read_next_frame().unwrap().is_some() {
        frames += 1;
    }
    assert_eq!(
        (decoder.width(), decoder.height(), json!(frames)),
        (64, 48, report["frames"].clone())
    );
    assert!(frames > 10);
}

#[test]
fn wrong_usage_names_what_would_be_right() {
    let error = refusal(&["demo", "make_coffee"], 2);
    assert!(error.contains("task: expected one of reach_target"), "{error}");
    assert!(
        refusal(&["demo", "reach_target", "--robot", "ur5"], 2)
            .contains("expected one of xarm7, panda")
    );
    assert!(refusal(&["demo", "reach_target", "--episodes", "0"], 2).contains("0 is not in 1.."));
    assert!(
        refusal(&["paths", "reach_target", "--keyframe", "first"], 2)
            .contains("a number from 0 or 'all'")
    );
    assert!(
        refusal(&["paths", "reach_target", "--keyframe", "1"], 2)
            .contains("keyframes of reach_target are 0 to 0")
    );
    assert!(refusal(&["paths", "reach_target", "--sigma", "NaN"], 1).contains("bezier.sigma"));
    assert!(
        refusal(&["paths", "reach_target", "--collision-free-fraction", "2"], 1).contains("0 to 1")
    );
    assert!(
        refusal(&["paths", "reach_target", "--abort-force", "0"], 2).contains("newtons above 0")
    );
    assert!(
        refusal(&["paths", "reach_target", "--friction-scale", "NaN"], 2)
            .contains("a number from 0")
    );
    assert!(
        refusal(&["placements", "reach_target", "--scenes", "0"], 2).contains("0 is not in 1..=")
    );
    let error = refusal(&["demo", "open_drawer", "--variation", "3"], 1);
    assert!(error.contains("task 'open_drawer' has no variation 3: 0 to 2"), "{error}");
    let error = refusal(&["render", "reach_target", "--camera", "rear", "--out", "a.png"], 2);
    assert!(error.contains("camera: expected one of front"), "{error}");
    assert!(refusal(&["render", "reach_target", "--out", "a.jpg"], 2).contains("ends in .png"));
    assert!(
        refusal(&["render", "reach_target", "--demo", "--out", "a.png"], 2)
            .contains("ends in .gif")
    );
    assert!(
        refusal(&["render", "reach_target", "--size", "0x9", "--out", "a.png"], 2)
            .contains("WIDTHxHEIGHT")
    );
    let error = refusal(&["render", "reach_target", "--out", "no/such/directory/a.png"], 1);
    assert!(error.starts_with("no/such/directory/a.png: cannot write"), "{error}");
}

#[test]
fn placements_count_what_was_rejected_and_what_was_covered() {
    let report = silent_json(&["placements", "open_drawer", "--scenes", "40", "--robot", "panda"]);
    let number = |key: &str| report[key].as_f64().unwrap();
    assert_eq!((number("scenes"), number("unplaced")), (40.0, 0.0));
    assert!(
        (0.0..0.5).contains(&(number("rejected_at_the_arm") + number("rejected_out_of_reach"))),
        "{report}"
    );
    let [hit, feasible] = ["hit", "feasible"].map(|key| report["cells"][key].as_u64().unwrap());
    assert!(10 < hit && hit <= feasible, "{report}");
    // Within 6 and 12 cm of the middle of the chest's places.
    let [x, y] =
        [0, 1].map(|axis| [0, 1].map(|end| report["range_m"][axis][end].as_f64().unwrap()));
    assert!(0.46 <= x[0] && x[1] <= 0.58 && -0.44 <= y[0] && y[1] <= -0.20, "{report}");
    let fixed = silent_json(&["placements", "open_dishwasher", "--scenes", "5"]);
    assert_eq!((&fixed["cells"]["hit"], &fixed["cells"]["feasible"]), (&json!(1), &json!(1)));
}

#[test]
fn another_variation_is_demonstrated_and_held_by_friction() {
    let report = silent_json(&[
        "demo",
        "open_drawer",
        "--variation",
        "2",
        "--robot",
        "panda",
        "--episodes",
        "2",
    ]);
    assert_eq!((&report["variation"], &report["successes"]), (&json!(2), &json!(2)));
    let report = silent_json(&["demo", "pick_and_lift", "--friction-grasps", "--episodes", "2"]);
    assert_eq!((&report["friction_grasps"], &report["successes"]), (&json!(true), &json!(2)));
}

/// The file of an episode in which a method without networks opens a drawer.
fn recorded_episode(directory: &Path) -> std::path::PathBuf {
    use lpr_core::agent::{Agent, Init, Method, Networks, PoseSource};
    let config = lpr_core::config::Config::preset("fast").unwrap();
    let (robot, method) = (&lpr_core::robot::PANDA, Method::Random);
    let init = Init { backend: lpr_core::nn::Backend::Flex, seed: 0 };
    let agent = Agent::new(
        config.agent_settings(),
        robot,
        method,
        Networks::new(config.network_settings(), robot, method, PoseSource::Oracle, init).unwrap(),
    );
    let task = lpr_core::sim::tasks::Task::by_name("take_lid_off_saucepan").unwrap();
    let mut environment =
        lpr_core::sim::SimEnvironment::new(&task, robot, 1, &["front"], &config.simulator).unwrap();
    let episode = lpr_server::episode::EpisodeFile::record(&agent, &mut environment, 1001).unwrap();
    let path = directory.join("lid.episode.json.gz");
    episode.write(&path).unwrap();
    path
}

#[test]
fn an_episode_file_runs_again_and_is_drawn() {
    let root = tempfile::tempdir().unwrap();
    let file = recorded_episode(root.path());
    let report = silent_json(&["replay", utf8(&file)]);
    assert_eq!(
        (&report["identical"], &report["task"]),
        (&json!(true), &json!("take_lid_off_saucepan"))
    );
    assert_eq!(report["world_hash"].as_str().unwrap().len(), 16);
    let animation = root.path().join("lid.gif");
    let report = silent_json(&[
        "render",
        "--episode",
        utf8(&file),
        "--size",
        "64x48",
        "--out",
        utf8(&animation),
    ]);
    assert!(report["frames"].as_u64().unwrap() > 5 && animation.exists());
    assert!(
        refusal(&["render", "--episode", utf8(&file), "--out", "a.png"], 2)
            .contains("ends in .gif")
    );
    assert!(refusal(&["render", "--out", "a.png"], 2).contains("<TASK>"));
    refusal(&["render", "reach_target", "--episode", utf8(&file), "--out", "a.gif"], 2);
    std::fs::write(&file, b"{}").unwrap();
    for arguments in [
        &["replay", utf8(&file)][..],
        &["render", "--episode", utf8(&file), "--out", utf8(&animation)],
    ] {
        assert!(refusal(arguments, 1).starts_with(utf8(&file)));
    }
}

#[test]
fn benchmarks_have_their_names_and_threads() {
    let report = silent_json(&["bench", "planning", "--threads", "1"]);
    let rows = report["results"].as_array().unwrap();
    let names: Vec<_> = rows.iter().map(|row| row["name"].as_str().unwrap()).collect();
    let kinematics =
        ["ik20_xarm7", "ik20_panda", "fk_xarm7", "fk_panda", "ik_at_q7_xarm7", "ik_at_q7_panda"];
    let paths = [
        "checks_8_panda",
        "bezier20x50",
        "obstacles_depth_image",
        "planner20_depth_image",
        "timing_50",
    ];
    assert_eq!(names, [&kinematics[..], &paths].concat());
    for row in rows {
        assert_eq!(row["threads"], 1);
        assert!(row["runs"].as_u64() >= Some(5) && row["min_ms"].as_f64() > Some(0.0), "{row}");
        assert!(row["min_ms"].as_f64() <= row["median_ms"].as_f64(), "{row}");
    }
    assert!(
        refusal(&["bench", "coffee"], 2)
            .contains("networks, simulation, resets, planning, candidates")
    );
    assert!(refusal(&["bench", "planning", "--threads", "0"], 2).contains("1..=1024"));
}
