//! The page: the files of a directory.

use super::Api;
use super::problem::{Code, Problem};
use crate::jobs::report;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, header};
use axum::response::Response;
use std::io::{self, ErrorKind};
use tower_http::services::ServeDir;

/// Serves the files of the page's directory, compressed where a `.br` or `.gz` stands beside one.
pub(super) async fn file(State(api): State<Api>, request: Request) -> Result<Response, Problem> {
    let index = api.page.join("index.html");
    if request.uri().path() == "/" && !index.is_file() {
        let detail = format!(
            "{} is missing: run `make page`, or choose the page's directory with --page",
            index.display()
        );
        return Err(Problem::new(Code::NoPage, detail));
    }
    let mut files = ServeDir::new(&api.page).precompressed_br().precompressed_gzip();
    let response = files.try_call(request).await.map_err(|error| unreadable(&error))?;
    let mut response = response.map(Body::new);
    if response.status().is_success() {
        // Browsers ask again whether a file has changed: a page is not mixed from two builds.
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    }
    Ok(response)
}

/// A file that the operating system does not read.
fn unreadable(error: &io::Error) -> Problem {
    match error.kind() {
        // Of paths that no file can have, too.
        ErrorKind::NotFound
        | ErrorKind::PermissionDenied
        | ErrorKind::NotADirectory
        | ErrorKind::InvalidInput
        | ErrorKind::InvalidFilename => {
            Problem::new(Code::NotFound, "there is nothing at this address")
        }
        _ => {
            report(&format!("a file of the page cannot be read: {error}"));
            Problem::new(Code::Internal, "the server failed; its standard error says why")
        }
    }
}
