//! `lpr tasks`: the tasks.

use core::fmt;
use lpr_core::sim::tasks::{TASKS, Task, TaskSet};
use serde::Serialize;

/// The tasks.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    tasks: Vec<TaskRow>,
}

#[derive(Debug, Serialize)]
struct TaskRow {
    name: &'static str,
    /// The paper's Task Set.
    set: &'static str,
    description: &'static str,
    /// Keyframes of a demonstration.
    keyframes: usize,
}

pub(super) fn run() -> Report {
    let row = |task: &'static Task| TaskRow {
        name: task.name,
        set: match task.set {
            TaskSet::One => "1",
            TaskSet::Two => "2",
        },
        description: task.description,
        keyframes: task.keyframes,
    };
    Report { tasks: TASKS.into_iter().map(row).collect() }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<22} {:>3} {:>9}  description", "task", "set", "keyframes")?;
        for TaskRow { name, set, description, keyframes } in &self.tasks {
            writeln!(f, "{name:<22} {set:>3} {keyframes:>9}  {description}")?;
        }
        Ok(())
    }
}
