//! `/v1/jobs`: to submit, list, show and cancel jobs.

use super::Api;
use super::extract::{Parameters, SpecBody, idempotency_key, job_id};
use super::problem::{Code, Problem};
use crate::jobs::{Filter, Job, JobSpec, State as JobState};
use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::{IntoParams, ToSchema};

/// Jobs of a list that asks for no number.
const DEFAULT_LIMIT: u32 = 50;
/// Most jobs of a list.
const MAX_LIMIT: u32 = 200;

/// Which jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListParameters {
    /// Of that state only.
    state: Option<JobState>,
    /// Of that task only.
    task: Option<String>,
    /// Most jobs of the answer.
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: Option<u32>,
    /// `next_cursor` of the answer before.
    #[param(format = "uuid")]
    cursor: Option<String>,
}

/// A page of jobs, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct JobList {
    jobs: Vec<Job>,
    /// Cursor that asks for the next ones; null after the last.
    next_cursor: Option<String>,
}

/// The log points of a job, the lines of its `metrics.jsonl`. The answer is put together from those
/// lines, which are JSON already.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Points {
    #[schema(value_type = Vec<Object>)]
    points: Vec<Map<String, Value>>,
}

/// Submits a job
#[utoipa::path(post, path = "/v1/jobs", tag = "jobs",
    params(("Idempotency-Key" = Option<String>, Header, description = "A name for this request, which may then be sent again: \
        the same body adds no second job and gets the same answer", min_length = 1, max_length = 255)),
    request_body = JobSpec,
    responses(
        (status = 201, description = "The new job", body = Job, headers(("Location" = String, description = "The address of the job"))),
        (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
        (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
    ))]
pub(super) async fn submit(
    State(api): State<Api>,
    headers: HeaderMap,
    SpecBody(spec): SpecBody,
) -> Result<Response, Problem> {
    let submitted = api.store.submit(&spec, idempotency_key(&headers)?).await?;
    let location = (header::LOCATION, format!("/v1/jobs/{}", submitted.id));
    Ok((StatusCode::CREATED, [location], json(submitted.body)).into_response())
}

/// Lists jobs, newest first
#[utoipa::path(get, path = "/v1/jobs", tag = "jobs", params(ListParameters), responses(
    (status = 200, description = "A page of the list", body = JobList),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
    (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn list(
    State(api): State<Api>,
    Parameters(parameters): Parameters<ListParameters>,
) -> Result<Json<JobList>, Problem> {
    let limit = parameters.limit.unwrap_or(DEFAULT_LIMIT);
    if !(1..=MAX_LIMIT).contains(&limit) {
        return Err(Problem::new(
            Code::InvalidQuery,
            format!("limit: expected 1 to {MAX_LIMIT}, found {limit}"),
        ));
    }
    let before = parameters.cursor.map(|cursor| cursor.parse()).transpose();
    let before = before.map_err(|_| {
        Problem::new(Code::InvalidQuery, "cursor: expected the next_cursor of an earlier answer")
    })?;
    let filter = Filter { state: parameters.state, task: parameters.task, before };
    let mut jobs = api.store.jobs(&filter, limit + 1).await?;
    let has_more = jobs.len() > limit as usize;
    jobs.truncate(limit as usize);
    let next_cursor = jobs.last().filter(|_| has_more).map(|job| job.id.to_string());
    Ok(Json(JobList { jobs, next_cursor }))
}

/// Shows a job
#[utoipa::path(get, path = "/v1/jobs/{id}", tag = "jobs", params(("id" = String, Path, format = "uuid")), responses(
    (status = 200, description = "The job", body = Job),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
    (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn show(
    State(api): State<Api>,
    Path(id): Path<String>,
) -> Result<Json<Job>, Problem> {
    Ok(Json(api.store.job(job_id(&id)?).await?))
}

/// Cancels a job
///
/// A job that waits is cancelled at once, one that runs as soon as its process has ended.
/// Cancelling again changes nothing.
#[utoipa::path(post, path = "/v1/jobs/{id}/cancel", tag = "jobs", params(("id" = String, Path, format = "uuid")), responses(
    (status = 200, description = "The job, cancelled or about to be", body = Job),
    (status = 409, description = "It has ended otherwise", body = Problem, content_type = "application/problem+json"),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
    (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn cancel(
    State(api): State<Api>,
    Path(id): Path<String>,
) -> Result<Json<Job>, Problem> {
    Ok(Json(api.store.cancel(job_id(&id)?).await?))
}

/// All log points of a job
#[utoipa::path(get, path = "/v1/jobs/{id}/metrics", tag = "jobs", params(("id" = String, Path, format = "uuid")), responses(
    (status = 200, description = "In the order of the run", body = Points),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
    (status = "5XX", description = "The server failed", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn metrics(
    State(api): State<Api>,
    Path(id): Path<String>,
) -> Result<impl IntoResponse, Problem> {
    let job = api.store.job(job_id(&id)?).await?;
    let points = api.store.points(job.id).await?;
    Ok(json(format!(r#"{{"points":[{}]}}"#, points.join(","))))
}

/// A text that is JSON already.
fn json(text: String) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], text)
}
