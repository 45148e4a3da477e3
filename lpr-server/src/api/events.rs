//! `/v1/jobs/{id}/events`: what happens to a job, as it happens, as server-sent events.
//!
//! A stream reads the history in the database at the pace of its reader: any number of them get the
//! same events, however slow they are, and go on after a broken connection where they were.

use super::Api;
use super::extract::{Parameters, job_id};
use super::problem::{Code, Problem};
use crate::jobs::{self, EventKind, JobId, Phase, SqliteStore, StoreError};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use core::time::Duration;
use futures_util::stream::{self, Stream};
use serde::Deserialize;
use std::vec;
use tokio::sync::watch;
use utoipa::IntoParams;

/// Time between two signs of life of a silent stream.
const PING_INTERVAL: Duration = Duration::from_secs(10);
/// Events that a stream holds at a time.
const BATCH: u32 = 256;

/// Beginning of the stream.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct StreamParameters {
    /// Only events after that `id`; the header `Last-Event-ID` goes before it.
    #[param(minimum = 0)]
    after: Option<i64>,
}

/// Streams the events of a job as they happen
///
/// Server-sent events, from the first or after a given one: `state` (as in the job's
/// `transitions`), `metric` (a log point), `rewind` (`{"env_steps", "points"}`: the run went back
/// to a checkpoint, and of its log points only the first `points` hold), and at last `end`
/// (`{"state"}`), after which the stream closes. A stream that closes without `end` is to be asked
/// for again with the `id` of the last event; after `end` the answer to that is 204.
#[utoipa::path(get, path = "/v1/jobs/{id}/events", tag = "jobs",
    params(("id" = String, Path, format = "uuid"), StreamParameters, ("Last-Event-ID" = Option<i64>, Header, minimum = 0)),
    responses(
        (status = 200, description = "The events", body = String, content_type = "text/event-stream"),
        (status = 204, description = "Nothing more happens to the job"),
        (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
        (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
    ))]
pub(super) async fn stream(
    State(api): State<Api>,
    Path(id): Path<String>,
    Parameters(parameters): Parameters<StreamParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let after = first_after(&headers, &parameters)?;
    let job = api.store.job(job_id(&id)?).await?;
    if api.store.end(job.id).await?.is_some_and(|end| end <= after) {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let reader = Reader::new(api, job.id, after);
    let events =
        Sse::new(events(reader)).keep_alive(KeepAlive::new().interval(PING_INTERVAL).text("ping"));
    // A proxy that collects the stream would hold it back.
    let unbuffered = (HeaderName::from_static("x-accel-buffering"), "no");
    Ok(([unbuffered], events).into_response())
}

/// After which event the reader wants to go on.
fn first_after(headers: &HeaderMap, parameters: &StreamParameters) -> Result<i64, Problem> {
    let seq = match headers.get("last-event-id") {
        Some(id) => id.to_str().ok().and_then(|id| id.parse().ok()),
        None => Some(parameters.after.unwrap_or(0)),
    };
    seq.filter(|seq| *seq >= 0).ok_or_else(|| {
        if headers.contains_key("last-event-id") {
            Problem::new(Code::InvalidHeader, "Last-Event-ID: expected the id of an event")
        } else {
            Problem::new(Code::InvalidQuery, "after: expected the id of an event")
        }
    })
}

/// Position of a stream among the events.
struct Reader {
    store: SqliteStore,
    changes: watch::Receiver<()>,
    phase: watch::Receiver<Phase>,
    job: JobId,
    /// The last event that was taken.
    after: i64,
    /// Those that were read with it.
    batch: vec::IntoIter<jobs::Event>,
    /// True if the last event of all has been taken.
    has_ended: bool,
}

impl Reader {
    fn new(api: Api, job: JobId, after: i64) -> Self {
        let changes = api.store.changes();
        Self {
            store: api.store,
            changes,
            phase: api.phase,
            job,
            after,
            batch: Vec::new().into_iter(),
            has_ended: false,
        }
    }

    /// The next event, once it is there; none after the last, and when the server stops.
    async fn next(&mut self) -> Result<Option<jobs::Event>, StoreError> {
        if self.has_ended {
            return Ok(None);
        }
        loop {
            if let Some(event) = self.batch.next() {
                self.after = event.seq;
                self.has_ended = event.kind == EventKind::End.name();
                return Ok(Some(event));
            }
            // Before the read: an event that is committed after it then ends the wait below.
            self.changes.mark_unchanged();
            self.batch = self.store.events(self.job, self.after, BATCH).await?.into_iter();
            if self.batch.as_slice().is_empty() {
                tokio::select! {
                    changed = self.changes.changed() => if changed.is_err() { return Ok(None) },
                    () = jobs::stopping(&mut self.phase) => return Ok(None),
                }
            }
        }
    }
}

fn events(reader: Reader) -> impl Stream<Item = Result<Event, StoreError>> {
    stream::try_unfold(reader, |mut reader| async move {
        let Some(jobs::Event { seq, kind, data }) = reader.next().await? else { return Ok(None) };
        let event = Event::default().id(seq.to_string()).event(kind).data(data);
        Ok(Some((event, reader)))
    })
}
