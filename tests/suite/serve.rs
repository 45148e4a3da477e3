//! `lpr serve` over real sockets: jobs train what the command line trains, streams lose nothing,
//! and no end of the server loses a job.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{Folder, last_line_of_failure};
use crate::runs::{Kind, LEARNED, ORACLE, Runs, metrics, remove_times};
use crate::server::{Event, Server, command, points_of};
use serde_json::{Value, json};
use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::process::{Output, Stdio};
use std::time::Duration;

/// Without what the contract lets depend on time.
fn timeless(mut value: Value) -> Value {
    remove_times(&mut value);
    value
}

/// Log points and summary of the same run on the command line.
fn expected(kind: Kind) -> (Value, Value) {
    let runs = Runs::new();
    let run = runs.train(kind, "run");
    let summary = serde_json::from_slice(&fs::read(run.join("summary.json")).unwrap()).unwrap();
    let points = metrics(&run).into_iter().map(Value::Object).collect::<Vec<_>>();
    (timeless(points.into()), timeless(summary))
}

/// Fails when a job that has ended is not what the command line trains.
#[track_caller]
fn assert_trained(server: &Server, id: &str, (points, summary): &(Value, Value)) {
    let job = server.job(id);
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(timeless(job["summary"].clone()), *summary);
    assert_eq!(timeless(server.points(id)), *points);
    let last = points.as_array().unwrap().last().unwrap();
    assert_eq!(job["env_steps"], last["env_steps"]);
    assert!(job["success_rate"].is_number(), "{job}");
}

fn assert_trains_what_the_command_line_trains(kind: Kind) {
    let folder = Folder::new();
    let server = Server::start(&folder, &[]);
    let id = server.submit(kind);
    let events: Vec<_> = server.events(&id, 0).collect();
    let expected = expected(kind);
    assert_trained(&server, &id, &expected);
    assert_eq!(timeless(points_of(&events)), expected.0);
    let kinds: Vec<_> = events
        .iter()
        .filter(|event| event.kind != "metric")
        .map(|event| event.kind.as_str())
        .collect();
    assert_eq!(kinds, ["state", "state", "state", "end"]);
    assert_eq!(events.last().unwrap().data, json!({"state": "succeeded"}));
}

#[test]
fn a_job_trains_what_the_command_line_trains_with_the_demonstrators_poses() {
    assert_trains_what_the_command_line_trains(ORACLE);
}

#[test]
fn a_job_trains_what_the_command_line_trains_with_learned_poses() {
    assert_trains_what_the_command_line_trains(LEARNED);
}

#[test]
fn a_waiting_and_a_running_job_can_be_seen_and_cancelled() {
    let folder = Folder::new();
    let server = Server::start(&folder, &[]);
    let (running, waiting) = (server.submit(LEARNED), server.submit(ORACLE));
    let mut events = server.events(&running, 0);
    let first_metric = events.find(|event| event.kind == "metric").unwrap();
    assert_eq!(first_metric.data["env_steps"], 0);
    let listed = |query: &str| {
        let jobs = server.get(&format!("/v1/jobs{query}")).json()["jobs"].take();
        jobs.as_array()
            .unwrap()
            .iter()
            .map(|job| job["id"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(listed(""), [waiting.as_str(), &running]);
    assert_eq!(listed("?state=running"), [running.as_str()]);
    assert_eq!(listed("?state=queued"), [waiting.as_str()]);
    assert_eq!(listed(&format!("?task={}", ORACLE.task)), [waiting.as_str()]);
    assert_eq!(server.processes().len(), 1);
    assert_eq!(server.cancel(&waiting).json()["state"], "cancelled");
    assert_eq!(server.cancel(&running).json()["state"], "cancelling");
    let last = events.last().unwrap();
    assert_eq!((last.kind.as_str(), &last.data), ("end", &json!({"state": "cancelled"})));
    server.wait_for_processes();
    for id in [&waiting, &running] {
        let again = server.cancel(id);
        assert_eq!((again.status, &again.json()["reason"]), (200, &json!("cancelled_by_user")));
    }
    assert!(server.job(&waiting)["started_at"].is_null());
}

#[test]
fn a_stream_that_breaks_goes_on_where_it_was() {
    let folder = Folder::new();
    let server = Server::start(&folder, &[]);
    let id = server.submit(ORACLE);
    // Readers that leave after a few events each, while the job runs.
    let mut seen: Vec<Event> = Vec::new();
    while seen.last().is_none_or(|event| event.kind != "end") {
        let after = seen.last().map_or(0, |event| event.id);
        seen.extend(server.events(&id, after).take(7));
    }
    let whole: Vec<_> = server.events(&id, 0).collect();
    assert_eq!(seen, whole);
    assert!(whole.windows(2).all(|pair| pair[0].id < pair[1].id));
    let middle = whole[whole.len() / 2].id;
    assert_eq!(server.events(&id, middle).collect::<Vec<_>>(), whole[whole.len() / 2 + 1..]);
    // After the end there is nothing to wait for.
    assert_eq!(
        server.get(&format!("/v1/jobs/{id}/events?after={}", whole.last().unwrap().id)).status,
        204
    );
}

#[test]
fn a_job_outlives_servers_that_are_killed_and_stopped() {
    let folder = Folder::new();
    let mut server = Server::start(&folder, &[]);
    let id = server.submit(ORACLE);
    let mut seen = Vec::new();
    // A reader takes the events of each server until its end.
    let mut read_until = |server: &Server, env_steps: u64| {
        let after = seen.last().map_or(0, |event: &Event| event.id);
        for event in server.events(&id, after) {
            seen.push(event);
            let last = seen.last().unwrap();
            if last.kind == "metric" && last.data["env_steps"].as_u64().unwrap() >= env_steps {
                return;
            }
        }
    };
    read_until(&server, 5);
    server.kill();
    // The next one waits for the process that has lost its server.
    server = Server::start(&folder, &[]);
    read_until(&server, 10);
    assert_eq!(server.processes().len(), 1, "{:?}", server.processes());
    server.kill();
    // Without a next one, too, it ends by itself.
    server.wait_for_processes();
    server = Server::start(&folder, &[]);
    read_until(&server, 15);
    assert_eq!(server.terminate(), Some(0));
    assert!(
        server.processes().is_empty(),
        "a stopped server has ended them: {:?}",
        server.processes()
    );
    assert!(!server.run(&id).join("summary.json").exists(), "the job was to be interrupted");
    server = Server::start(&folder, &[]);
    read_until(&server, u64::MAX);
    let expected = expected(ORACLE);
    assert_trained(&server, &id, &expected);
    let job = server.job(&id);
    let reasons: Vec<_> = job["transitions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|transition| transition["reason"].clone())
        .collect();
    assert_eq!(
        json!(reasons),
        json!([null, null, "worker_lost", null, "worker_lost", null, "server_stopped", null, null])
    );
    assert_eq!(job["attempt"], 4);
    // The one who watched all the time and one who comes later know the same.
    assert_eq!(timeless(points_of(&seen)), expected.0);
    assert_eq!(timeless(points_of(&server.events(&id, 0).collect::<Vec<_>>())), expected.0);
    assert_eq!(seen.last().unwrap().kind, "end");
}

#[test]
fn a_job_that_cannot_work_fails_with_what_its_process_said() {
    let folder = Folder::new();
    let server = Server::start(&folder, &[]);
    let mut settings: toml::Table = crate::runs::preset(&[]).parse().unwrap();
    settings["simulator"]["abort_force"] = 0.0.into();
    let job = json!({"task": "toilet_seat_up", "settings": settings, "oracle_poses": true});
    let id = server.post("/v1/jobs", &job).json()["id"].as_str().unwrap().to_owned();
    let events: Vec<_> = server.events(&id, 0).collect();
    assert!(events.iter().any(|event| event.is_state("failed")), "{events:?}");
    let job = server.job(&id);
    assert_eq!(job["message"], "environment: only 0 of 2 demonstrations succeeded");
    assert_eq!((&job["reason"], &job["summary"]), (&json!("exit_status"), &Value::Null));
}

/// A server's answer to a request, until it closes the connection.
fn answer_to(server: &Server, request: &[u8]) -> String {
    read_answer(&send(server, request))
}

/// A server's answer to a client that sends bytes and leaves.
fn answer_to_half(server: &Server, bytes: &[u8]) -> String {
    let socket = send(server, bytes);
    // It may have closed the connection already.
    let _ = socket.shutdown(Shutdown::Write);
    read_answer(&socket)
}

fn send(server: &Server, bytes: &[u8]) -> TcpStream {
    let mut socket = TcpStream::connect(server.host()).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    socket.write_all(bytes).unwrap();
    socket
}

fn read_answer(mut socket: &TcpStream) -> String {
    let mut answer = Vec::new();
    // A connection that is reset has answered nothing more.
    let _ = socket.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn no_request_is_answered_with_anything_but_a_problem() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "0"]);
    let id = server.submit(ORACLE);
    let head = format!("Host: {}\r\nConnection: close\r\n", server.host());
    let post = |body: &str| {
        let length = body.len();
        format!(
            "POST /v1/jobs HTTP/1.1\r\n{head}Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}"
        )
    };
    let requests = [
        format!("GET /nothing HTTP/1.1\r\n{head}\r\n"),
        format!("GET /v1/jobs/{id}/nothing HTTP/1.1\r\n{head}\r\n"),
        format!("GET /v1/jobs/%00%ff HTTP/1.1\r\n{head}\r\n"),
        format!("GET /v1/jobs?limit=-1&limit=2 HTTP/1.1\r\n{head}\r\n"),
        format!("GET /v1/jobs?%ff=%ff HTTP/1.1\r\n{head}\r\n"),
        format!("GET /%2e%2e/%2e%2e/etc/passwd HTTP/1.1\r\n{head}\r\n"),
        format!("GET /..%5c..%5cetc%5cpasswd HTTP/1.1\r\n{head}\r\n"),
        format!("GET //etc/passwd HTTP/1.1\r\n{head}\r\n"),
        format!("GET /{} HTTP/1.1\r\n{head}\r\n", "a/".repeat(3000)),
        format!("PATCH /v1/jobs/{id} HTTP/1.1\r\n{head}\r\n"),
        format!("OPTIONS * HTTP/1.1\r\n{head}\r\n"),
        format!("TRACE /v1/jobs HTTP/1.1\r\n{head}\r\n"),
        format!("POST /v1/jobs HTTP/1.1\r\n{head}\r\n"),
        format!(
            "POST /v1/jobs HTTP/1.1\r\n{head}Content-Type: application/json\r\nContent-Length: 9999999999\r\n\r\n"
        ),
        format!(
            "POST /v1/jobs HTTP/1.1\r\n{head}Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"
        ),
        format!("GET /v1/jobs/{id}/events HTTP/1.1\r\n{head}Last-Event-ID: \u{e9}\r\n\r\n"),
        post(""),
        post("{\"task\": \"reach_target\", \"settings\": {\"candidates\": []}}"),
        post(&"[".repeat(100_000)),
        post("{\"task\": \"\\ud800\"}"),
        post("{\"task\": \"reach_target\", \"demos\": 4294967296}"),
        "GET /healthz HTTP/1.0\r\n\r\n".to_owned(),
        "GET /healthz HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_owned(),
        format!("GET http://evil.example/healthz HTTP/1.1\r\n{head}\r\n"),
    ];
    for request in requests {
        let answer = answer_to(&server, request.as_bytes());
        let told = format!("{request:.100}: {answer:.600}");
        assert!(answer.starts_with("HTTP/1.1 4") || answer.starts_with("HTTP/1.0 4"), "{told}");
        assert!(answer.contains("content-type: application/problem+json"), "{told}");
    }
    // What is no request is not answered by the API, and does no harm.
    let half = format!(
        "POST /v1/jobs HTTP/1.1\r\n{head}Content-Type: application/json\r\nContent-Length: 99\r\n\r\n{{}}"
    );
    let texts = [
        "\0\0\0\0",
        "GET\r\n\r\n",
        "\x16\x03\x01\x02",
        "GET / HTTP/9.9\r\n\r\n",
        "",
        "POST /v1/jobs HTT",
        &half,
    ];
    for bytes in texts.map(str::as_bytes) {
        let answer = answer_to_half(&server, bytes);
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 400 "), "{bytes:?}: {answer}");
    }
    assert_eq!(server.get("/healthz").status, 200);
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 1);
}

#[test]
fn the_server_says_what_it_cannot_use() {
    let folder = Folder::new();
    let server = Server::start(&folder, &[]);
    let refusal = |data: &str, options: &[&str], status: i32| {
        let mut command = command(&folder.path().join(data), options);
        let output: Output = command.stdout(Stdio::piped()).output().unwrap();
        last_line_of_failure(&command, &output, status, 1)
    };
    assert!(refusal("data", &[], 1).contains("another server uses this directory"));
    fs::write(folder.path().join("file"), "mine").unwrap();
    assert!(refusal("file", &[], 1).contains("file: cannot create"));
    fs::create_dir(folder.path().join("notes")).unwrap();
    fs::write(folder.path().join("notes/lpr.sqlite"), "x".repeat(5000)).unwrap();
    assert!(refusal("notes", &[], 1).contains("notes/lpr.sqlite: cannot be used as the database"));
    for (bind, status, says) in [
        (server.host(), 1, format!("--bind {}: Address already in use", server.host())),
        ("0.0.0.0:0", 2, "--bind 0.0.0.0:0: only a loopback address".to_owned()),
        ("127.0.0.1", 2, "--bind".to_owned()),
    ] {
        let data = folder.at("other");
        let mut command = crate::lpr::command(&["serve", "--bind", bind, "--data-dir", &data]);
        let output = command.output().unwrap();
        let error = last_line_of_failure(&command, &output, status, 1);
        assert!(error.contains(&says), "{error}");
        assert!(!folder.path().join("other").exists());
    }
    assert!(refusal("other", &["--workers", "many"], 2).contains("--workers"));
}
