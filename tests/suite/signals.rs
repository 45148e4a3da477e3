//! Runs that a signal ends in good order, and those that must end at once.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::command;
use crate::runs::{self, ORACLE, Outcome, Runs};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Exit status of an interrupted program.
const INTERRUPTED: i32 = 130;

fn start(arguments: &[String]) -> Child {
    command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn send(signal: &str, child: &Child) {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Waits until `is_there`, of a process that is to live as long.
fn wait_for(child: &mut Child, is_there: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_there() {
        assert!(child.try_wait().unwrap().is_none(), "the run ended too soon");
        assert!(started.elapsed() < Duration::from_secs(60), "the run does not get on");
        sleep(Duration::from_millis(1));
    }
}

fn n_points(run: &Path) -> usize {
    std::fs::read_to_string(run.join("metrics.jsonl")).map_or(0, |text| text.lines().count())
}

/// The command that an interrupted run prints last.
#[track_caller]
fn continuing_command(child: Child) -> String {
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(INTERRUPTED), "{stderr}");
    assert!(output.stdout.is_empty() && !stderr.contains("error"), "{stderr}");
    let last = stderr.lines().last().unwrap();
    last.strip_prefix("continue with: ").unwrap_or_else(|| panic!("{stderr}")).to_owned()
}

#[test]
fn learns_the_same_when_interrupted_and_continued_by_the_printed_command() {
    let runs = Runs::new();
    let whole = Outcome::of(&runs.train(ORACLE, "whole"));
    // During the updates on demonstrations or soon after, and between two validations.
    for (signal, least_points) in [("-TERM", 0), ("-INT", 6)] {
        let name = format!("stopped{signal}");
        let run = runs.folder.path().join(&name);
        let mut child = start(&runs.arguments(ORACLE, &name));
        wait_for(&mut child, || run.join("config.toml").exists() && n_points(&run) >= least_points);
        send(signal, &child);
        let continuing = continuing_command(child);
        assert!(!runs::checkpoints(&run).is_empty() && !run.join("summary.json").exists());
        let continued = Command::new("sh").args(["-c", &continuing]).output().unwrap();
        assert!(continued.status.success(), "{continuing}: {continued:?}");
        Outcome::of(&run).assert_same(&whole, &continuing);
    }
}

#[test]
fn a_second_interrupt_ends_a_run_at_once() {
    // A validation of minutes, which the first interrupt waits for.
    let changes =
        [("training.demonstration_updates", "0"), ("training.validation_episodes", "900")];
    let runs = Runs::with(&changes);
    let run = runs.folder.path().join("stopped");
    let mut child = start(&runs.arguments(ORACLE, "stopped"));
    wait_for(&mut child, || run.join("config.toml").exists());
    send("-INT", &child);
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("interrupted") {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "no answer to the interrupt");
    }
    send("-INT", &child);
    let sent = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(INTERRUPTED));
    assert!(sent.elapsed() < Duration::from_secs(5), "{:?}", sent.elapsed());
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert!(!rest.contains("continue with"), "{rest}");
}
