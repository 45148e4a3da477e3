//! Bodies, parameters and headers of requests, refused with the value at fault.

use super::problem::{Code, Problem};
use crate::jobs::{JobId, JobSpec, pointer};
use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Query, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use serde::de::DeserializeOwned;

/// Longest idempotency key, characters.
const MAX_KEY_LEN: usize = 255;

/// The description of a job, checked.
#[derive(Debug)]
pub(super) struct SpecBody(pub(super) JobSpec);

impl<S: Send + Sync> FromRequest<S> for SpecBody {
    type Rejection = Response;

    async fn from_request(request: Request, state: &S) -> Result<Self, Response> {
        let is_json = is_json(request.headers());
        if !is_json {
            return Err(Problem::new(
                Code::UnsupportedMediaType,
                "Content-Type: expected application/json",
            )
            .into_response());
        }
        let bytes = Bytes::from_request(request, state)
            .await
            .map_err(|rejection| rejection.into_response())?;
        let spec: JobSpec = parse(&bytes).map_err(Problem::into_response)?;
        spec.check()
            .map_err(|error| Problem::of_body(error.pointer, error.detail).into_response())?;
        Ok(Self(spec))
    }
}

fn is_json(headers: &HeaderMap) -> bool {
    let content_type =
        headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    content_type
        .split(';')
        .next()
        .unwrap_or_default()
        .trim()
        .eq_ignore_ascii_case("application/json")
}

/// The value that the object in a body holds.
fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    // Serde would take the fields' values in their order, too.
    if bytes.trim_ascii_start().starts_with(b"[") {
        return Err(Problem::of_body(String::new(), "expected an object, found a list".to_owned()));
    }
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let place = pointer(error.path());
        let reason = error.into_inner();
        if reason.is_data() {
            return Problem::of_body(place, without_place(&reason.to_string()));
        }
        Problem::new(Code::InvalidJson, reason.to_string())
    })?;
    deserializer.end().map_err(|error| Problem::new(Code::InvalidJson, error.to_string()))?;
    Ok(value)
}

/// An error of JSON without the line and column that end it.
fn without_place(error: &str) -> String {
    error.rsplit_once(" at line ").map_or(error, |(reason, _)| reason).to_owned()
}

/// The parameters of an address; unknown ones are refused.
#[derive(Debug)]
pub(super) struct Parameters<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Parameters<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let found = Query::from_request_parts(parts, state).await;
        let Query(parameters) =
            found.map_err(|rejection| Problem::new(Code::InvalidQuery, rejection.body_text()))?;
        Ok(Self(parameters))
    }
}

/// The job that an address names; a text that is no identifier names none.
pub(super) fn job_id(text: &str) -> Result<JobId, Problem> {
    text.parse().map_err(|_| Problem::from(crate::jobs::StoreError::NoSuchJob))
}

/// The key of a request that may be sent twice.
pub(super) fn idempotency_key(headers: &HeaderMap) -> Result<Option<&str>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    match value.to_str() {
        Ok(key) if (1..=MAX_KEY_LEN).contains(&key.len()) => Ok(Some(key)),
        _ => {
            let detail =
                format!("Idempotency-Key: expected 1 to {MAX_KEY_LEN} printable ASCII characters");
            Err(Problem::new(Code::InvalidHeader, detail))
        }
    }
}
