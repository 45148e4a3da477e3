//! A real `lpr serve` on a free port, and what a client of it does.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{self, Folder};
use crate::runs::{self, Kind};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead as _, BufReader, Lines};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use ureq::http::Response;
use ureq::{Agent, Body, BodyReader};

/// Far more than anything here takes.
const PATIENCE: Duration = Duration::from_secs(120);

/// A server with its data; both end with it.
pub(crate) struct Server {
    child: Child,
    /// Kept open: what it reports goes somewhere.
    _stderr: BufReader<ChildStderr>,
    address: String,
    agent: Agent,
    data: PathBuf,
}

/// An answer with its body.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) body: String,
}

impl Answer {
    fn of(mut response: Response<Body>) -> Self {
        Self {
            status: response.status().as_u16(),
            body: response.body_mut().read_to_string().unwrap(),
        }
    }

    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.body))
    }
}

/// The command of a server on a free port.
pub(crate) fn command(data: &Path, options: &[&str]) -> Command {
    let data = data.to_str().unwrap();
    lpr::command(&[&["serve", "--bind", "127.0.0.1:0", "--data-dir", data], options].concat())
}

impl Server {
    /// Starts a server on the data in `folder`.
    pub(crate) fn start(folder: &Folder, options: &[&str]) -> Self {
        let data = folder.path().join("data");
        let mut child = command(&data, options).stderr(Stdio::piped()).spawn().unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        stderr.read_line(&mut line).unwrap();
        let address =
            line.trim().strip_prefix("lpr: ").unwrap_or_else(|| panic!("{line}")).to_owned();
        assert!(address.starts_with("http://127.0.0.1:"), "{address}");
        let agent = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(PATIENCE))
            .build()
            .into();
        Self { child, _stderr: stderr, address, agent, data }
    }

    /// Its address without `http://`.
    pub(crate) fn host(&self) -> &str {
        &self.address["http://".len()..]
    }

    /// The run directory of a job.
    pub(crate) fn run(&self, id: &str) -> PathBuf {
        self.data.join(format!("jobs/{id}/run"))
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        Answer::of(self.agent.get(format!("{}{path}", self.address)).call().unwrap())
    }

    pub(crate) fn post(&self, path: &str, body: &Value) -> Answer {
        let request = self
            .agent
            .post(format!("{}{path}", self.address))
            .header("content-type", "application/json");
        Answer::of(request.send(body.to_string()).unwrap())
    }

    pub(crate) fn job(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}")).json()
    }

    pub(crate) fn cancel(&self, id: &str) -> Answer {
        self.post(&format!("/v1/jobs/{id}/cancel"), &Value::Null)
    }

    /// Submits a small job; its identifier.
    #[track_caller]
    pub(crate) fn submit(&self, kind: Kind) -> String {
        let answer = self.post("/v1/jobs", &small_job(kind));
        assert_eq!(answer.status, 201, "{answer:?}");
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// The log points of a job.
    pub(crate) fn points(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}/metrics")).json()["points"].take()
    }

    /// The events of a job after event number `after`.
    pub(crate) fn events(&self, id: &str, after: i64) -> Events {
        let request = self.agent.get(format!("{}/v1/jobs/{id}/events", self.address));
        let response = request.header("last-event-id", after.to_string()).call().unwrap();
        assert_eq!(response.status(), 200);
        Events(BufReader::new(response.into_body().into_reader()).lines())
    }

    /// Ends the process without a chance to do anything about it.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Asks the process to end, as a terminal or a service manager does; its exit status.
    pub(crate) fn terminate(&mut self) -> Option<i32> {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
        self.child.wait().unwrap().code()
    }

    /// The training processes of this server's jobs.
    pub(crate) fn processes(&self) -> Vec<String> {
        let data = self.data.join("jobs");
        let arguments = fs::read_dir("/proc").unwrap().filter_map(|entry| {
            let arguments = fs::read(entry.ok()?.path().join("cmdline")).ok()?;
            Some(String::from_utf8_lossy(&arguments).replace('\0', " "))
        });
        arguments.filter(|arguments| arguments.contains(data.to_str().unwrap())).collect()
    }

    /// Waits until no training process is left.
    #[track_caller]
    pub(crate) fn wait_for_processes(&self) {
        let deadline = Instant::now() + PATIENCE;
        while !self.processes().is_empty() {
            assert!(Instant::now() < deadline, "{:?} outlive their server", self.processes());
            sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Of one that has ended, too.
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.wait_for_processes();
    }
}

/// The job that trains what [`runs::Runs::arguments`] do.
pub(crate) fn small_job(kind: Kind) -> Value {
    let settings: toml::Table = runs::preset(&[]).parse().unwrap();
    let steps: u64 = runs::STEPS.parse().unwrap();
    let oracle_poses = kind.options.contains(&"--oracle-poses");
    json!({"task": kind.task, "settings": settings, "seed": 3, "env_steps": steps, "oracle_poses": oracle_poses})
}

/// An event of a stream.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    pub(crate) id: i64,
    pub(crate) kind: String,
    pub(crate) data: Value,
}

impl Event {
    /// True if it tells that the job came to that state.
    pub(crate) fn is_state(&self, state: &str) -> bool {
        self.kind == "state" && self.data["state"] == state
    }
}

/// A stream of events, which waits for the next one; it ends when the server closes it.
pub(crate) struct Events(Lines<BufReader<BodyReader<'static>>>);

impl Iterator for Events {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let (mut id, mut kind, mut data) = (None, None, None);
        loop {
            // A server that was killed breaks the connection.
            let line = self.0.next()?.ok()?;
            match line.split_once(": ") {
                Some(("id", value)) => id = value.parse().ok(),
                Some(("event", value)) => kind = Some(value.to_owned()),
                Some(("data", value)) => data = serde_json::from_str(value).ok(),
                // A ping is no event.
                _ if line.is_empty() && id.is_some() => {
                    return Some(Event { id: id?, kind: kind.unwrap(), data: data.unwrap() });
                }
                _ => {}
            }
        }
    }
}

/// The log points that hold at the end of a stream.
pub(crate) fn points_of(events: &[Event]) -> Value {
    let mut points = Vec::new();
    for event in events {
        match event.kind.as_str() {
            "metric" => points.push(event.data.clone()),
            "rewind" => points.truncate(event.data["points"].as_u64().unwrap().try_into().unwrap()),
            _ => {}
        }
    }
    points.into()
}
