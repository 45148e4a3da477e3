//! The REST API: training jobs over HTTP, and the page that shows them.
//!
//! Handlers by resource. Every error is a problem (RFC 9457), also those of axum; the OpenAPI
//! document is made from the handlers.
//!
//! There is no authentication: the server listens on a loopback address only, and refuses what
//! pages of other hosts send to it. What is no HTTP at all is answered by hyper, with an empty 400.

#![expect(unused_qualifications, reason = "the code that utoipa makes of parameters")]

mod events;
mod extract;
mod guard;
mod jobs;
mod meta;
mod page;
mod problem;

pub use problem::{Code, Problem, ValueError};

use crate::jobs::{Phase, SqliteStore};
use axum::extract::DefaultBodyLimit;
use axum::{Router, middleware};
use std::path::PathBuf;
use tokio::sync::watch;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::limit::RequestBodyLimitLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Largest body of a request, bytes.
const MAX_BODY: usize = 1 << 20;

/// State that requests are answered from.
#[derive(Debug, Clone)]
pub struct Api {
    /// The jobs.
    pub store: SqliteStore,
    /// Phase of the server: streams end when it stops.
    pub phase: watch::Receiver<Phase>,
    /// The directory of the page's files.
    pub page: PathBuf,
}

/// The head of the OpenAPI document.
#[derive(OpenApi)]
#[openapi(
    info(title = "lpr", description = "Training jobs of robot arms that learn manipulation on a CPU."),
    tags((name = "jobs", description = "Training jobs"), (name = "meta", description = "The server and what it can train"))
)]
struct Head;

/// The whole service.
pub fn app(api: Api) -> Router {
    let (routes, _) = documented().split_for_parts();
    with_rules(routes.fallback(page::file).with_state(api))
}

/// Puts the rules of every request around `routes`.
fn with_rules(routes: Router) -> Router {
    routes
        .layer(DefaultBodyLimit::disable())
        // Also of those that announce it: what is too large is refused before it is sent.
        .layer(RequestBodyLimitLayer::new(MAX_BODY))
        .layer(CatchPanicLayer::custom(guard::panicked))
        .layer(middleware::from_fn(guard::local_only))
        .layer(middleware::from_fn(guard::only_problems))
        .layer(middleware::from_fn(guard::secured))
}

/// The handlers with their documentation.
fn documented() -> OpenApiRouter<Api> {
    OpenApiRouter::with_openapi(Head::openapi())
        .routes(routes!(meta::health))
        .routes(routes!(meta::openapi))
        .routes(routes!(meta::version))
        .routes(routes!(meta::tasks))
        .routes(routes!(jobs::list, jobs::submit))
        .routes(routes!(jobs::show))
        .routes(routes!(jobs::cancel))
        .routes(routes!(jobs::metrics))
        .routes(routes!(events::stream))
}

#[cfg(test)]
mod tests;
