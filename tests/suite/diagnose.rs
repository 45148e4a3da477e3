//! Faults that are planted in agents, and how a diagnosis names them; `lpr diagnose` and
//! `lpr experiment` as a script sees them.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use crate::lpr::{command, json, refusal, table, text};
use crate::runs;
use lpr_core::agent::{Agent, Method, PoseSource};
use lpr_core::checkpoint::load_agent;
use lpr_core::config::Config;
use lpr_core::demo::DemoEpisode;
use lpr_core::diagnose::{
    Cause, Diagnosis, DiagnosisSettings, Paths, Poses, Reference, Subject, diagnose, references,
};
use lpr_core::evaluate::evaluate;
use lpr_core::nn::{Backend, NamedTensor};
use lpr_core::q_attention::HalfTurn;
use lpr_core::robot::XARM7;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::record_demo;
use lpr_core::sim::tasks::Task;
use lpr_core::train::{Run, Trainer, default_cameras, demonstration_scene};
use lpr_tests::workspace;
use serde_json::Value;
use std::fs;
use std::ops::Range;

const LID: &str = "take_lid_off_saucepan";
/// Scenes of a validation.
const SCENES: Range<u64> = 1000..1006;
const QUICK: DiagnosisSettings =
    DiagnosisSettings { best_of_all_scenes: 2, augmentations: 40, whole: false };

fn environment(task: &str) -> SimEnvironment {
    let config = Config::preset("fast").unwrap();
    let task = Task::by_name(task).unwrap();
    let mut environment =
        SimEnvironment::new(&task, &XARM7, SCENES.start, &["front"], &config.simulator).unwrap();
    environment.set_timing(config.timing);
    environment
}

/// The agent of the page, which takes the lid off in 96 of 100 scenes.
fn trained() -> Agent {
    let weights = workspace().join("www/public/weights").join(format!("{LID}.safetensors"));
    load_agent(&fs::read(weights).unwrap()).unwrap().agent
}

fn demonstrations(task: &str, n: u64) -> Vec<DemoEpisode> {
    let environment = environment(task);
    let settings = Config::preset("fast").unwrap().demos;
    let scenes = (0..n).map(|demo| demonstration_scene(0, demo));
    let record = |scene| record_demo(&environment, scene, &settings).unwrap()?.into_iter().next();
    scenes.filter_map(record).collect()
}

fn of_lid(agent: &Agent, settings: DiagnosisSettings) -> Diagnosis {
    let scenes = references(&environment(LID), SCENES).unwrap();
    assert_eq!(scenes.len(), 6, "the demonstrator succeeds");
    let subject = Subject { agent, demonstrations: &[], snapshots: &[(867, agent)], seed: 0 };
    diagnose(&subject, &scenes, settings).unwrap()
}

fn first_finding(diagnosis: &Diagnosis) -> &str {
    &diagnosis.findings.first().expect("a fault").text
}

/// Changes the tensor of that name in both networks of every depth.
fn change_attention(agent: &mut Agent, name: &str, change: impl Fn(&mut NamedTensor)) {
    let attention = agent.networks.q_attention.as_mut().expect("learned poses");
    let mut state = attention.state();
    let depths = state.depths.iter_mut();
    let tensors = depths.flat_map(|depth| depth.online.iter_mut().chain(&mut depth.target));
    let mut changed = 0;
    for tensor in tensors.filter(|tensor| tensor.name.ends_with(name)) {
        change(tensor);
        changed += 1;
    }
    assert_eq!(changed, 2, "{name} of the online and of the target network");
    attention.restore(&state).unwrap();
}

/// Gives each row of a tensor of `n` columns another order of its columns.
fn reorder(tensor: &mut NamedTensor, order: impl Fn(usize) -> usize) {
    let n = *tensor.shape.last().expect("a column");
    for row in tensor.values.chunks_mut(n) {
        let old = row.to_vec();
        row.iter_mut().enumerate().for_each(|(column, value)| *value = old[order(column)]);
    }
}

#[test]
fn a_diagnosis_is_of_the_episodes_that_an_evaluation_runs() {
    let agent = trained();
    let mut failed = Vec::new();
    evaluate(&agent, &mut environment(LID), SCENES, |episode| {
        failed.extend(episode.failure.map(|_| episode.scene_seed));
    })
    .unwrap();
    let found = of_lid(&agent, QUICK);
    let named: Vec<_> = found.failures.iter().map(|failure| failure.scene_seed).collect();
    assert_eq!(named, failed);
    assert_eq!(found.successes + failed.len(), found.scenes);
}

#[test]
fn a_wrong_gripper_is_named_first() {
    let mut agent = trained();
    for part in ["gripper.weight", "gripper.bias"] {
        change_attention(&mut agent, part, |tensor| reorder(tensor, |column| 1 - column));
    }
    let found = of_lid(&agent, QUICK);
    let first = first_finding(&found);
    assert!(first.contains("pose") && first.contains("gripper"), "{first}");
    assert!(found.poses.scenes.iter().all(|keyframe| keyframe.gripper == 0.0));
}

#[test]
fn a_shuffled_angle_is_named_first() {
    let mut agent = trained();
    for part in ["rotation.weight", "rotation.bias"] {
        // Three angles of the same number of coefficients: roll and yaw change places.
        change_attention(&mut agent, part, |tensor| {
            let n = *tensor.shape.last().expect("a column");
            reorder(tensor, |column| {
                let shift = 2 * n / 3;
                match column / (n / 3) {
                    0 => column + shift,
                    1 => column,
                    _ => column - shift,
                }
            });
        });
    }
    let found = of_lid(&agent, QUICK);
    let first = first_finding(&found);
    assert!(first.contains("pose") && first.contains("roll"), "{first}");
    assert!(found.poses.scenes.iter().all(|keyframe| keyframe.wrong.contains_key("roll")));
}

#[test]
fn a_ranker_with_reversed_sign_is_named_first() {
    let mut agent = trained();
    let ranker = agent.networks.ranker.as_mut().expect("a ranker");
    let mut state = ranker.state();
    for tensor in state.online.iter_mut().filter(|it| it.name.contains("head.layers.2")) {
        tensor.values.iter_mut().for_each(|value| *value = -*value);
    }
    ranker.restore(&state).unwrap();
    let found = of_lid(&agent, DiagnosisSettings { whole: true, ..QUICK });
    let first = first_finding(&found);
    assert!(first.contains("choice among paths"), "{first}");
    assert!(found.failures.iter().any(|failure| failure.cause == Cause::Choice));
    let ranking = &found.rankings[0];
    assert!(ranking.accuracy.unwrap() < 0.3 && ranking.regret.unwrap() > 0.3, "{ranking:?}");
    let rate = |poses, paths| {
        let rung = found.ladder.iter().find(|it| it.poses == poses && it.paths == paths);
        rung.unwrap().success_rate()
    };
    assert!(rate(Poses::Learned, Paths::BestOfAll) > rate(Poses::Learned, Paths::Ranker));
}

/// An agent that learned where to go in the scenes of `demonstrations` by heart.
fn by_heart(task: &str, demonstrations: &[DemoEpisode]) -> Trainer<SimEnvironment> {
    let mut config = Config::preset("fast").unwrap();
    for setting in [
        "training.demonstration_updates=220",
        "q_attention.yaw_range=0.0",
        "q_attention.crop_jitter=0.1",
    ] {
        config = config.with(setting).unwrap();
    }
    config.q_attention.shift_range = lpr_core::glamx::Vec3::ZERO;
    let run = Run {
        task: task.to_owned(),
        method: Method::C2fArm,
        poses: PoseSource::Learned,
        backend: Backend::Flex,
        seed: 0,
        cameras: default_cameras(),
    };
    let mut trainer = Trainer::new(config, run, environment(task)).unwrap();
    for demo in demonstrations {
        trainer.add_demonstration(demo).unwrap();
    }
    while trainer.demonstration_updates_left() > 0 {
        trainer.update().unwrap();
    }
    trainer
}

#[test]
fn a_keyframe_that_the_demonstrations_lack_is_named_first() {
    let whole = demonstrations(LID, 2);
    let mut lacking = whole.clone();
    // The grasp; the lift comes one step earlier.
    for demo in &mut lacking {
        let grasp = demo.steps.remove(1);
        demo.steps[1].observation = grasp.observation;
    }
    let trainer = by_heart(LID, &lacking);
    let scenes = |demo| references(&environment(LID), one(demonstration_scene(0, demo))).unwrap();
    let scenes: Vec<Reference> = (0..2).flat_map(scenes).collect();
    let agent = trainer.agent();
    let subject = Subject { agent, demonstrations: &whole, snapshots: &[], seed: 0 };
    let found = diagnose(&subject, &scenes, QUICK).unwrap();
    let first = first_finding(&found);
    assert!(first.contains("keyframe 1 is left out"), "{first}\n{:?}", found.poses.scenes);
}

fn one(seed: u64) -> Range<u64> {
    seed..seed + 1
}

/// True if an agent that follows `rule` is told that demonstrations of wine teach both grasps.
fn labels_of_wine_differ_by_half_a_turn(rule: HalfTurn) -> bool {
    const WINE: &str = "stack_wine";
    let demos = demonstrations(WINE, 3);
    let mut config = Config::preset("fast").unwrap();
    config.training.demonstrations = 3;
    config.q_attention.half_turn = rule;
    let run = Run {
        task: WINE.to_owned(),
        method: Method::C2fArm,
        poses: PoseSource::Learned,
        backend: Backend::Flex,
        seed: 0,
        cameras: default_cameras(),
    };
    let trainer = Trainer::new(config, run, environment(WINE)).unwrap();
    let agent = trainer.agent();
    let scenes = references(&environment(WINE), SCENES.start..SCENES.start + 1).unwrap();
    let subject = Subject { agent, demonstrations: &demos, snapshots: &[], seed: 0 };
    let found = diagnose(&subject, &scenes, QUICK).unwrap();
    found.findings.iter().any(|finding| finding.text.contains("half a turn"))
}

#[test]
fn the_labels_of_wine_are_named_as_half_a_turn_apart_unless_the_rule_mends_it() {
    assert!(labels_of_wine_differ_by_half_a_turn(HalfTurn::Nearest));
    assert!(!labels_of_wine_differ_by_half_a_turn(HalfTurn::Relative));
}

#[test]
fn a_run_that_diverges_names_network_update_and_batch_and_keeps_a_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let preset = folder.path().join("hot.toml");
    let changes = [("ranker.adam.learning_rate", "1e30"), ("training.demonstration_updates", "0")];
    fs::write(&preset, runs::preset(&changes)).unwrap();
    let run = folder.path().join("run");
    let [preset, out] = [&preset, &run].map(|path| path.to_str().unwrap());
    let words = ["train", "toilet_seat_up", "--oracle-poses", "--preset", preset, "--out", out];
    let output = command(&[&words[..], &["--env-steps", "40"]].concat()).output().unwrap();
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let last = stderr.lines().last().unwrap();
    let names = ["ranker: diverged in update", "batch of rows ["];
    assert!(last.starts_with("error: ") && names.iter().all(|name| last.contains(name)), "{last}");
    assert!(stderr.contains("the checkpoint of environment step 0 is good"), "{stderr}");
    let weights = run.join("checkpoints/00000000/weights.safetensors");
    load_agent(&fs::read(weights).unwrap()).unwrap();
}

/// A run directory of the page's agent.
fn run_of_the_page(folder: &std::path::Path) -> String {
    let run = folder.join("lid");
    let checkpoint = run.join("checkpoints/00000867");
    fs::create_dir_all(&checkpoint).unwrap();
    let weights = workspace().join("www/public/weights").join(format!("{LID}.safetensors"));
    fs::copy(weights, checkpoint.join("weights.safetensors")).unwrap();
    fs::write(checkpoint.join("state.bin"), "").unwrap();
    let scenes = [0, 1].map(|demo| demonstration_scene(0, demo));
    fs::write(run.join("config.toml"), format!("[run]\ndemonstrations = {scenes:?}\n")).unwrap();
    run.to_str().unwrap().to_owned()
}

#[test]
fn the_diagnosis_of_a_run_is_printed_and_written_whole() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_of_the_page(folder.path());
    let out = folder.path().join("diagnosis");
    let words = ["diagnose", &run, "--scenes", "3", "--best-of-all", "1", "--augmentations", "20"];
    let report = json(&[&words[..], &["--out", out.to_str().unwrap()]].concat());
    assert_eq!((&report["task"], &report["scenes"]), (&Value::from(LID), &Value::from(3)));
    assert_eq!(report["poses"]["scenes"].as_array().unwrap().len(), 3, "keyframes");
    assert_eq!(report["poses"]["demonstrations"][0]["cases"], 2);
    assert_eq!(report["labels"][0]["labels"], 40);
    assert_eq!(report["ladder"].as_array().unwrap().len(), 4 * 6, "poses by paths");
    let written: Value =
        serde_json::from_str(&fs::read_to_string(out.join("diagnosis.json")).unwrap()).unwrap();
    assert_eq!(written, report);
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    let pictures = fs::read_dir(&out).unwrap().filter(|entry| {
        entry.as_ref().unwrap().path().extension().is_some_and(|extension| extension == "png")
    });
    assert_eq!(page.matches("<img").count(), pictures.count());
    // Nothing is written over, and the message names it.
    let again = refusal(&[&words[..], &["--out", out.to_str().unwrap()]].concat(), 1);
    assert!(again.contains("is not empty"), "{again}");
}

#[test]
fn a_directory_that_is_no_run_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("nothing");
    let message = refusal(&["diagnose", missing.to_str().unwrap()], 1);
    assert!(message.contains("holds no checkpoint"), "{message}");
    let run = run_of_the_page(folder.path());
    fs::write(std::path::Path::new(&run).join("config.toml"), "[run]\n").unwrap();
    let message = refusal(&["diagnose", &run], 1);
    assert!(message.contains("config.toml") && message.contains("demonstrations"), "{message}");
}

#[test]
fn a_row_of_an_experiment_is_never_run_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("small.toml"), runs::preset(&[])).unwrap();
    let (rows, trained, preset) = (path("rows"), path("runs"), path("small.toml"));
    let words = ["experiment", "baseline", "--out", &rows, "--runs", &trained];
    let options = ["--tasks", "reach_target", "--env-steps", "4", "--scenes", "1"];
    let words = [&words[..], &options, &["--preset", &preset]].concat();
    let report = json(&words);
    let row = &report["rows"][0];
    assert_eq!((&row["task"], &row["env_steps"]), (&"reach_target".into(), &4.into()));
    assert_eq!(row["training"]["stopped_by"], "env_steps");
    assert_eq!(row["diagnosis"]["scenes"], 1);

    // Without --resume nothing is touched; with it the row is read, not run.
    assert!(refusal(&words, 1).contains("is not empty"));
    fs::remove_dir_all(&trained).unwrap();
    let again = json(&[&words[..], &["--resume"]].concat());
    assert_eq!(again["rows"], report["rows"]);
    assert!(!std::path::Path::new(&trained).exists(), "nothing was trained");

    // The page takes them between its marks.
    fs::write(path("page.md"), "# Page\n<!-- begin rows -->\nold\n<!-- end rows -->\nend\n")
        .unwrap();
    json(&["experiment", "report", &rows, "--page", &path("page.md")]);
    let page = fs::read_to_string(path("page.md")).unwrap();
    assert!(
        page.contains("| `reach_target`, small, 2 demonstrations | 0 | 4 |")
            && page.ends_with("<!-- end rows -->\nend\n")
    );
    assert!(!page.contains("old"));
    fs::write(path("page.md"), "# Page\n").unwrap();
    let message = refusal(&["experiment", "report", &rows, "--page", &path("page.md")], 1);
    assert!(message.contains("<!-- begin rows -->"), "{message}");
}

#[test]
fn an_experiment_compares_methods_in_the_same_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("small.toml"), runs::preset(&[])).unwrap();
    let (rows, trained, preset) = (path("rows"), path("runs"), path("small.toml"));
    let words = ["experiment", "set2-oracle", "--out", &rows, "--runs", &trained];
    let options = ["--tasks", "open_drawer", "--env-steps", "4", "--scenes", "1"];
    let words = [&words[..], &options, &["--preset", &preset, "--seeds", "3,4"]].concat();
    let report = json(&[&words[..], &["--methods", "lpr,linear,random"]].concat());
    // The methods without weights once, not for each seed.
    let methods: Vec<_> = report["rows"].as_array().unwrap().iter().collect();
    let named = |method: &str| methods.iter().filter(|row| row["method"] == method).count();
    assert_eq!((named("lpr"), named("linear"), named("random")), (2, 1, 1));
    let of = |method: &str| *methods.iter().find(|row| row["method"] == method).unwrap();
    assert_eq!(of("lpr")["poses"], "oracle");
    assert!(of("linear")["training"].is_null() && of("linear")["diagnosis"].is_null());
    // Every failed scene is told, so that methods can be compared scene by scene.
    let failed = of("random")["evaluation"]["failed_scenes"].as_array().unwrap();
    assert_eq!(
        100 - failed.len(),
        of("random")["evaluation"]["successes"].as_u64().unwrap() as usize
    );
    assert!(failed.iter().all(|scene| (5000..5100).contains(&scene.as_u64().unwrap())));

    // A drawer opens along a straight line.
    let page = table(&["experiment", "report", &rows]);
    assert!(page.contains("| mean of tasks |"), "{page}");
    let line =
        "small, 2 demonstrations, true poses against linear, true poses, in the same scenes:";
    assert!(page.contains(line), "{page}");

    // The same run twice is no second seed.
    let one = fs::read_dir(&rows).unwrap().next().unwrap().unwrap().path();
    let copy = one.with_file_name("copy.json");
    fs::copy(&one, &copy).unwrap();
    let twice = refusal(&["experiment", "report", &rows], 1);
    assert!(twice.contains("holds two rows of `open_drawer`"), "{twice}");
    fs::remove_file(copy).unwrap();

    let unknown = refusal(&[&words[..], &["--resume", "--methods", "magic"]].concat(), 2);
    assert!(unknown.contains("magic") && unknown.contains("best-of-all"), "{unknown}");
    let images = ["experiment", "set1", "--out", &path("other"), "--methods", "random"];
    let untrainable = refusal(&[&images[..], &["--runs", &path("no")]].concat(), 2);
    assert!(untrainable.contains("nothing to train"), "{untrainable}");
}
