//! The part that tests share: where the workspace is, which files belong to it, and mistakes in
//! files for tests of parsers, few or many.
//!
//! No crate of the workspace is below this one, so that the unit tests of each may use it.

mod fuzz;
mod mistake;

pub use fuzz::{few_or_many, in_time};
pub use mistake::{Mistake, mistake};

use std::path::{Path, PathBuf};
use std::process::Command;

/// The root of the workspace.
///
/// # Panics
///
/// When this package has been moved out of it.
#[must_use]
pub fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("this package is a folder of the workspace")
}

/// The files of the project relative to [`workspace`], sorted: those git tracks or would track.
///
/// # Panics
///
/// When git is missing or this is no checkout.
#[must_use]
pub fn project_files() -> Vec<PathBuf> {
    let listed =
        output_of("git", &["ls-files", "-z", "--cached", "--others", "--exclude-standard"]);
    let mut files: Vec<_> = listed.split_terminator('\0').map(PathBuf::from).collect();
    files.retain(|file| workspace().join(file).is_file());
    files.sort();
    files
}

/// Standard output of `program` when run at the root of the workspace.
///
/// # Panics
///
/// When it cannot be run or fails.
#[must_use]
pub fn output_of(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(workspace())
        .output()
        .expect("the program is installed");
    assert!(
        output.status.success(),
        "{program} {arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("programs print UTF-8")
}
