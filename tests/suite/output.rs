//! Standard output and disks that take nothing more.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{self, Folder, command, last_line_of_failure, text};
use crate::runs::{self, ORACLE, Outcome, Runs};
use serde_json::json;
use std::fs::{self, OpenOptions};
use std::path::Path;
use std::process::{Command, Stdio};

/// Commands that print something, with the files that they read.
fn printing_commands(folder: &Folder) -> Vec<Vec<String>> {
    let configs =
        folder.write("configs.json", json!({"configs": vec![[0.0; 7]; 2000]}).to_string());
    let poses = json!({"position": [0.3, 0.0, 0.3], "rotation_xyzw": [1, 0, 0, 0]});
    let poses = folder.write("poses.json", json!({"poses": [poses]}).to_string());
    let commands = [
        vec![],
        vec!["--help"],
        vec!["tasks"],
        vec!["robots", "--json"],
        vec!["fk", "--configs", &configs],
        vec!["fk", "--configs", &configs, "--json"],
        vec!["ik", "--poses", &poses],
        vec!["demo", "reach_target", "--episodes", "1"],
        vec!["paths", "reach_target", "--json"],
        vec!["eval", "reach_target", "--oracle-poses", "--method", "linear", "--episodes", "1"],
    ];
    commands.map(|command| command.into_iter().map(str::to_owned).collect()).into()
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let folder = Folder::new();
    for arguments in printing_commands(&folder) {
        let mut child =
            command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(
            (output.status.code(), text(&output.stderr).as_str()),
            (Some(0), ""),
            "{arguments:?}"
        );
    }
}

#[test]
fn an_output_that_is_full_is_a_failure_that_is_told() {
    let folder = Folder::new();
    for arguments in printing_commands(&folder) {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = command(&arguments).stdout(full).output().unwrap();
        let error = last_line_of_failure(&command(&arguments), &output, 1, 1);
        assert!(error.starts_with("cannot write to standard output: "), "{arguments:?}: {error}");
    }
}

#[test]
fn without_standard_error_the_status_still_tells() {
    let mut command = command(&["fk", "--configs", "no/such/file.json"]);
    let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
    assert_eq!(command.stderr(full).status().unwrap().code(), Some(1));
}

/// The command with a disk on which no file grows over `n_blocks` of 512 bytes: the limit of the
/// process stands for one of the disk, which only root may make.
fn with_small_disk(n_blocks: u64, arguments: &[impl AsRef<str>]) -> Command {
    let mut shell = Command::new("sh");
    // Without the trap, the process would be killed instead of being told.
    let script = format!("trap '' XFSZ; ulimit -f {n_blocks} && exec \"$0\" \"$@\"");
    shell.arg("-c").arg(script).arg(lpr::binary()).args(arguments.iter().map(AsRef::as_ref));
    shell
}

#[test]
fn a_full_disk_leaves_nothing_half_written() {
    let folder = Folder::new();
    let out = |name: &str| folder.at(name);
    let (demos, picture, animation) = (out("demos"), out("a.png"), out("a.gif"));
    let commands = [
        vec!["demo", "reach_target", "--episodes", "2", "--out", &demos],
        vec!["render", "reach_target", "--out", &picture],
        vec!["render", "reach_target", "--demo", "--out", &animation],
    ];
    for arguments in commands {
        let mut command = with_small_disk(1, &arguments);
        let output = command.output().unwrap();
        let error = last_line_of_failure(&command, &output, 1, 1);
        assert!(error.contains("cannot write") && error.contains("File too large"), "{error}");
        assert!(error.contains(folder.path().to_str().unwrap()), "{error}");
        assert!(lpr::files_below(folder.path()).is_empty(), "{arguments:?}");
    }
    // The same commands on a disk that has room.
    lpr::json(&["demo", "reach_target", "--episodes", "2", "--out", &demos]);
    assert_eq!(fs::read_dir(demos).unwrap().count(), 2);
}

fn is_partial(path: &Path) -> bool {
    path.to_str().unwrap().contains(".partial")
}

#[test]
fn a_run_whose_disk_was_full_goes_on_when_there_is_room() {
    let runs = Runs::new();
    let whole = runs.train(ORACLE, "whole");
    let last = fs::metadata(runs::newest_checkpoint(&whole).join("state.bin")).unwrap().len();
    // No room for the first checkpoint, and for all but the last.
    for (n_blocks, some_were_saved) in [(8, false), (last / 512 - 1, true)] {
        let name = format!("run-{n_blocks}");
        let arguments = runs.arguments(ORACLE, &name);
        let run = runs.folder.path().join(&name);
        let mut command = with_small_disk(n_blocks, &arguments);
        let output = command.output().unwrap();
        let error = last_line_of_failure(&command, &output, 1, 14);
        assert!(
            error.starts_with(run.to_str().unwrap())
                && error.contains("cannot write: File too large"),
            "{error}"
        );
        assert!(!lpr::files_below(&run).keys().any(|path| is_partial(path)));
        assert!(!run.join("summary.json").exists());
        assert_eq!(
            !runs::checkpoints(&run).is_empty(),
            some_were_saved,
            "{n_blocks} blocks of {last} bytes"
        );
        if some_were_saved {
            lpr::json(&[&arguments[..], &["--resume".to_owned()]].concat());
            Outcome::of(&run).assert_same(&Outcome::of(&whole), &name);
        }
    }
}
