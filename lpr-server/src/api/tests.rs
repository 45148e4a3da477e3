use super::*;
use crate::jobs::{Change, Ended};
use axum::body::{Body, to_bytes};
use axum::http::{Request, header};
use axum::response::Response;
use axum::routing::get;
use core::time::Duration;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use tokio::time::timeout;
use tower::ServiceExt as _;

mod streams;

/// A service with a database and a page of its own.
struct Service {
    folder: TempDir,
    store: SqliteStore,
    app: Router,
    phase: watch::Sender<Phase>,
}

/// An answer of the server.
struct Answer {
    status: u16,
    headers: axum::http::HeaderMap,
    body: String,
}

impl Answer {
    async fn of(response: Response) -> Self {
        let (parts, body) = response.into_parts();
        let body =
            timeout(Duration::from_secs(60), to_bytes(body, usize::MAX)).await.unwrap().unwrap();
        Self {
            status: parts.status.as_u16(),
            headers: parts.headers,
            body: String::from_utf8(body.to_vec()).unwrap(),
        }
    }

    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.body))
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// Fails when it is anything but a problem of that status and code.
    #[track_caller]
    fn assert_problem(&self, status: u16, code: &str) -> Value {
        assert_eq!(
            self.header("content-type"),
            "application/problem+json",
            "{}: {}",
            self.status,
            self.body
        );
        let problem = self.json();
        assert_eq!((self.status, problem["code"].as_str()), (status, Some(code)), "{problem}");
        assert_eq!(problem["status"], status);
        assert_eq!(problem["type"], format!("urn:lpr:problem:{code}"));
        assert!(
            !problem["title"].as_str().unwrap().is_empty()
                && !problem["detail"].as_str().unwrap().is_empty()
        );
        problem
    }
}

impl Service {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap();
        let (phase, receiver) = watch::channel(Phase::Serving);
        let app =
            app(Api { store: store.clone(), phase: receiver, page: folder.path().join("page") });
        Self { folder, store, app, phase }
    }

    async fn answer(&self, request: Request<Body>) -> Answer {
        Answer::of(self.app.clone().oneshot(request).await.unwrap()).await
    }

    async fn get(&self, path: &str) -> Answer {
        self.answer(request("GET", path).body(Body::empty()).unwrap()).await
    }

    async fn post(&self, path: &str, body: impl Into<Body>) -> Answer {
        let request = request("POST", path).header(header::CONTENT_TYPE, "application/json");
        self.answer(request.body(body.into()).unwrap()).await
    }

    async fn submit(&self, body: &Value) -> Answer {
        self.post("/v1/jobs", body.to_string()).await
    }

    /// Runs the oldest job to an end without a process.
    async fn end_next(&self, change: Change) {
        let (claim, _) = self.store.claim().await.unwrap().unwrap();
        self.store.finish(claim, &Ended::new(change)).await.unwrap();
    }
}

fn request(method: &str, path: &str) -> axum::http::request::Builder {
    Request::builder().method(method).uri(path).header(header::HOST, "127.0.0.1:8080")
}

fn reach() -> Value {
    json!({"task": "reach_target"})
}

#[tokio::test]
async fn a_job_is_submitted_shown_listed_and_cancelled() {
    let service = Service::new().await;
    let submitted = service.submit(&reach()).await;
    let job = submitted.json();
    let id = job["id"].as_str().unwrap();
    assert_eq!(
        (submitted.status, submitted.header("location")),
        (201, format!("/v1/jobs/{id}").as_str())
    );
    let spec = json!({
        "task": "reach_target", "robot": "xarm7", "method": "lpr", "preset": "fast", "settings": null, "demos": null,
        "oracle_poses": false, "seed": 0, "env_steps": null, "minutes": 15.0, "stop_after_successes": null,
    });
    assert_eq!(
        (&job["state"], &job["reason"], &job["spec"]),
        (&json!("queued"), &Value::Null, &spec)
    );
    assert_eq!(service.get(submitted.header("location")).await.json(), job);
    assert_eq!(service.get("/v1/jobs").await.json(), json!({"jobs": [job], "next_cursor": null}));
    let cancelled = service.post(&format!("/v1/jobs/{id}/cancel"), "").await;
    assert_eq!((cancelled.status, &cancelled.json()["state"]), (200, &json!("cancelled")));
    assert_eq!(cancelled.json()["transitions"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn pages_of_a_list_follow_each_other_without_gap_or_repetition() {
    let service = Service::new().await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        ids.push(service.submit(&reach()).await.json()["id"].clone());
    }
    ids.reverse();
    let (mut seen, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = service.get(&format!("/v1/jobs?limit=2{cursor}")).await.json();
        seen.extend(page["jobs"].as_array().unwrap().iter().map(|job| job["id"].clone()));
        let Some(next) = page["next_cursor"].as_str() else { break };
        cursor = format!("&cursor={next}");
        // A new job is no reason to see an old one twice.
        service.submit(&reach()).await;
    }
    assert_eq!(seen, ids);
}

#[tokio::test]
async fn every_wrong_request_is_answered_with_a_problem() {
    let service = Service::new().await;
    let absent = "/v1/jobs/0190a5e0-0000-7000-8000-000000000000";
    for (method, path, status, code) in [
        ("GET", "/v1/nothing", 404, "not_found"),
        ("GET", "/v1/jobs/", 404, "not_found"),
        ("GET", absent, 404, "no_such_job"),
        ("GET", "/v1/jobs/7", 404, "no_such_job"),
        ("GET", "/v1/jobs/%ff", 400, "bad_request"),
        ("GET", "/v1/jobs/..%2f..%2fetc/metrics", 404, "no_such_job"),
        ("POST", &format!("{absent}/cancel"), 404, "no_such_job"),
        ("GET", &format!("{absent}/metrics"), 404, "no_such_job"),
        ("GET", &format!("{absent}/events"), 404, "no_such_job"),
        ("GET", &format!("{absent}/events?after=-1"), 400, "invalid_query"),
        ("GET", &format!("{absent}/events?after=soon"), 400, "invalid_query"),
        ("DELETE", "/v1/jobs", 405, "method_not_allowed"),
        ("PUT", absent, 405, "method_not_allowed"),
        ("GET", &format!("{absent}/cancel"), 405, "method_not_allowed"),
        ("BREW", "/healthz", 405, "method_not_allowed"),
        ("POST", "/index.html", 405, "method_not_allowed"),
        ("GET", "/v1/jobs?state=asleep", 400, "invalid_query"),
        ("GET", "/v1/jobs?limit=0", 400, "invalid_query"),
        ("GET", "/v1/jobs?limit=201", 400, "invalid_query"),
        ("GET", "/v1/jobs?limit=99999999999", 400, "invalid_query"),
        ("GET", "/v1/jobs?cursor=7", 400, "invalid_query"),
        ("GET", "/v1/jobs?sort=up", 400, "invalid_query"),
        ("POST", "/v1/jobs", 415, "unsupported_media_type"),
        ("GET", "/%00", 404, "not_found"),
        ("GET", &format!("/{}", "a".repeat(5000)), 404, "not_found"),
        ("GET", "/../../../etc/passwd", 404, "not_found"),
        ("GET", "/%2e%2e/lpr.sqlite", 404, "not_found"),
    ] {
        let answer = service.answer(request(method, path).body(Body::empty()).unwrap()).await;
        answer.assert_problem(status, code);
        assert_eq!(answer.headers.contains_key(header::ALLOW), status == 405, "{method} {path}");
    }
}

#[tokio::test]
async fn a_body_that_cannot_be_used_is_pointed_at() {
    let service = Service::new().await;
    for (body, status, code) in [
        ("", 400, "invalid_json"),
        ("{", 400, "invalid_json"),
        ("{} {}", 422, "invalid_body"),
        (r#"{"task": "reach_target"} and more"#, 400, "invalid_json"),
        (r#"{"task": "reach_target", "minutes": 1e400}"#, 400, "invalid_json"),
        ("\u{0}", 400, "invalid_json"),
    ] {
        service.post("/v1/jobs", body).await.assert_problem(status, code);
    }
    service.post("/v1/jobs", "[".repeat(1000)).await.assert_problem(422, "invalid_body");
    service
        .post("/v1/jobs", format!(r#"{{"task": {}"#, "[".repeat(1000)))
        .await
        .assert_problem(422, "invalid_body");
    let nested = format!(r#"{{"task": "reach_target", "settings": {{"a": {}"#, "[".repeat(1000));
    service.post("/v1/jobs", nested).await.assert_problem(400, "invalid_json");
    service.post("/v1/jobs", &b"\"\xff\""[..]).await.assert_problem(400, "invalid_json");
    for (body, pointer, says) in [
        (json!(["reach_target"]), "", "expected an object"),
        (json!("reach_target"), "", "expected struct JobSpec"),
        (json!({}), "", "missing field `task`"),
        (json!({"task": 7}), "/task", "invalid type: integer `7`, expected a string"),
        (json!({"task": "reach_target", "sede": 7}), "/sede", "unknown field `sede`"),
        (json!({"task": "reach_target", "seed": -1}), "/seed", "invalid value: integer `-1`"),
        (
            json!({"task": "reach_target", "demos": 1.5}),
            "/demos",
            "invalid type: floating point `1.5`",
        ),
        (json!({"task": "reach_target", "settings": []}), "/settings", "invalid type: sequence"),
        (json!({"task": "make_coffee"}), "/task", "expected one of reach_target"),
        (json!({"task": "reach_target", "minutes": -1}), "/minutes", "expected above 0, found -1"),
        (
            json!({"task": "reach_target", "settings": {"a/b": 1}}),
            "/settings/a~1b",
            "unknown field `a/b`",
        ),
    ] {
        let problem = service.submit(&body).await.assert_problem(422, "invalid_body");
        let [error] = &problem["errors"].as_array().unwrap()[..] else { panic!("{problem}") };
        assert_eq!(error["pointer"], pointer, "{problem}");
        assert!(error["detail"].as_str().unwrap().contains(says), "{problem}");
    }
    assert_eq!(service.get("/v1/jobs").await.json()["jobs"], json!([]));
}

#[tokio::test]
async fn a_body_beyond_the_limit_is_refused() {
    let service = Service::new().await;
    let padded = |bytes: usize| {
        let body = reach().to_string();
        format!("{body}{}", " ".repeat(bytes - body.len()))
    };
    service.post("/v1/jobs", padded(MAX_BODY + 1)).await.assert_problem(413, "payload_too_large");
    assert_eq!(service.post("/v1/jobs", padded(MAX_BODY)).await.status, 201);
}

#[tokio::test]
async fn a_job_that_has_ended_otherwise_cannot_be_cancelled() {
    let service = Service::new().await;
    let id = service.submit(&reach()).await.json()["id"].as_str().unwrap().to_owned();
    service.end_next(Change::Succeeded).await;
    let answer = service.post(&format!("/v1/jobs/{id}/cancel"), "").await;
    assert_eq!(answer.assert_problem(409, "job_ended")["detail"], "the job is succeeded");
}

#[tokio::test]
async fn a_request_with_a_key_can_be_sent_again() {
    let service = Service::new().await;
    let submit = async |key: &str, body: &Value| {
        let request = request("POST", "/v1/jobs")
            .header(header::CONTENT_TYPE, "application/json; charset=utf-8");
        service
            .answer(request.header("Idempotency-Key", key).body(body.to_string().into()).unwrap())
            .await
    };
    let first = submit("a", &reach()).await;
    service.end_next(Change::Succeeded).await;
    let second = submit("a", &reach()).await;
    assert_eq!(
        (second.status, &second.body, second.header("location")),
        (201, &first.body, first.header("location"))
    );
    submit("a", &json!({"task": "reach_target", "seed": 1}))
        .await
        .assert_problem(422, "idempotency_key_reused");
    submit("", &reach()).await.assert_problem(400, "invalid_header");
    submit(&"k".repeat(256), &reach()).await.assert_problem(400, "invalid_header");
    assert_eq!(service.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn pages_of_other_hosts_are_kept_out() {
    let service = Service::new().await;
    let answer = async |host: &str, origin: Option<&str>| {
        let request = Request::builder().uri("/v1/jobs").header(header::HOST, host);
        let request = origin
            .into_iter()
            .fold(request, |request, origin| request.header(header::ORIGIN, origin));
        service.answer(request.body(Body::empty()).unwrap()).await
    };
    answer("rebound.example:8080", None).await.assert_problem(421, "host_not_allowed");
    answer("", None).await.assert_problem(421, "host_not_allowed");
    for origin in ["http://evil.example", "null", "http://127.0.0.1.evil.example", "file://"] {
        answer("127.0.0.1:8080", Some(origin)).await.assert_problem(403, "origin_not_allowed");
    }
    assert_eq!(answer("localhost:8080", Some("http://localhost:5173")).await.status, 200);
    let twice = request("GET", "/healthz")
        .header(header::HOST, "evil.example")
        .body(Body::empty())
        .unwrap();
    service.answer(twice).await.assert_problem(421, "host_not_allowed");
    let absolute = request("GET", "http://evil.example/healthz").body(Body::empty()).unwrap();
    service.answer(absolute).await.assert_problem(421, "host_not_allowed");
}

#[tokio::test]
async fn a_panic_is_a_problem_that_does_not_tell_what_is_inside() {
    let app = with_rules(Router::new().route("/", get(|| async { panic!("a secret") as () })));
    let answer =
        Answer::of(app.oneshot(request("GET", "/").body(Body::empty()).unwrap()).await.unwrap())
            .await;
    answer.assert_problem(500, "internal");
    assert!(!answer.body.contains("secret"), "{}", answer.body);
}

#[tokio::test]
async fn a_database_that_fails_is_a_problem_that_does_not_tell_what_is_inside() {
    let service = Service::new().await;
    service.store.close().await;
    let answer = service.get("/v1/jobs").await;
    answer.assert_problem(500, "internal");
    assert!(!answer.body.contains("ool"), "{}", answer.body);
}

#[tokio::test]
async fn every_answer_has_the_headers_that_protect_it() {
    let service = Service::new().await;
    for path in ["/healthz", "/v1/nothing", "/"] {
        let answer = service.get(path).await;
        let policy = answer.header("content-security-policy");
        assert!(
            policy.contains("default-src 'self'")
                && policy.contains("script-src 'self' 'wasm-unsafe-eval'"),
            "{path}: {policy}"
        );
        assert_eq!(answer.header("cross-origin-opener-policy"), "same-origin");
        assert_eq!(answer.header("cross-origin-embedder-policy"), "require-corp");
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
        assert_eq!(answer.header("cache-control"), "no-store");
    }
}

#[tokio::test]
async fn the_page_is_served_and_its_absence_told() {
    let service = Service::new().await;
    let problem = service.get("/").await.assert_problem(404, "no_page");
    assert!(problem["detail"].as_str().unwrap().contains("make page"));
    let page = service.folder.path().join("page");
    fs::create_dir(&page).unwrap();
    let write = |name: &str, text: &str| fs::write(Path::new(&page).join(name), text).unwrap();
    write("index.html", "<!doctype html>");
    write("lpr.wasm", "plain");
    write("lpr.wasm.br", "brotli");
    write("lpr.wasm.gz", "gzip");
    let index = service.get("/").await;
    assert_eq!((index.status, index.body.as_str()), (200, "<!doctype html>"));
    assert_eq!(
        (index.header("content-type"), index.header("cache-control")),
        ("text/html", "no-cache")
    );
    for (accepted, body) in [("", "plain"), ("gzip", "gzip"), ("gzip, br", "brotli")] {
        let request = request("GET", "/lpr.wasm").header(header::ACCEPT_ENCODING, accepted);
        let answer = service.answer(request.body(Body::empty()).unwrap()).await;
        assert_eq!(
            (answer.body.as_str(), answer.header("content-type")),
            (body, "application/wasm")
        );
    }
    service.get("/absent.js").await.assert_problem(404, "not_found");
    let beyond = request("GET", "/index.html")
        .header(header::RANGE, "bytes=900-")
        .body(Body::empty())
        .unwrap();
    service.answer(beyond).await.assert_problem(416, "bad_request");
}

#[tokio::test]
async fn the_document_lists_every_address() {
    let service = Service::new().await;
    let document = service.get("/openapi.json").await.json();
    assert!(document["openapi"].as_str().unwrap().starts_with("3.1"));
    let paths: Vec<_> = document["paths"].as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "/healthz",
        "/openapi.json",
        "/v1/jobs",
        "/v1/jobs/{id}",
        "/v1/jobs/{id}/cancel",
        "/v1/jobs/{id}/events",
        "/v1/jobs/{id}/metrics",
        "/v1/tasks",
        "/v1/version",
    ];
    assert_eq!(paths, expected);
    assert_eq!(service.get("/v1/version").await.json()["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(service.get("/healthz").await.json(), json!({"status": "ok"}));
    assert_eq!(service.get("/v1/tasks").await.json()["tasks"][0]["name"], "reach_target");
}

#[test]
fn the_document_is_the_one_that_is_known() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/openapi.json");
    let document = format!("{}\n", documented().into_openapi().to_pretty_json().unwrap());
    if std::env::var_os("LPR_RENEW_GOLDEN").is_some() {
        fs::write(&path, &document).unwrap();
    }
    let known = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        document == known,
        "the API has changed: LPR_RENEW_GOLDEN=1 with this test writes tests/golden/openapi.json anew"
    );
}
