//! Runs that are killed and resumed end as if nothing had happened, and so do runs with another
//! number of threads.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{self, Folder, command};
use crate::runs::{self, Kind, LEARNED, ORACLE, Outcome, Runs};
use lpr_core::rng::{Rng, Stream, stream};
use rand::RngExt as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Kills of one run; `make faults` asks for more.
fn n_kills() -> usize {
    const FEW: usize = 4;
    std::env::var("LPR_KILLS").map_or(FEW, |kills| kills.parse().unwrap())
}

/// State of a run when it was killed.
#[derive(Debug, PartialEq, Eq)]
enum Killed {
    /// While it wrote a checkpoint.
    InsideWrite,
    Elsewhere,
    /// It had ended before.
    Never,
}

/// Kills the run once: at odd turns while it writes one of the next checkpoints, else within
/// `longest`.
fn kill(mut child: Child, run: &Path, turn: usize, longest: Duration, rng: &mut Rng) -> Killed {
    if turn % 2 == 1 {
        wait_for_partial(&mut child, run, rng.random_range(1..4));
    } else {
        sleep(longest.mul_f64(rng.random()));
    }
    // Of a process that ended, too, until it is waited for.
    child.kill().unwrap();
    if child.wait().unwrap().code().is_some() {
        Killed::Never
    } else if has_partial(run) {
        Killed::InsideWrite
    } else {
        Killed::Elsewhere
    }
}

/// Waits until checkpoint number `n` from now on is being written, or the process has ended.
fn wait_for_partial(child: &mut Child, run: &Path, n: usize) {
    let mut seen = 0;
    let mut inside = has_partial(run);
    while seen < n && child.try_wait().unwrap().is_none() {
        let now = has_partial(run);
        seen += usize::from(now && !inside);
        inside = now;
        // Short beside the write of a file to disk.
        sleep(Duration::from_micros(100));
    }
}

fn has_partial(run: &Path) -> bool {
    let Ok(entries) = fs::read_dir(run.join("checkpoints")) else { return false };
    entries
        .filter_map(Result::ok)
        .any(|entry| entry.file_name().to_str().unwrap().ends_with(".partial"))
}

/// Starts or resumes a run; one that was killed before its first checkpoint starts anew.
fn start(arguments: &[String], run: &Path) -> Child {
    let resumed = [arguments, &["--resume".to_owned()]].concat();
    let mut command = if !run.exists() {
        command(arguments)
    } else if runs::checkpoints(run).is_empty() {
        let error = lpr::refusal(&resumed, 1);
        assert!(error.contains("holds no checkpoint"), "{error}");
        fs::remove_dir_all(run).unwrap();
        command(arguments)
    } else {
        command(&resumed)
    };
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Kills a run again and again, resumes it, and compares what it leaves with what an uninterrupted
/// one does.
fn assert_kills_change_nothing(kind: Kind) {
    let runs = Runs::new();
    let started = Instant::now();
    let whole = Outcome::of(&runs.train(kind, "whole"));
    // Long enough for a resumed run to get on, short enough for many kills.
    let longest = started.elapsed() / 4;
    let (mut n_inside, mut n_elsewhere) = (0, 0);
    let mut trial = 0;
    while n_inside + n_elsewhere < n_kills() {
        let run = runs.folder.path().join(format!("killed-{trial}"));
        let arguments = runs.arguments(kind, &format!("killed-{trial}"));
        let rng = &mut stream(trial, Stream::Noise, 0);
        // A few kills of every run: each run ends for good.
        for turn in 0..4 {
            match kill(start(&arguments, &run), &run, turn, longest, rng) {
                Killed::InsideWrite => n_inside += 1,
                Killed::Elsewhere => n_elsewhere += 1,
                Killed::Never => break,
            }
        }
        assert!(start(&arguments, &run).wait().unwrap().success(), "trial {trial}");
        let what = format!(
            "trial {trial} after {n_inside} kills inside a write and {n_elsewhere} elsewhere"
        );
        Outcome::of(&run).assert_same(&whole, &what);
        assert!(!has_partial(&run), "{what}: something was left behind");
        trial += 1;
    }
    let counts = format!(
        "{trial} runs, {n_inside} kills inside a checkpoint's write, {n_elsewhere} elsewhere"
    );
    // For people who run `make faults`; nobody may be listening.
    let _ = writeln!(io::stderr(), "{kind:?}: {counts}");
}

#[test]
fn learns_the_same_when_killed_with_the_demonstrators_poses() {
    assert_kills_change_nothing(ORACLE);
}

#[test]
fn learns_the_same_when_killed_with_learned_poses() {
    assert_kills_change_nothing(LEARNED);
}

#[test]
fn demonstrations_are_whole_or_absent_when_the_command_is_killed() {
    let folder = Folder::new();
    let whole = folder.at("whole");
    let started = Instant::now();
    let demo = |out: &str| command(&["demo", "reach_target", "--episodes", "20", "--out", out]);
    assert!(demo(&whole).output().unwrap().status.success());
    let duration = started.elapsed();
    let rng = &mut stream(1, Stream::Noise, 1);
    for trial in 0..8 {
        let out = folder.at(&format!("killed-{trial}"));
        let mut child = demo(&out).stdout(Stdio::null()).spawn().unwrap();
        sleep(duration.mul_f64(rng.random()));
        child.kill().unwrap();
        child.wait().unwrap();
        let n_files = |out: &str| fs::read_dir(out).map_or(0, Iterator::count);
        assert!(
            !Path::new(&out).exists() || n_files(&out) == n_files(&whole),
            "{} files",
            n_files(&out)
        );
    }
}

#[test]
fn a_checkpoint_that_was_being_written_is_neither_read_nor_kept() {
    let runs = Runs::new();
    let whole = runs.train(ORACLE, "whole");
    let expected = Outcome::of(&whole);
    // What a kill inside the write of the last checkpoint leaves: nothing after the one before it
    // is on disk for certain.
    let last = runs::newest_checkpoint(&whole);
    let partial = whole.join("checkpoints/.Zx81aa.partial");
    fs::rename(&last, &partial).unwrap();
    let state = fs::read(partial.join("state.bin")).unwrap();
    fs::write(partial.join("state.bin"), &state[..state.len() / 2]).unwrap();
    fs::write(whole.join(".summary.partial"), "{").unwrap();
    fs::remove_file(whole.join("summary.json")).unwrap();
    lpr::json(&[&runs.arguments(ORACLE, "whole")[..], &["--resume".to_owned()]].concat());
    Outcome::of(&whole).assert_same(&expected, "after a torn checkpoint");
    assert!(!has_partial(&whole) && !whole.join(".summary.partial").exists());
}

#[test]
fn a_run_that_goes_on_is_one_that_was_longer_from_the_start() {
    let runs = Runs::new();
    let whole = Outcome::of(&runs.train(ORACLE, "whole"));
    let arguments = runs.arguments(ORACLE, "grown");
    let steps = arguments.iter().position(|argument| argument == runs::STEPS).unwrap();
    // One that ends between two validations, and one with one.
    for n in ["5", "8", runs::STEPS] {
        let mut shorter = arguments.clone();
        shorter[steps] = n.to_owned();
        shorter.extend((n != "5").then(|| "--resume".to_owned()));
        lpr::json(&shorter);
    }
    Outcome::of(&runs.folder.path().join("grown")).assert_same(&whole, "in three parts");
}

#[test]
fn the_same_seed_gives_the_same_run_with_any_number_of_threads() {
    for kind in [ORACLE, LEARNED] {
        let runs = Runs::new();
        let outcome = |threads: &str, name: &str| {
            let mut command = command(&runs.arguments(kind, name));
            assert!(command.env("RAYON_NUM_THREADS", threads).output().unwrap().status.success());
            Outcome::of(&runs.folder.path().join(name))
        };
        let one = outcome("1", "one");
        outcome("2", "two").assert_same(&one, "two threads");
    }
}
