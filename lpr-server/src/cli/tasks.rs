//! `lpr tasks`: the tasks.

use crate::formats::{TaskList, TaskRow};
use core::fmt;
use serde::Serialize;

/// The tasks.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub(super) struct Report(TaskList);

pub(super) fn run() -> Report {
    Report(TaskList::all())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<22} {:>3} {:>9}  description", "task", "set", "keyframes")?;
        for TaskRow { name, set, description, keyframes } in &self.0.tasks {
            writeln!(f, "{name:<22} {set:>3} {keyframes:>9}  {description}")?;
        }
        Ok(())
    }
}
