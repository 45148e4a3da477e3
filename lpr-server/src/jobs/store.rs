//! Jobs in SQLite.
//!
//! Every change is one transaction that takes the lock for writing at its start, so that it never
//! fails half-way because another came first.

mod events;

use super::event::{EventKind, insert_event};
use super::job::{Claim, Job, JobId, Transition};
use super::rows::{fetch, json_text, read_id, read_job, read_json, read_word, select_job};
use super::spec::JobSpec;
use super::state::{Change, Reason, State, Step, next};
use super::store_error::{Result, StoreError};
use crate::files::FileError;
use core::time::Duration;
use jiff::Timestamp;
use serde_json::{Map, Value};
use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Row as _, SqlSafeStr as _, Sqlite, SqliteConnection, Transaction, query, query_scalar};
use std::path::Path;
use tokio::sync::watch;

/// The steps from an empty database to this one, in order; a released one never changes.
const MIGRATIONS: [(i64, &str, &str); 1] =
    [(1, "jobs", include_str!("../../migrations/0001_jobs.sql"))];

/// Time that a change waits for others that write.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// Connections: one writes, others read meanwhile.
const MAX_CONNECTIONS: u32 = 8;

/// End of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub struct Ended {
    /// The change of the job's state.
    pub change: Change,
    /// The last words of a failed job.
    pub message: Option<String>,
    /// The summary of a job that ended well.
    pub summary: Option<Map<String, Value>>,
}

impl Ended {
    /// Without words.
    #[must_use]
    pub const fn new(change: Change) -> Self {
        Self { change, message: None, summary: None }
    }

    /// A failure, with what was said last.
    #[must_use]
    pub const fn failed(reason: Reason, message: Option<String>) -> Self {
        Self { change: Change::Failed(reason), message, summary: None }
    }
}

/// Which jobs of a list, newest first.
#[derive(Debug, Clone, Default)]
pub struct Filter {
    /// Of that state only.
    pub state: Option<State>,
    /// Of that task only.
    pub task: Option<String>,
    /// Older than that job only.
    pub before: Option<JobId>,
}

/// The answer to a job's submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submitted {
    /// The new job, or the one that the same request made before.
    pub id: JobId,
    /// The job as it was when it was submitted, JSON.
    pub body: String,
}

/// Jobs in a SQLite database.
#[derive(Debug, Clone)]
pub struct SqliteStore {
    pub(super) pool: SqlitePool,
    changes: watch::Sender<()>,
}

impl SqliteStore {
    /// Opens the database in the file `path`, which is created where it is absent.
    ///
    /// # Errors
    ///
    /// When it is no database, or one of a newer version of this program.
    pub async fn open(path: &Path) -> Result<Self, FileError> {
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .foreign_keys(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Normal)
            .busy_timeout(BUSY_TIMEOUT);
        let unusable = |error: &dyn core::fmt::Display| {
            FileError::content(path, format!("cannot be used as the database: {error}"))
        };
        let pool =
            SqlitePoolOptions::new().max_connections(MAX_CONNECTIONS).connect_with(options).await;
        let pool = pool.map_err(|error| unusable(&error))?;
        match migrator().run(&pool).await {
            Ok(()) => Ok(Self { pool, changes: watch::Sender::new(()) }),
            Err(MigrateError::VersionMissing(version)) => Err(FileError::content(
                path,
                format!("was written by a newer version of lpr: it has migration {version}"),
            )),
            Err(error) => Err(unusable(&error)),
        }
    }

    /// Tells when anything has changed.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changes.subscribe()
    }

    /// Adds a job to the queue. The same `key` and specification a second time add none and answer
    /// as the first time.
    ///
    /// # Errors
    ///
    /// [`StoreError::KeyReused`] when the key came with another specification.
    pub async fn submit(&self, spec: &JobSpec, key: Option<&str>) -> Result<Submitted> {
        let text = json_text(spec, "spec")?;
        let mut tx = self.begin().await?;
        if let Some(key) = key
            && let Some(earlier) = earlier_answer(&mut tx, key, &text).await?
        {
            return Ok(earlier);
        }
        let id = JobId::generate();
        insert_job(&mut tx, id, &spec.task, &text).await?;
        enter(&mut tx, id, Step { state: State::Queued, reason: None }).await?;
        // Kept as it is sent: a repeated request gets the same bytes, even after the job has moved
        // on.
        let body = json_text(&fetch(&mut tx, id).await?, "answer")?;
        if let Some(key) = key {
            let insert =
                query("INSERT INTO idempotency (key, spec, job, response) VALUES (?, ?, ?, ?)");
            insert.bind(key).bind(text).bind(id.to_string()).bind(&body).execute(&mut *tx).await?;
        }
        self.commit(tx).await?;
        Ok(Submitted { id, body })
    }

    /// A job.
    ///
    /// # Errors
    ///
    /// [`StoreError::NoSuchJob`] when there is none.
    pub async fn job(&self, id: JobId) -> Result<Job> {
        fetch(&mut *self.pool.acquire().await?, id).await
    }

    /// At most `limit` jobs, newest first.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn jobs(&self, filter: &Filter, limit: u32) -> Result<Vec<Job>> {
        let select = select_job!(
            "WHERE (?1 IS NULL OR state = ?1) AND (?2 IS NULL OR task = ?2) AND (?3 IS NULL OR id < ?3) \
             ORDER BY id DESC LIMIT ?4"
        );
        let rows = query(select)
            .bind(filter.state.map(State::name))
            .bind(filter.task.as_deref())
            .bind(filter.before.map(|id| id.to_string()))
            .bind(limit)
            .fetch_all(&self.pool)
            .await?;
        rows.iter().map(read_job).collect()
    }

    /// Gives the oldest job of the queue to a worker.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn claim(&self) -> Result<Option<(Claim, JobSpec)>> {
        let mut tx = self.begin().await?;
        let claimed = query(
            "UPDATE jobs SET attempt = attempt + 1, started_at = COALESCE(started_at, ?1) \
             WHERE id = (SELECT id FROM jobs WHERE state = 'queued' ORDER BY id LIMIT 1) RETURNING id, attempt, spec",
        );
        let Some(row) = claimed.bind(Timestamp::now().to_string()).fetch_optional(&mut *tx).await?
        else {
            return Ok(None);
        };
        let claim = Claim { id: read_id(&row)?, attempt: row.try_get("attempt")? };
        let spec = read_json(row.try_get("spec")?, "spec")?;
        move_on(&mut tx, claim.id, State::Queued, &Ended::new(Change::Claimed)).await?;
        self.commit(tx).await?;
        Ok(Some((claim, spec)))
    }

    /// Cancels a job: at once when it waits, else as soon as its worker has ended its process.
    ///
    /// # Errors
    ///
    /// [`StoreError::Refused`] when it has ended otherwise.
    pub async fn cancel(&self, id: JobId) -> Result<Job> {
        let mut tx = self.begin().await?;
        let state = fetch(&mut tx, id).await?.state;
        move_on(&mut tx, id, state, &Ended::new(Change::CancelRequested)).await?;
        let job = fetch(&mut tx, id).await?;
        self.commit(tx).await?;
        Ok(job)
    }

    /// Records how a worker's attempt ended.
    ///
    /// # Errors
    ///
    /// [`StoreError::Stale`] when the job is another's by now.
    pub async fn finish(&self, claim: Claim, ended: &Ended) -> Result<()> {
        let mut tx = self.begin().await?;
        let state = held(&mut tx, claim).await?;
        move_on(&mut tx, claim.id, state, ended).await?;
        self.commit(tx).await
    }

    /// Records that a worker's process was lost: the job goes on later, or has been lost too often.
    ///
    /// # Errors
    ///
    /// [`StoreError::Stale`] when the job is another's by now.
    pub async fn lose(&self, claim: Claim, message: Option<String>) -> Result<()> {
        let mut tx = self.begin().await?;
        let state = held(&mut tx, claim).await?;
        lose(&mut tx, claim.id, state, message).await?;
        self.commit(tx).await
    }

    /// Puts the jobs whose server was killed back into the queue: at start, when no worker holds
    /// any.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn recover(&self) -> Result<()> {
        let mut tx = self.begin().await?;
        let rows = query("SELECT id, state FROM jobs WHERE state IN ('running', 'cancelling')")
            .fetch_all(&mut *tx)
            .await?;
        for row in rows {
            let state = read_word(row.try_get("state")?, "state")?;
            lose(&mut tx, read_id(&row)?, state, Some("the server was killed".to_owned())).await?;
        }
        self.commit(tx).await
    }

    /// The state of a job that a worker holds.
    ///
    /// # Errors
    ///
    /// [`StoreError::Stale`] when the job is another's by now.
    pub async fn state(&self, claim: Claim) -> Result<State> {
        held(&mut *self.pool.acquire().await?, claim).await
    }

    /// Closes the database: what is asked for from now on fails.
    pub async fn close(&self) {
        self.pool.close().await;
    }

    pub(super) async fn begin(&self) -> Result<Transaction<'static, Sqlite>> {
        // Takes the lock for writing at once: a transaction that has read already fails when
        // another has written since, and no busy timeout waits for that.
        Ok(self.pool.begin_with("BEGIN IMMEDIATE").await?)
    }

    pub(super) async fn commit(&self, tx: Transaction<'_, Sqlite>) -> Result<()> {
        tx.commit().await?;
        // After the commit: whoever wakes finds the change in the database.
        self.changes.send_replace(());
        Ok(())
    }
}

fn migrator() -> Migrator {
    let migrations = MIGRATIONS.map(|(version, name, sql)| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    });
    Migrator::with_migrations(migrations.into())
}

/// The answer to the first request with `key`.
async fn earlier_answer(
    tx: &mut SqliteConnection,
    key: &str,
    spec: &str,
) -> Result<Option<Submitted>> {
    let earlier = query("SELECT spec, job AS id, response FROM idempotency WHERE key = ?")
        .bind(key)
        .fetch_optional(tx)
        .await?;
    let Some(row) = earlier else { return Ok(None) };
    if row.try_get::<&str, _>("spec")? != spec {
        return Err(StoreError::KeyReused);
    }
    Ok(Some(Submitted { id: read_id(&row)?, body: row.try_get("response")? }))
}

async fn insert_job(tx: &mut SqliteConnection, id: JobId, task: &str, spec: &str) -> Result<()> {
    let insert = query(
        "INSERT INTO jobs (id, task, spec, state, attempt, created_at) VALUES (?, ?, ?, 'queued', 0, ?)",
    );
    insert
        .bind(id.to_string())
        .bind(task)
        .bind(spec)
        .bind(Timestamp::now().to_string())
        .execute(tx)
        .await?;
    Ok(())
}

/// The state of the job that a worker holds.
pub(super) async fn held(tx: &mut SqliteConnection, claim: Claim) -> Result<State> {
    let state = query_scalar(
        "SELECT state FROM jobs WHERE id = ? AND attempt = ? AND state IN ('running', 'cancelling')",
    );
    let state: Option<String> =
        state.bind(claim.id.to_string()).bind(claim.attempt).fetch_optional(tx).await?;
    read_word(&state.ok_or(StoreError::Stale)?, "state")
}

async fn lose(
    tx: &mut SqliteConnection,
    id: JobId,
    state: State,
    message: Option<String>,
) -> Result<()> {
    let earlier = query_scalar(
        "SELECT count(*) FROM events WHERE job = ? AND kind = 'state' AND data ->> '$.reason' = 'worker_lost'",
    );
    let earlier: u32 = earlier.bind(id.to_string()).fetch_one(&mut *tx).await?;
    let change = Change::WorkerLost { losses: earlier + 1 };
    move_on(tx, id, state, &Ended { change, message, summary: None }).await
}

/// Takes a job from `state` to where the change leads.
async fn move_on(tx: &mut SqliteConnection, id: JobId, state: State, ended: &Ended) -> Result<()> {
    let Some(step) = next(state, ended.change)? else { return Ok(()) };
    enter(tx, id, step).await?;
    let said = (step.state == State::Failed).then_some(ended.message.as_deref()).flatten();
    let summary = ended.summary.as_ref().filter(|_| step.state == State::Succeeded);
    let summary = summary.map(|summary| json_text(summary, "summary")).transpose()?;
    let update = query("UPDATE jobs SET message = ?, summary = ? WHERE id = ?");
    update.bind(said).bind(summary).bind(id.to_string()).execute(tx).await?;
    Ok(())
}

/// Writes a job's new state and its event; a terminal one ends the history.
async fn enter(tx: &mut SqliteConnection, id: JobId, Step { state, reason }: Step) -> Result<()> {
    let at = Timestamp::now();
    let update = query("UPDATE jobs SET state = ?, reason = ?, finished_at = ? WHERE id = ?")
        .bind(state.name())
        .bind(reason.map(Reason::name))
        .bind(state.is_terminal().then(|| at.to_string()))
        .bind(id.to_string());
    update.execute(&mut *tx).await?;
    let transition = json_text(&Transition { state, reason, at }, "transition")?;
    insert_event(tx, id, EventKind::State, None, &transition).await?;
    if state.is_terminal() {
        insert_event(tx, id, EventKind::End, None, &format!(r#"{{"state":"{state}"}}"#)).await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
