//! Errors as RFC 9457 describes them: `application/problem+json`.

use crate::jobs::StoreError;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// The content type of every error.
pub(super) const CONTENT_TYPE: HeaderValue = HeaderValue::from_static("application/problem+json");

/// Kind of problem, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Code {
    /// The request cannot be understood.
    BadRequest,
    /// The body is no JSON.
    InvalidJson,
    /// The body is JSON, but not what is asked for; `errors` says where.
    InvalidBody,
    /// A parameter of the address is unknown or cannot be used.
    InvalidQuery,
    /// A header cannot be used.
    InvalidHeader,
    /// The request names another host than this server: it may have been made by a page of that
    /// host.
    HostNotAllowed,
    /// The request was made by a page of another host.
    OriginNotAllowed,
    /// There is nothing at this address.
    NotFound,
    /// There is no such job.
    NoSuchJob,
    /// The page has not been built.
    NoPage,
    /// The address takes other methods.
    MethodNotAllowed,
    /// The job has ended.
    JobEnded,
    /// The body is too large.
    PayloadTooLarge,
    /// The body is of another type than `application/json`.
    UnsupportedMediaType,
    /// The idempotency key belongs to another body.
    IdempotencyKeyReused,
    /// The server failed.
    Internal,
}

impl Code {
    const fn status(self) -> StatusCode {
        match self {
            Self::BadRequest | Self::InvalidJson | Self::InvalidQuery | Self::InvalidHeader => {
                StatusCode::BAD_REQUEST
            }
            Self::HostNotAllowed => StatusCode::MISDIRECTED_REQUEST,
            Self::OriginNotAllowed => StatusCode::FORBIDDEN,
            Self::NotFound | Self::NoSuchJob | Self::NoPage => StatusCode::NOT_FOUND,
            Self::MethodNotAllowed => StatusCode::METHOD_NOT_ALLOWED,
            Self::JobEnded => StatusCode::CONFLICT,
            Self::PayloadTooLarge => StatusCode::PAYLOAD_TOO_LARGE,
            Self::UnsupportedMediaType => StatusCode::UNSUPPORTED_MEDIA_TYPE,
            Self::InvalidBody | Self::IdempotencyKeyReused => StatusCode::UNPROCESSABLE_ENTITY,
            Self::Internal => StatusCode::INTERNAL_SERVER_ERROR,
        }
    }

    /// The code of an answer that was made without one.
    const fn of_status(status: StatusCode) -> Self {
        match status {
            StatusCode::NOT_FOUND => Self::NotFound,
            StatusCode::METHOD_NOT_ALLOWED => Self::MethodNotAllowed,
            StatusCode::PAYLOAD_TOO_LARGE => Self::PayloadTooLarge,
            StatusCode::UNSUPPORTED_MEDIA_TYPE => Self::UnsupportedMediaType,
            status if status.as_u16() >= 500 => Self::Internal,
            _ => Self::BadRequest,
        }
    }
}

/// Body of every answer with a status from 400 on.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Problem {
    /// The code as a name that is unique anywhere.
    #[serde(rename = "type")]
    kind: String,
    /// The status in words.
    title: String,
    /// The status of the answer.
    status: u16,
    /// The error in this request, in words.
    detail: String,
    /// Kind of problem, for programs.
    code: Code,
    /// The values at fault, of a body that cannot be used.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    errors: Vec<ValueError>,
}

/// A value at fault.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ValueError {
    /// Its place in the body, as RFC 6901 writes it.
    pointer: String,
    /// The error in it, in words.
    detail: String,
}

impl Problem {
    pub(super) fn new(code: Code, detail: impl Into<String>) -> Self {
        Self::with_status(code, code.status(), detail)
    }

    /// A body whose value at `pointer` is at fault.
    pub(super) fn of_body(pointer: String, detail: String) -> Self {
        let said = if pointer.is_empty() { detail.clone() } else { format!("{pointer}: {detail}") };
        Self { errors: vec![ValueError { pointer, detail }], ..Self::new(Code::InvalidBody, said) }
    }

    /// An answer of that status that was made elsewhere.
    pub(super) fn of_status(status: StatusCode, detail: impl Into<String>) -> Self {
        Self::with_status(Code::of_status(status), status, detail)
    }

    fn with_status(code: Code, status: StatusCode, detail: impl Into<String>) -> Self {
        let name = serde_json::to_value(code).ok();
        let name = name.as_ref().and_then(serde_json::Value::as_str).unwrap_or_default();
        Self {
            kind: format!("urn:lpr:problem:{name}"),
            title: status.canonical_reason().unwrap_or_default().to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            code,
            errors: Vec::new(),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        // Words, numbers and lists of them: nothing that JSON cannot say.
        let body = serde_json::to_string(&self).unwrap_or_default();
        (status, [(header::CONTENT_TYPE, CONTENT_TYPE)], body).into_response()
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NoSuchJob => {
                Self::new(Code::NoSuchJob, "there is no job with this identifier")
            }
            StoreError::Refused(refused) => Self::new(Code::JobEnded, refused.to_string()),
            StoreError::KeyReused => Self::new(
                Code::IdempotencyKeyReused,
                "Idempotency-Key: came before with another body; choose a new one",
            ),
            StoreError::Database(_) | StoreError::Unreadable { .. } | StoreError::Stale => {
                crate::jobs::report(&error.to_string());
                Self::new(Code::Internal, "the server failed; its standard error says why")
            }
        }
    }
}
