//! The server and what it can train.

use super::documented;
use super::problem::Problem;
use crate::formats::TaskList;
use axum::Json;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa::openapi::OpenApi;

/// That the server answers.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Health {
    #[schema(example = "ok")]
    status: &'static str,
}

/// Which server it is.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Version {
    /// Of the program.
    #[schema(example = "0.1.0")]
    version: &'static str,
    /// Of the API: the first part of its addresses.
    #[schema(example = "v1")]
    api: &'static str,
}

/// Says that the server answers
#[utoipa::path(get, path = "/healthz", tag = "meta", responses(
    (status = 200, description = "It does", body = Health),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn health() -> Json<Health> {
    Json(Health { status: "ok" })
}

/// This document
#[utoipa::path(get, path = "/openapi.json", tag = "meta", responses(
    (status = 200, description = "OpenAPI 3.1", body = Object),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn openapi() -> Json<OpenApi> {
    Json(documented().into_openapi())
}

/// The program's version
#[utoipa::path(get, path = "/v1/version", tag = "meta", responses(
    (status = 200, description = "Program and API", body = Version),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn version() -> Json<Version> {
    Json(Version { version: env!("CARGO_PKG_VERSION"), api: "v1" })
}

/// The tasks that a job can train
#[utoipa::path(get, path = "/v1/tasks", tag = "meta", responses(
    (status = 200, description = "All tasks", body = TaskList),
    (status = "4XX", description = "The request is refused", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn tasks() -> Json<TaskList> {
    Json(TaskList::all())
}
