//! `lpr xarm` and the vendor's own SDK, unmodified, on the emulated controller.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, command, json, refusal, text};
use crate::runs::{Kind, Runs};
use lpr_core::path::JointPath;
use lpr_core::robot::{DOF, JointConfig, XARM7};
use lpr_tests::workspace;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// Registers that ask and change nothing: version, state, errors, pose and joints.
const HARMLESS: [u64; 5] = [1, 13, 15, 41, 42];
const SET_STATE: u64 = 12;
const SERVO: u64 = 29;
/// Options for a busy machine: its delays are no faults here.
const PATIENT: [&str; 4] = ["--reply-timeout", "5", "--report-timeout", "5"];
/// A run whose paths are the demonstrator's to choose, so that they lead somewhere after seconds of
/// training.
const RUN: Kind = Kind { task: "reach_target", options: &["--oracle-poses"] };
const SCENE: [&str; 2] = ["--seed", "2"];

/// `lpr xarm emulate`, ended with the test.
struct Emulated {
    child: Child,
    /// Commands, stop, then fast, normal, rich and real-time reports.
    ports: [String; 6],
    log: PathBuf,
    _stdout: BufReader<ChildStdout>,
}

impl Drop for Emulated {
    fn drop(&mut self) {
        // One that has ended already needs no killing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Emulated {
    fn start(folder: &Folder, options: &[&str]) -> Self {
        let log = folder.path().join("received.jsonl");
        let mut emulate = command(&[
            "xarm",
            "emulate",
            "--command-port",
            "0",
            "--report-ports",
            "0,0,0,0",
            "--json",
            "--log",
        ]);
        let mut child = emulate.arg(&log).args(options).stdout(Stdio::piped()).spawn().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let listening: Value = serde_json::from_str(&line(&mut stdout)).unwrap();
        let reports = listening["report_ports"].as_array().unwrap();
        let [fast, normal, rich, realtime] = [0, 1, 2, 3].map(|idx| &reports[idx]);
        let ports =
            [&listening["command_port"], &listening["stop_port"], fast, normal, rich, realtime];
        Self { child, ports: ports.map(Value::to_string), log, _stdout: stdout }
    }

    /// The arguments of `lpr xarm run` on it.
    fn run<'a>(&'a self, run: &'a str, options: &[&'a str]) -> Vec<&'a str> {
        let [command, stop, .., realtime] = &self.ports;
        let fixed = [
            "xarm",
            "run",
            run,
            "--host",
            "127.0.0.1",
            "--command-port",
            command,
            "--stop-port",
            stop,
        ];
        [&fixed[..], &["--report-port", realtime], &SCENE, &PATIENT, options].concat()
    }

    /// Register, port and parameters of everything that it received.
    fn received(&self) -> Vec<Value> {
        fs::read_to_string(&self.log)
            .unwrap()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    fn registers(&self) -> BTreeSet<u64> {
        self.received().iter().map(|received| received["register"].as_u64().unwrap()).collect()
    }

    fn n_points(&self) -> usize {
        self.received().iter().filter(|received| received["register"] == SERVO).count()
    }
}

/// The next line of a program; a program that ended is a failure.
#[track_caller]
fn line(output: &mut impl BufRead) -> String {
    let mut line = String::new();
    assert!(output.read_line(&mut line).unwrap() > 0, "the program ended");
    line
}

/// A script of `tests/sdk` on the Python that `make tools` sets up.
fn script(name: &str, emulated: &Emulated) -> Command {
    let python = workspace().join("tests/.venv/bin/python");
    assert!(python.exists(), "{} is missing: run `make tools`", python.display());
    let mut command = Command::new(python);
    command.arg("-B").arg(workspace().join("tests/sdk").join(name)).args(&emulated.ports);
    command
}

/// The JSON that a script printed.
#[track_caller]
fn found(output: &std::process::Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn floats(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap_or_else(|| panic!("{value}"))
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect()
}

fn config(value: &Value) -> JointConfig {
    let angles: Vec<f32> = floats(value).into_iter().map(|angle| angle as f32).collect();
    JointConfig::new::<7>(angles.try_into().unwrap_or_else(|angles| panic!("{angles:?}")))
}

#[track_caller]
fn assert_near(found: &Value, expected: &[f64], tolerance: f64) {
    let numbers = floats(found);
    assert_eq!(numbers.len(), expected.len(), "{found}");
    for (number, expected) in numbers.iter().zip(expected) {
        assert!((number - expected).abs() <= tolerance, "{found}: expected {expected}");
    }
}

#[test]
fn the_vendors_sdk_drives_the_emulated_arm() {
    let folder = Folder::new();
    let emulated = Emulated::start(&folder, &[]);
    let found = found(&script("drive.py", &emulated).output().unwrap());
    let is = |key: &str, value: Value| assert_eq!(found[key], value, "{key}: {found:#}");
    let near = |key: &str, expected: &Value, tolerance| {
        assert_eq!(found[key][0], 0, "{key}: {found:#}");
        assert_near(&found[key][1], &floats(expected), tolerance);
    };
    is("version", "7,7,XI1304,AC1304,v2.5.0".into());
    is("axis", DOF.into());
    let done = Value::from(vec![0; 3]);
    for ready in ["ready", "servo_mode", "position_mode"] {
        is(ready, done.clone());
    }
    // Moves of the queue.
    for code in ["move", "line", "back", "long_move", "home"] {
        is(code, 0.into());
    }
    near("angles", &found["target"], 1e-4);
    near("home_angles", &found["target"], 1e-4);
    near("inverse", &found["target"], 1e-3);
    // The SDK's units: millimetres.
    near("kinematics", &found["position"][1], 1e-2);
    near(
        "home_pose",
        &serde_json::json!([206.0, 0.0, 120.5, core::f64::consts::PI, 0.0, 0.0]),
        1e-3,
    );
    assert_near(&found["joint_states"][1][0], &floats(&found["target"]), 1e-4);
    assert_near(
        &Value::from(found["line_end"][1].as_array().unwrap()[..3].to_vec()),
        &floats(&found["line_goal"]),
        0.1,
    );
    // The servo stream.
    is("servo", vec![0; 51].into());
    is("servo_arrived", true.into());
    near("servo_angles", &found["stream_end"], 1e-4);
    // The gripper: asked for, code, code, position.
    is("gripper_setup", done);
    is("gripper", serde_json::json!([[850, 0, 0, 850], [0, 0, 0, 0], [600, 0, 0, 600]]));
    // The emergency stop; moving then is refused because the state is not ready, until it is made
    // so.
    for key in ["was_moving", "stopped_short", "stayed_stopped"] {
        is(key, true.into());
    }
    is("stopped_state", vec![0, 4].into());
    is("commands_left", vec![0, 0].into());
    is("refused_after_stop", 9.into());
    is("recovered", vec![0; 5].into());
    is("codes", serde_json::json!([0, [0, 0]]));
    // Reports, as the SDK's clients and its parser read them.
    for key in ["rich_report", "realtime_report"] {
        is(key, true.into());
    }
    for key in ["rich_position", "realtime_position"] {
        assert_near(&found[key], &floats(&found["position"][1]), 1e-2);
    }
    is("connected", vec![true, true].into());
    for (port, bytes) in [("30000", 804), ("30001", 145), ("30002", 587), ("30003", 135)] {
        let report = &found["reports"][port];
        assert_eq!(
            (&report["bytes"], &report["data_size"]),
            (&bytes.into(), &bytes.into()),
            "{port}: {report}"
        );
        assert_eq!((&report["state"], &report["mode"]), (&2.into(), &0.into()), "{port}: {report}");
        assert_near(&report["angles"], &floats(&found["target"]), 1e-4);
        assert_near(&report["position"], &floats(&found["position"][1])[..3], 1e-2);
    }
}

#[test]
fn without_execute_nothing_is_sent_that_enables_or_moves() {
    let runs = Runs::new();
    let run = runs.train(RUN, "run");
    let emulated = Emulated::start(&runs.folder, &[]);
    let report = json(&emulated.run(run.to_str().unwrap(), &[]));
    assert_eq!(report["executed"], false, "{report:#}");
    assert_eq!(report["execution"], Value::Null);
    assert!(
        report["n_candidates"].as_u64().unwrap() > 0 && report["value"].is_number(),
        "{report:#}"
    );
    assert_near(&report["path"][0], &XARM7.start.to_array::<7>().map(f64::from), 1e-6);
    let registers = emulated.registers();
    assert!(registers.iter().all(|register| HARMLESS.contains(register)), "{registers:?}");
}

#[test]
fn the_vendors_sdk_sees_the_arm_follow_the_chosen_path() {
    let runs = Runs::new();
    let run = runs.train(RUN, "run");
    let emulated = Emulated::start(&runs.folder, &[]);
    let mut observer = script("observe.py", &emulated);
    let mut observer = observer.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut output = BufReader::new(observer.stdout.take().unwrap());
    assert_eq!(line(&mut output), "begun\n");
    let report = json(&emulated.run(run.to_str().unwrap(), &["--execute", "--speed", "1.0"]));
    drop(observer.stdin.take());
    let seen: Value = serde_json::from_str(&line(&mut output)).unwrap();
    assert!(observer.wait().unwrap().success());

    assert_eq!(report["executed"], true, "{report:#}");
    assert_eq!(report["execution"]["points_sent"], report["n_points"]);
    assert_eq!(emulated.n_points(), report["n_points"].as_u64().unwrap() as usize);
    let path =
        JointPath::new(report["path"].as_array().unwrap().iter().map(config).collect()).unwrap();
    assert_near(&seen["final"][1], &path.goal().to_array::<DOF>().map(f64::from), 1e-4);
    assert_eq!((&seen["mode"], &seen["codes"]), (&Value::from(0), &serde_json::json!([0, [0, 0]])));
    let states = seen["states"].as_array().unwrap();
    assert!(states.contains(&1.into()), "it was never seen moving: {states:?}");
    assert_on_path(&path, &seen["asked"]);
    assert_on_path(&path, &seen["reported"]);
}

/// Fails when a configuration that was seen is farther from the path than the arm moves in a tick,
/// or few were seen on the way.
#[track_caller]
fn assert_on_path(path: &JointPath, seen: &Value) {
    /// At 1 rad/s and 100 Hz.
    const TICK_MOTION: f32 = 0.01;
    let mut on_the_way = 0;
    for sample in seen.as_array().unwrap() {
        let sample = config(sample);
        let distance = path
            .configs()
            .windows(2)
            .map(|pair| distance(&pair[0], &pair[1], &sample))
            .fold(f32::INFINITY, f32::min);
        assert!(distance <= TICK_MOTION, "{sample:?} is {distance} rad from the path");
        on_the_way +=
            usize::from(sample.distance(path.start()) > 0.1 && sample.distance(path.goal()) > 0.1);
    }
    assert!(on_the_way > 5, "only {on_the_way} samples on the way");
}

/// From `point` to the straight piece from `a` to `b`, radians.
fn distance(a: &JointConfig, b: &JointConfig, point: &JointConfig) -> f32 {
    let dot = |of: &dyn Fn(usize) -> (f32, f32)| (0..DOF).map(|j| of(j).0 * of(j).1).sum::<f32>();
    let length = dot(&|j| (b[j] - a[j], b[j] - a[j]));
    let along = dot(&|j| (point[j] - a[j], b[j] - a[j]));
    let fraction = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
    a.lerp(b, fraction).distance(point)
}

#[test]
#[cfg(unix)]
fn an_interrupt_during_the_stream_stops_the_arm() {
    let runs = Runs::new();
    let run = runs.train(RUN, "run");
    let emulated = Emulated::start(&runs.folder, &[]);
    let mut moving = command(&emulated.run(run.to_str().unwrap(), &["--execute"]));
    let moving = moving.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while emulated.n_points() < 20 {
        std::thread::sleep(core::time::Duration::from_millis(5));
    }
    let interrupt =
        Command::new("sh").arg("-c").arg(format!("kill -INT {}", moving.id())).status().unwrap();
    assert!(interrupt.success());
    let output = moving.wait_with_output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(
        error.starts_with("error: interrupted; after ")
            && error.ends_with("the arm was told to stop\n"),
        "{error}"
    );
    let received = emulated.received();
    let is_stop = |received: &Value| {
        received["port"] == "stop"
            && received["register"] == SET_STATE
            && received["params"] == "04"
    };
    let stop = received.iter().position(is_stop).unwrap();
    assert!(
        received[stop..].iter().all(|received| received["register"] != SERVO),
        "a point after the stop"
    );
}

#[test]
fn a_fault_of_the_controller_is_one_line_that_says_what_became_of_the_arm() {
    let runs = Runs::new();
    let run = runs.train(RUN, "run");
    for (fault, says) in [
        (
            "error-31@30",
            "the controller has error 31: clear it where the arm can be seen; after 30 of ",
        ),
        ("vanish@30", "use the emergency button"),
    ] {
        let folder = Folder::new();
        let emulated = Emulated::start(&folder, &["--fault", fault]);
        let error = refusal(&emulated.run(run.to_str().unwrap(), &["--execute"]), 1);
        assert!(error.contains(says), "{fault}: {error}");
    }
}

/// The error of `lpr xarm run` about a run or a host that it cannot use.
fn refused(run: &Path, host: &str, status: i32) -> String {
    refusal(
        &[
            "xarm",
            "run",
            run.to_str().unwrap(),
            "--host",
            host,
            "--command-port",
            "1",
            "--report-port",
            "1",
        ],
        status,
    )
}

#[test]
fn a_host_that_may_be_a_real_arm_a_panda_and_nobody_are_refused() {
    let runs = Runs::new();
    let run = runs.train(RUN, "run");
    for host in ["10.0.0.2", "192.168.1.203", "::2"] {
        let error = refused(&run, host, 2);
        assert!(
            error.starts_with(&format!("--host {host}: ")) && error.contains("--arm-real"),
            "{error}"
        );
    }
    let error = refused(&run, "127.0.0.1", 1);
    assert!(
        error.starts_with("cannot connect to the controller's commands at 127.0.0.1:1"),
        "{error}"
    );
    let panda = Kind { task: "reach_target", options: &["--oracle-poses", "--robot", "panda"] };
    let panda = runs.train(panda, "panda");
    let error = refused(&panda, "127.0.0.1", 1);
    assert!(error.ends_with("is a run of robot `panda`, the arm is an xarm7"), "{error}");
    let error = refused(runs.folder.path(), "127.0.0.1", 1);
    assert!(error.contains("holds no checkpoint"), "{error}");
}

#[test]
fn options_that_cannot_work_are_named() {
    for (arguments, says) in [
        (vec!["emulate", "--firmware", "new"], "--firmware"),
        (vec!["emulate", "--report-ports", "1,2"], "--report-ports"),
        (vec!["emulate", "--start", "0,0,0"], "expected 7 angles"),
        (vec!["emulate", "--start", "9,0,0,0,0,0,0"], "outside the joint limits"),
        (vec!["emulate", "--fault", "fire"], "--fault"),
        (vec!["run", "run"], "--host"),
        (vec!["run", "run", "--host", "arm.local"], "--host"),
        (
            vec!["run", "run", "--host", "127.0.0.1", "--speed", "9"],
            "--speed 9: expected rad/s above 0, at most 1.047",
        ),
        (vec!["run", "run", "--host", "127.0.0.1", "--speed", "nan"], "--speed NaN"),
        (vec!["run", "run", "--host", "127.0.0.1", "--rate", "1000"], "--rate"),
        (vec!["run", "run", "--host", "127.0.0.1", "--reply-timeout", "0"], "--reply-timeout"),
    ] {
        let error = refusal(&[&["xarm"], &arguments[..]].concat(), 2);
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
}
