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
        writeln!(
            f,
            "{:<36} {:>5} {:>9} {:>10}  description of variation 0",
            "task", "set", "keyframes", "variations"
        )?;
        for TaskRow { name, set, description, keyframes, variations } in &self.0.tasks {
            let n_variations = variations.len().max(1);
            writeln!(f, "{name:<36} {set:>5} {keyframes:>9} {n_variations:>10}  {description}")?;
        }
        Ok(())
    }
}
