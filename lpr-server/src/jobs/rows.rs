//! Jobs as rows of the database.

use super::job::{Job, JobId};
use super::store_error::{Result, StoreError};
use serde::de::value::{Error as WordError, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer as _};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection, query};

/// Selects jobs with what their events tell; each is found through an index.
macro_rules! select_job {
    ($rest:literal) => {
        concat!(
            "SELECT *, \
             (SELECT env_steps FROM events WHERE job = jobs.id AND kind = 'metric' ORDER BY seq DESC LIMIT 1) AS env_steps, \
             (SELECT data -> '$.\"validation/success_rate\"' FROM events WHERE job = jobs.id AND kind = 'metric' \
              AND data -> '$.\"validation/success_rate\"' IS NOT NULL ORDER BY seq DESC LIMIT 1) AS success_rate, \
             (SELECT json_group_array(json(data)) FROM \
              (SELECT data FROM events WHERE job = jobs.id AND kind = 'state' ORDER BY seq)) AS transitions \
             FROM jobs ",
            $rest
        )
    };
}

pub(super) use select_job;

/// The job of that identifier.
pub(super) async fn fetch(tx: &mut SqliteConnection, id: JobId) -> Result<Job> {
    let row = query(select_job!("WHERE id = ?")).bind(id.to_string()).fetch_optional(tx).await?;
    read_job(&row.ok_or(StoreError::NoSuchJob)?)
}

pub(super) fn read_job(row: &SqliteRow) -> Result<Job> {
    let text = |column| row.try_get::<Option<&str>, _>(column);
    let time =
        |column| text(column)?.map(|text| text.parse().map_err(unreadable(column))).transpose();
    Ok(Job {
        id: read_id(row)?,
        state: read_word(row.try_get("state")?, "state")?,
        reason: text("reason")?.map(|word| read_word(word, "reason")).transpose()?,
        message: row.try_get("message")?,
        spec: read_json(row.try_get("spec")?, "spec")?,
        attempt: row.try_get("attempt")?,
        created_at: row
            .try_get::<&str, _>("created_at")?
            .parse()
            .map_err(unreadable("created_at"))?,
        started_at: time("started_at")?,
        finished_at: time("finished_at")?,
        env_steps: row.try_get::<Option<i64>, _>("env_steps")?.map(i64::cast_unsigned),
        success_rate: text("success_rate")?
            .map(|rate| read_json(rate, "success_rate"))
            .transpose()?
            .flatten(),
        summary: text("summary")?.map(|summary| read_json(summary, "summary")).transpose()?,
        transitions: read_json(row.try_get("transitions")?, "transitions")?,
    })
}

pub(super) fn read_id(row: &SqliteRow) -> Result<JobId> {
    row.try_get::<&str, _>("id")?.parse().map_err(unreadable("id"))
}

pub(super) fn read_json<T: DeserializeOwned>(text: &str, column: &'static str) -> Result<T> {
    serde_json::from_str(text).map_err(unreadable(column))
}

/// A word as JSON spells it.
pub(super) fn read_word<T: DeserializeOwned>(word: &str, column: &'static str) -> Result<T> {
    let word: StrDeserializer<'_, WordError> = word.into_deserializer();
    T::deserialize(word).map_err(unreadable(column))
}

pub(super) fn json_text(value: &impl serde::Serialize, column: &'static str) -> Result<String> {
    serde_json::to_string(value).map_err(unreadable(column))
}

fn unreadable<E: core::fmt::Display>(column: &'static str) -> impl FnOnce(E) -> StoreError {
    move |error| StoreError::Unreadable { column, reason: error.to_string() }
}
