//! The real `lpr` binary, run as a script would.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A command of the binary that stands beside this test's directory: building the tests of the
/// workspace builds it, too.
pub(crate) fn command<S: AsRef<OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(binary());
    command.args(arguments);
    command
}

/// Path of the binary.
pub(crate) fn binary() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let binary =
        test.ancestors().nth(2).unwrap().join(format!("lpr{}", std::env::consts::EXE_SUFFIX));
    assert!(
        binary.is_file(),
        "{} is missing: build the whole workspace, not only this package",
        binary.display()
    );
    binary
}

/// The one JSON object that a successful command prints; its standard error is for people.
#[track_caller]
pub(crate) fn json<S: AsRef<OsStr>>(arguments: &[S]) -> Value {
    let output = command(arguments).arg("--json").output().unwrap();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{:?}: {stderr}", command(arguments));
    let value: Value = serde_json::from_str(&stdout).unwrap();
    assert!(value.is_object());
    value
}

/// [`json`] of a command that has nothing to tell people beside it.
#[track_caller]
pub(crate) fn silent_json(arguments: &[&str]) -> Value {
    let output = command(arguments).arg("--json").output().unwrap();
    assert_eq!(
        (output.status.code(), text(&output.stderr)),
        (Some(0), String::new()),
        "{arguments:?}"
    );
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(value.is_object());
    value
}

/// The table that a successful command prints.
#[track_caller]
pub(crate) fn table(arguments: &[&str]) -> String {
    let output = command(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The message of a command that must fail with exit status `status`, without `error: `.
#[track_caller]
pub(crate) fn refusal<S: AsRef<OsStr>>(arguments: &[S], status: i32) -> String {
    refusal_of(command(arguments), status)
}

/// [`refusal`] of a command that was prepared.
#[track_caller]
pub(crate) fn refusal_of(mut command: Command, status: i32) -> String {
    let output = command.output().unwrap();
    last_line_of_failure(&command, &output, status, 1)
}

/// The error of a command that may have told its progress before, in at most `most_lines`.
#[track_caller]
pub(crate) fn last_line_of_failure(
    command: &Command,
    output: &Output,
    status: i32,
    most_lines: usize,
) -> String {
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{command:?}: {stderr}");
    assert_eq!(text(&output.stdout), "", "{command:?}: {stderr}");
    assert!(stderr.lines().count() <= most_lines, "{command:?}: {stderr}");
    let line = stderr.lines().last().unwrap_or_default();
    line.strip_prefix("error: ").unwrap_or_else(|| panic!("{command:?}: {stderr}")).to_owned()
}

/// Bytes as text.
pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A directory for the files of one test.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    /// The path of `name` in it, as an argument.
    pub(crate) fn at(&self, name: &str) -> String {
        self.path().join(name).to_str().unwrap().to_owned()
    }

    /// The path of a new file.
    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.at(name);
        fs::write(&path, content).unwrap();
        path
    }
}

/// Every file below `directory` with its content.
pub(crate) fn files_below(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
            // Empty directories count, too.
            files.insert(path, Vec::new());
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}
