//! Rules of every request and every answer.

use super::problem::{self, Code, Problem};
use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use core::any::Any;
use std::net::IpAddr;

/// Most bytes of a foreign error's words.
const MAX_WORDS: usize = 4096;

/// Headers of every answer. The page runs WebAssembly, which may use threads where pages of other
/// origins are kept out.
const HEADERS: [(HeaderName, &str); 7] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; \
         img-src 'self' data: blob:; worker-src 'self'; object-src 'none'; base-uri 'none'; frame-ancestors 'none'",
    ),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-embedder-policy"), "require-corp"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_FRAME_OPTIONS, "DENY"),
];

/// Adds the headers of every answer.
pub(super) async fn secured(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// Makes a problem of every error that is none yet: those of axum and of the file server.
pub(super) async fn only_problems(request: Request, next: Next) -> Response {
    let response = next.run(request).await;
    let status = response.status();
    let is_error = status.is_client_error() || status.is_server_error();
    if !is_error || response.headers().get(header::CONTENT_TYPE) == Some(&problem::CONTENT_TYPE) {
        return response;
    }
    let (parts, body) = response.into_parts();
    let words = if status.is_client_error() { words(body).await } else { String::new() };
    let allow = parts.headers.get(header::ALLOW);
    let detail = match allow.and_then(|methods| methods.to_str().ok()) {
        Some(methods) => format!("this address takes {methods}"),
        None if words.is_empty() => status.canonical_reason().unwrap_or_default().to_owned(),
        None => words,
    };
    let mut response = Problem::of_status(status, detail).into_response();
    response.headers_mut().extend(allow.map(|methods| (header::ALLOW, methods.clone())));
    response
}

/// The words of an error in plain text.
async fn words(body: Body) -> String {
    let bytes = to_bytes(body, MAX_WORDS).await.unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The answer to a request in which the server panicked; the panic itself is on standard error.
pub(super) fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::new(Code::Internal, "the server failed; its standard error says why").into_response()
}

/// Lets requests through that were made to this machine by name: not those that a page of another
/// host made after its name came to stand for this machine, nor those that it made to this machine
/// openly.
pub(super) async fn local_only(request: Request, next: Next) -> Response {
    if !names_this_machine(request.uri(), request.headers()) {
        let detail = "Host: expected localhost or a loopback address";
        return Problem::new(Code::HostNotAllowed, detail).into_response();
    }
    if !is_of_this_origin(request.headers()) {
        return Problem::new(
            Code::OriginNotAllowed,
            "Origin: pages of other hosts may not use this server",
        )
        .into_response();
    }
    next.run(request).await
}

fn names_this_machine(uri: &Uri, headers: &HeaderMap) -> bool {
    let mut hosts = headers.get_all(header::HOST).iter();
    let only = hosts.next().filter(|_| hosts.next().is_none());
    let in_header = only.and_then(|host| host.to_str().ok()).is_some_and(is_loopback);
    in_header && uri.authority().is_none_or(|authority| is_loopback(authority.as_str()))
}

fn is_of_this_origin(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return true };
    let origin = origin.to_str().unwrap_or_default();
    let host = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    host.is_some_and(is_loopback)
}

/// Checks that `host`, with or without a port, is a name of this machine.
fn is_loopback(host: &str) -> bool {
    let (name, port) = match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((name, port)) => (name, port.strip_prefix(':').or(port.is_empty().then_some("0"))),
        None => host.split_once(':').map_or((host, Some("0")), |(name, port)| (name, Some(port))),
    };
    let is_port = port.is_some_and(|port| port.parse::<u16>().is_ok());
    is_port
        && (name.eq_ignore_ascii_case("localhost")
            || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_this_machine_are_told_from_others() {
        for host in [
            "localhost",
            "LocalHost:80",
            "127.0.0.1",
            "127.0.0.1:8080",
            "127.1.2.3:1",
            "[::1]",
            "[::1]:8080",
        ] {
            assert!(is_loopback(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "evil.example:8080",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "localhost:",
            "localhost:x",
            "localhost@evil.example",
            "10.0.0.1",
            "0.0.0.0",
            "[::1",
            "[::]:80",
            "[::1]x",
            "127.0.0.1:99999",
            "user@localhost",
        ] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
