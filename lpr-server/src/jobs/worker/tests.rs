//! Workers with a shell script in the place of `lpr`: its fourth argument is the run directory.

use super::*;
use crate::jobs::{Job, JobId};
use serde_json::json;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use tempfile::TempDir;
use tokio::task::JoinHandle;
use tokio::time::timeout;

/// Far more than anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// Leaves two points and waits until standard input closes.
const WAITS: &str = r#"mkdir -p "$4"; echo '{"env_steps":0}' > "$4/metrics.jsonl"; echo '{"env_steps":1}' >> "$4/metrics.jsonl"; exec cat"#;
/// Leaves a point and a summary.
const SUCCEEDS: &str = r#"mkdir -p "$4"; echo '{"env_steps":0}' >> "$4/metrics.jsonl"; echo '{"env_steps":0}' > "$4/summary.json""#;

/// A server without an API.
struct Server {
    folder: TempDir,
    store: SqliteStore,
    phase: watch::Sender<Phase>,
    worker: JoinHandle<()>,
}

impl Server {
    async fn start(script: &str) -> Self {
        Self::restart(tempfile::tempdir().unwrap(), script).await
    }

    async fn restart(folder: TempDir, script: &str) -> Self {
        let store = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap();
        let program = folder.path().join("lpr.sh");
        // Whole or not at all: what is still being written cannot be run.
        files::write_atomically(&program, |file| {
            write!(file, "#!/bin/sh\necho \"$@\" >> \"$4.calls\"\n{script}\n")
        })
        .unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let (phase, receiver) = watch::channel(Phase::Serving);
        let jobs = folder.path().join("jobs");
        let worker = Worker { store: store.clone(), program, jobs, phase: receiver };
        Self { folder, store, phase, worker: tokio::spawn(worker.work()) }
    }

    async fn stop(self) -> TempDir {
        self.phase.send(Phase::Stopping).unwrap();
        timeout(PATIENCE, self.worker).await.unwrap().unwrap();
        self.folder
    }

    async fn submit(&self) -> JobId {
        let spec = serde_json::from_value(json!({"task": "reach_target"})).unwrap();
        self.store.submit(&spec, None).await.unwrap().id
    }

    /// The job once it is as wanted.
    async fn job_when(&self, id: JobId, wanted: impl Fn(&Job) -> bool) -> Job {
        let mut changes = self.store.changes();
        let found = async {
            loop {
                changes.mark_unchanged();
                let job = self.store.job(id).await.unwrap();
                if wanted(&job) {
                    return job;
                }
                changes.changed().await.unwrap();
            }
        };
        timeout(PATIENCE, found).await.unwrap()
    }

    async fn job_in(&self, id: JobId, state: State) -> Job {
        self.job_when(id, |job| job.state == state).await
    }
}

fn run_directory(folder: &Path, id: JobId) -> PathBuf {
    folder.join(format!("jobs/{id}/run"))
}

/// The arguments of every call of the program for a job.
fn calls(folder: &Path, id: JobId) -> Vec<String> {
    let text = fs::read_to_string(folder.join(format!("jobs/{id}/run.calls"))).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[tokio::test]
async fn a_job_succeeds_with_its_points_and_its_summary() {
    let server = Server::start(SUCCEEDS).await;
    let ids = [server.submit().await, server.submit().await];
    for id in ids {
        let job = server.job_in(id, State::Succeeded).await;
        assert_eq!(job.summary, json!({"env_steps": 0}).as_object().cloned());
        assert_eq!(server.store.points(id).await.unwrap(), [r#"{"env_steps":0}"#]);
        let calls = calls(server.folder.path(), id);
        assert!(calls.len() == 1 && calls[0].ends_with("--until-stdin-closes"), "{calls:?}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_failed_job_says_what_its_process_said_last() {
    for (script, message) in [
        (
            "echo building >&2; echo 'error: only 0 of 2 demonstrations succeeded' >&2; exit 1",
            "only 0 of 2 demonstrations succeeded",
        ),
        ("exit 0", "the process left no summary"),
    ] {
        let server = Server::start(script).await;
        let job = server.job_in(server.submit().await, State::Failed).await;
        assert_eq!((job.reason, job.message.as_deref()), (Some(Reason::ExitStatus), Some(message)));
        server.stop().await;
    }
}

#[tokio::test]
async fn a_program_that_cannot_be_run_fails_the_job() {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap();
    let (phase, receiver) = watch::channel(Phase::Serving);
    let program = folder.path().join("absent");
    let worker =
        Worker { store: store.clone(), program, jobs: folder.path().join("jobs"), phase: receiver };
    let server = Server { folder, store, phase, worker: tokio::spawn(worker.work()) };
    let job = server.job_in(server.submit().await, State::Failed).await;
    assert_eq!(job.reason, Some(Reason::WorkerError));
    assert!(job.message.unwrap().starts_with("the training process: No such file"));
    server.stop().await;
}

#[tokio::test]
async fn a_cancelled_job_ends_its_process() {
    let server = Server::start(WAITS).await;
    let id = server.submit().await;
    server.job_when(id, |job| job.env_steps == Some(1)).await;
    server.store.cancel(id).await.unwrap();
    let job = server.job_in(id, State::Cancelled).await;
    assert_eq!((job.reason, job.summary), (Some(Reason::CancelledByUser), None));
    let states: Vec<_> = job.transitions.iter().map(|transition| transition.state).collect();
    assert_eq!(states, [State::Queued, State::Running, State::Cancelling, State::Cancelled]);
    // The worker is free, and so is the log: the process is gone.
    let folder = folder::of_job(&server.folder.path().join("jobs"), id).unwrap();
    spawn_blocking(move || folder.lock_log()).await.unwrap().unwrap();
    server.stop().await;
}

#[tokio::test]
async fn a_stopped_server_goes_on_from_the_checkpoint() {
    let server = Server::start(WAITS).await;
    let id = server.submit().await;
    server.job_when(id, |job| job.env_steps == Some(1)).await;
    let folder = server.stop().await;
    fs::create_dir_all(run_directory(folder.path(), id).join("checkpoints/00000000")).unwrap();
    let server = Server::restart(folder, SUCCEEDS).await;
    let job = server.job_in(id, State::Succeeded).await;
    let states: Vec<_> =
        job.transitions.iter().map(|transition| (transition.state, transition.reason)).collect();
    let expected = [
        (State::Queued, None),
        (State::Running, None),
        (State::Queued, Some(Reason::ServerStopped)),
        (State::Running, None),
        (State::Succeeded, None),
    ];
    assert_eq!(states, expected);
    assert_eq!(calls(server.folder.path(), id).len(), 2);
    assert!(calls(server.folder.path(), id)[1].ends_with("--resume"));
    // The point after the checkpoint is gone, and another has come.
    let points: Vec<String> = server.store.points(id).await.unwrap();
    assert_eq!(points, [r#"{"env_steps":0}"#, r#"{"env_steps":0}"#]);
    let events = server.store.events(id, 0, 100).await.unwrap();
    let rewind = events.iter().find(|event| event.kind == "rewind").unwrap();
    assert_eq!(rewind.data, r#"{"env_steps":0,"points":1}"#);
    server.stop().await;
}

#[tokio::test]
async fn a_run_without_a_checkpoint_starts_anew() {
    let server = Server::start(WAITS).await;
    let id = server.submit().await;
    server.job_when(id, |job| job.env_steps == Some(1)).await;
    let folder = server.stop().await;
    fs::write(run_directory(folder.path(), id).join("torn"), "").unwrap();
    let server = Server::restart(folder, SUCCEEDS).await;
    server.job_in(id, State::Succeeded).await;
    assert!(!run_directory(server.folder.path(), id).join("torn").exists());
    assert!(!calls(server.folder.path(), id)[1].contains("--resume"));
    assert_eq!(server.store.points(id).await.unwrap(), [r#"{"env_steps":0}"#]);
    server.stop().await;
}

#[tokio::test]
async fn a_run_that_had_ended_when_its_server_was_killed_is_not_run_again() {
    let server = Server::start(WAITS).await;
    let id = server.submit().await;
    server.job_when(id, |job| job.env_steps.is_some()).await;
    let folder = server.stop().await;
    let run = run_directory(folder.path(), id);
    // What the process did after the server's last look.
    fs::write(
        run.join("metrics.jsonl"),
        "{\"env_steps\":0}\n{\"env_steps\":1}\n{\"env_steps\":2}\n",
    )
    .unwrap();
    fs::write(run.join("summary.json"), r#"{"env_steps":2}"#).unwrap();
    let server = Server::restart(folder, "exit 1").await;
    let job = server.job_in(id, State::Succeeded).await;
    assert_eq!(
        (job.env_steps, job.summary),
        (Some(2), json!({"env_steps": 2}).as_object().cloned())
    );
    assert_eq!(server.store.points(id).await.unwrap().len(), 3);
    assert_eq!(calls(server.folder.path(), id).len(), 1);
    server.stop().await;
}

#[tokio::test]
async fn a_process_that_is_killed_again_and_again_fails_the_job() {
    let server = Server::start("kill -9 $$").await;
    let id = server.submit().await;
    let job = server.job_in(id, State::Failed).await;
    assert_eq!((job.reason, job.attempt), (Some(Reason::MaxAttempts), 3));
    assert!(job.message.unwrap().contains("signal: 9"));
    assert_eq!(calls(server.folder.path(), id).len(), 3);
    server.stop().await;
}

#[tokio::test]
async fn a_log_is_free_when_the_process_that_writes_to_it_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = JobFolder::create(folder.path().to_owned()).unwrap();
    let log = folder.lock_log().unwrap();
    let mut process = Process::start(Path::new("cat"), &[], log.for_process().unwrap()).unwrap();
    // As when the server is killed: its hold is gone, the process's is not.
    drop(log);
    let again = fs::File::open(folder.run().with_file_name("log")).unwrap();
    assert!(matches!(again.try_lock(), Err(fs::TryLockError::WouldBlock)));
    process.kill().await.unwrap();
    assert!(again.try_lock().is_ok());
}
