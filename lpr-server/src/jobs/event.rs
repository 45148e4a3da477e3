//! One event of a job's history, and how it is written.

use super::job::JobId;
use super::store_error::Result;
use sqlx::{SqliteConnection, query};

/// Kind of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum EventKind {
    /// The job came to a state.
    State,
    /// A log point of the run.
    Metric,
    /// The run went back to a checkpoint: later points are void.
    Rewind,
    /// Nothing more happens to the job.
    End,
}

impl EventKind {
    /// Its name in streams and in the database.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Something that happened to a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// Its number, which grows with time.
    pub seq: i64,
    /// Its kind, by the name of an [`EventKind`].
    pub kind: String,
    /// A JSON object.
    pub data: String,
}

/// A line of `metrics.jsonl`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Point {
    pub(super) env_steps: u64,
    pub(super) line: String,
}

/// Appends an event to the history.
pub(super) async fn insert_event(
    tx: &mut SqliteConnection,
    id: JobId,
    kind: EventKind,
    env_steps: Option<u64>,
    data: &str,
) -> Result<()> {
    let insert = query("INSERT INTO events (job, kind, env_steps, data) VALUES (?, ?, ?, ?)");
    let insert = insert
        .bind(id.to_string())
        .bind(kind.name())
        .bind(env_steps.map(u64::cast_signed))
        .bind(data);
    insert.execute(tx).await?;
    Ok(())
}
