//! The history of all jobs: one sequence, read by any number of streams at their own pace.

use super::{Claim, Result, SqliteStore, held};
use crate::jobs::event::{Event, EventKind, Point, insert_event};
use crate::jobs::job::JobId;
use serde_json::json;
use sqlx::{Row as _, SqliteConnection, query, query_scalar};

impl SqliteStore {
    /// At most `limit` events of a job after number `after`, in order.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn events(&self, id: JobId, after: i64, limit: u32) -> Result<Vec<Event>> {
        let select = query(
            "SELECT seq, kind, data FROM events WHERE job = ? AND seq > ? ORDER BY seq LIMIT ?",
        );
        let rows =
            select.bind(id.to_string()).bind(after).bind(limit).fetch_all(&self.pool).await?;
        let events = rows.iter().map(|row| {
            Ok(Event {
                seq: row.try_get("seq")?,
                kind: row.try_get("kind")?,
                data: row.try_get("data")?,
            })
        });
        events.collect()
    }

    /// Number of the last event of a job that has ended.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn end(&self, id: JobId) -> Result<Option<i64>> {
        let select = query_scalar("SELECT seq FROM events WHERE job = ? AND kind = 'end'");
        Ok(select.bind(id.to_string()).fetch_optional(&self.pool).await?)
    }

    /// The log points of a job, each a JSON object.
    ///
    /// # Errors
    ///
    /// When the database fails.
    pub async fn points(&self, id: JobId) -> Result<Vec<String>> {
        let select =
            query_scalar("SELECT data FROM events WHERE job = ? AND kind = 'metric' ORDER BY seq");
        Ok(select.bind(id.to_string()).fetch_all(&self.pool).await?)
    }

    /// Number of log points of a job in its history: the first so many lines of `metrics.jsonl`.
    pub(in crate::jobs) async fn n_points(&self, id: JobId) -> Result<u64> {
        n_points(&mut *self.pool.acquire().await?, id).await
    }

    /// Adds log points to the history of the job that a worker holds.
    pub(in crate::jobs) async fn append_points(
        &self,
        claim: Claim,
        points: &[Point],
    ) -> Result<()> {
        if points.is_empty() {
            return Ok(());
        }
        let mut tx = self.begin().await?;
        held(&mut tx, claim).await?;
        for Point { env_steps, line } in points {
            insert_event(&mut tx, claim.id, EventKind::Metric, Some(*env_steps), line).await?;
        }
        self.commit(tx).await
    }

    /// Takes the log points that are later than the checkpoint at `env_steps` out of the history,
    /// all of them without one. An event tells those who had seen them.
    pub(in crate::jobs) async fn rewind(&self, claim: Claim, env_steps: Option<u64>) -> Result<()> {
        let mut tx = self.begin().await?;
        held(&mut tx, claim).await?;
        let later = query(
            "DELETE FROM events WHERE job = ?1 AND kind = 'metric' AND (?2 IS NULL OR env_steps > ?2)",
        );
        let later = later
            .bind(claim.id.to_string())
            .bind(env_steps.map(u64::cast_signed))
            .execute(&mut *tx)
            .await?;
        if later.rows_affected() > 0 {
            let points = n_points(&mut tx, claim.id).await?;
            let data = json!({"env_steps": env_steps, "points": points}).to_string();
            insert_event(&mut tx, claim.id, EventKind::Rewind, None, &data).await?;
        }
        self.commit(tx).await
    }
}

async fn n_points(tx: &mut SqliteConnection, id: JobId) -> Result<u64> {
    let count = query_scalar("SELECT count(*) FROM events WHERE job = ? AND kind = 'metric'");
    Ok(count.bind(id.to_string()).fetch_one(tx).await.map(i64::cast_unsigned)?)
}
