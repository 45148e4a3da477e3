//! An interrupt of a run, which is then saved, and the command that continues it.

use crate::cli::failure::{Failure, Result};
use crate::signals::Signals;
use std::ffi::OsString;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Answer to the first signal; the step or the validation under way ends first.
const ANSWER: &str =
    "interrupted: the run ends as soon as it is saved, with a second interrupt at once";
/// The option that continues a run.
const RESUME: &str = "--resume";

/// A signal that asks the run to end in good order.
#[derive(Debug)]
pub(super) struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Waits for interrupts and terminations from now on.
    pub(super) fn of_signals() -> io::Result<Self> {
        Ok(Self(Signals::take()?.flag_then_exit(ANSWER)))
    }

    /// Leaves signals to the system: a worker kills its runs, and takes one that a signal ended for
    /// lost, not for failed.
    pub(super) fn never() -> Self {
        Self(Arc::default())
    }

    /// Holds once a signal has come.
    pub(super) fn has_come(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Fails once a signal has come.
    pub(super) fn check(&self) -> Result<()> {
        if self.has_come() { Err(Failure::Interrupted) } else { Ok(()) }
    }
}

/// The command line that continues the run which `arguments` started, as a shell reads it. The
/// first argument is the program.
pub(super) fn continuing_command(arguments: impl Iterator<Item = OsString>) -> String {
    let mut words: Vec<_> = arguments.map(|argument| quoted(&argument.to_string_lossy())).collect();
    if !words.iter().any(|word| word == RESUME) {
        words.push(RESUME.to_owned());
    }
    words.join(" ")
}

fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn continuing(words: &[&str]) -> String {
        continuing_command(words.iter().map(OsString::from))
    }

    #[test]
    fn a_run_is_continued_by_its_own_command() {
        let started = ["target/release/lpr", "train", "open_drawer", "--out", "run"];
        let continued = "target/release/lpr train open_drawer --out run --resume";
        assert_eq!(continuing(&started), continued);
        assert_eq!(continuing(&continued.split(' ').collect::<Vec<_>>()), continued);
    }

    #[test]
    fn a_shell_reads_the_same_words() {
        let words = ["a run", "it's", "", "$HOME", "*", "a\"b", "plain-1.0"];
        let line = continuing(&words);
        let shell = std::process::Command::new("sh")
            .args(["-c", &format!("printf '%s\\n' {line}")])
            .output()
            .expect("a shell");
        let read = String::from_utf8(shell.stdout).expect("text");
        let expected: Vec<_> = words.iter().chain(&[RESUME]).copied().collect();
        assert_eq!(read.lines().collect::<Vec<_>>(), expected);
    }
}
