use super::*;
use crate::jobs::event::{Event, Point};
use crate::jobs::state::Refused;
use serde_json::json;
use tempfile::TempDir;
use tokio::task::JoinSet;

/// A store in a folder of its own.
async fn store() -> (TempDir, SqliteStore) {
    let folder = tempfile::tempdir().unwrap();
    let store = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap();
    (folder, store)
}

fn spec(task: &str) -> JobSpec {
    serde_json::from_value(json!({"task": task})).unwrap()
}

async fn submit(store: &SqliteStore, task: &str) -> JobId {
    store.submit(&spec(task), None).await.unwrap().id
}

async fn claim(store: &SqliteStore) -> Claim {
    store.claim().await.unwrap().unwrap().0
}

fn point(env_steps: u64) -> Point {
    Point {
        env_steps,
        line: json!({"env_steps": env_steps, "validation/success_rate": 0.1}).to_string(),
    }
}

fn states(job: &Job) -> Vec<(State, Option<Reason>)> {
    job.transitions.iter().map(|transition| (transition.state, transition.reason)).collect()
}

async fn kinds(store: &SqliteStore, id: JobId) -> Vec<String> {
    store.events(id, 0, 100).await.unwrap().into_iter().map(|event| event.kind).collect()
}

#[tokio::test]
async fn a_job_goes_through_its_states() {
    let (_folder, store) = store().await;
    let id = submit(&store, "reach_target").await;
    let claim = claim(&store).await;
    assert_eq!(claim, Claim { id, attempt: 1 });
    store.append_points(claim, &[point(0), point(4)]).await.unwrap();
    let summary = json!({"env_steps": 4}).as_object().cloned();
    let ended = Ended { summary: summary.clone(), ..Ended::new(Change::Succeeded) };
    store.finish(claim, &ended).await.unwrap();
    let job = store.job(id).await.unwrap();
    assert_eq!(
        states(&job),
        [(State::Queued, None), (State::Running, None), (State::Succeeded, None)]
    );
    assert_eq!(
        (job.env_steps, job.success_rate, job.summary.as_ref()),
        (Some(4), Some(0.1), summary.as_ref())
    );
    assert!(job.created_at <= job.started_at.unwrap() && job.started_at <= job.finished_at);
    assert_eq!(kinds(&store, id).await, ["state", "state", "metric", "metric", "state", "end"]);
    assert_eq!(store.end(id).await.unwrap(), Some(6));
}

#[tokio::test]
async fn jobs_are_kept_when_the_store_is_opened_again() {
    let (folder, store) = store().await;
    let id = submit(&store, "reach_target").await;
    let before = store.job(id).await.unwrap();
    drop(store);
    let store = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap();
    assert_eq!(store.job(id).await.unwrap(), before);
}

#[tokio::test]
async fn lists_are_newest_first_and_filtered() {
    let (_folder, store) = store().await;
    let mut ids = Vec::new();
    for task in ["reach_target", "open_drawer", "reach_target", "reach_target"] {
        ids.push(submit(&store, task).await);
    }
    store.cancel(ids[2]).await.unwrap();
    let list = async |filter: Filter, limit| {
        let jobs = store.jobs(&filter, limit).await.unwrap();
        jobs.iter().map(|job| ids.iter().position(|id| *id == job.id).unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(list(Filter::default(), 9).await, [3, 2, 1, 0]);
    assert_eq!(list(Filter { before: Some(ids[2]), ..Filter::default() }, 1).await, [1]);
    assert_eq!(
        list(Filter { task: Some("open_drawer".to_owned()), ..Filter::default() }, 9).await,
        [1]
    );
    let queued =
        Filter { state: Some(State::Queued), task: Some("reach_target".to_owned()), before: None };
    assert_eq!(list(queued, 9).await, [3, 0]);
}

#[tokio::test]
async fn a_key_adds_one_job_however_often_and_from_how_many_it_comes() {
    let (_folder, store) = store().await;
    let spec = spec("reach_target");
    let submit = |(store, spec): (SqliteStore, JobSpec)| async move {
        store.submit(&spec, Some("mine")).await.unwrap()
    };
    let answers: JoinSet<_> = (0..50).map(|_| submit((store.clone(), spec.clone()))).collect();
    let answers = answers.join_all().await;
    assert!(answers.iter().all(|answer| *answer == answers[0]));
    assert_eq!(store.jobs(&Filter::default(), 9).await.unwrap().len(), 1);
    // The answer is the first one, whatever has become of the job.
    store.cancel(answers[0].id).await.unwrap();
    assert_eq!(store.submit(&spec, Some("mine")).await.unwrap(), answers[0]);
    let other = JobSpec { seed: 1, ..spec };
    assert!(matches!(store.submit(&other, Some("mine")).await, Err(StoreError::KeyReused)));
    assert_ne!(store.submit(&other, Some("other")).await.unwrap().id, answers[0].id);
}

#[tokio::test]
async fn every_job_is_claimed_once_and_the_oldest_first() {
    let (_folder, store) = store().await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        ids.push(submit(&store, "reach_target").await);
    }
    let take = |store: SqliteStore| async move { store.claim().await.unwrap() };
    let claims: JoinSet<_> = (0..20).map(|_| take(store.clone())).collect();
    let mut claimed: Vec<_> =
        claims.join_all().await.into_iter().filter_map(|claim| Some(claim?.0.id)).collect();
    claimed.sort();
    assert_eq!(claimed, ids);
    let waiting = [submit(&store, "reach_target").await, submit(&store, "reach_target").await];
    assert_eq!(claim(&store).await.id, waiting[0]);
}

#[tokio::test]
async fn an_earlier_attempt_cannot_write_any_more() {
    let (_folder, store) = store().await;
    let id = submit(&store, "reach_target").await;
    let lost = claim(&store).await;
    store.recover().await.unwrap();
    assert!(
        matches!(store.append_points(lost, &[point(0)]).await, Err(StoreError::Stale)),
        "while the job waits"
    );
    let second = claim(&store).await;
    assert_eq!(second, Claim { id, attempt: 2 });
    assert!(matches!(store.append_points(lost, &[point(0)]).await, Err(StoreError::Stale)));
    assert!(matches!(store.rewind(lost, None).await, Err(StoreError::Stale)));
    assert!(matches!(store.state(lost).await, Err(StoreError::Stale)));
    assert!(matches!(
        store.finish(lost, &Ended::new(Change::Succeeded)).await,
        Err(StoreError::Stale)
    ));
    assert!(matches!(store.lose(lost, None).await, Err(StoreError::Stale)));
    store.append_points(second, &[point(0)]).await.unwrap();
    store.finish(second, &Ended::new(Change::Succeeded)).await.unwrap();
    assert!(
        matches!(store.append_points(second, &[point(1)]).await, Err(StoreError::Stale)),
        "after its end"
    );
    assert_eq!(store.points(id).await.unwrap(), [point(0).line]);
}

#[tokio::test]
async fn a_job_that_is_lost_three_times_fails() {
    let (_folder, store) = store().await;
    let id = submit(&store, "reach_target").await;
    for _ in 0..2 {
        claim(&store).await;
        store.recover().await.unwrap();
        assert_eq!(store.job(id).await.unwrap().reason, Some(Reason::WorkerLost));
    }
    // A stop in good order does not count.
    store.finish(claim(&store).await, &Ended::new(Change::ServerStopped)).await.unwrap();
    store.lose(claim(&store).await, Some("short of memory".to_owned())).await.unwrap();
    let job = store.job(id).await.unwrap();
    assert_eq!((job.state, job.reason, job.attempt), (State::Failed, Some(Reason::MaxAttempts), 4));
    assert_eq!(job.message.as_deref(), Some("short of memory"));
    assert!(store.claim().await.unwrap().is_none());
}

#[tokio::test]
async fn cancelling_is_idempotent_and_comes_too_late_for_what_has_ended() {
    let (_folder, store) = store().await;
    let waiting = submit(&store, "reach_target").await;
    for _ in 0..2 {
        assert_eq!(store.cancel(waiting).await.unwrap().state, State::Cancelled);
    }
    assert_eq!(kinds(&store, waiting).await, ["state", "state", "end"]);
    let running = submit(&store, "reach_target").await;
    let running_claim = claim(&store).await;
    for _ in 0..2 {
        assert_eq!(store.cancel(running).await.unwrap().state, State::Cancelling);
    }
    // Whatever became of it meanwhile.
    store.finish(running_claim, &Ended::new(Change::Succeeded)).await.unwrap();
    assert_eq!(store.cancel(running).await.unwrap().reason, Some(Reason::CancelledByUser));
    let failed = submit(&store, "reach_target").await;
    store.finish(claim(&store).await, &Ended::failed(Reason::ExitStatus, None)).await.unwrap();
    assert!(matches!(
        store.cancel(failed).await,
        Err(StoreError::Refused(Refused { state: State::Failed }))
    ));
    assert!(matches!(store.cancel(JobId::generate()).await, Err(StoreError::NoSuchJob)));
}

#[tokio::test]
async fn a_rewind_takes_later_points_out_of_the_history_and_tells_so() {
    let (_folder, store) = store().await;
    let id = submit(&store, "reach_target").await;
    let claim = claim(&store).await;
    store.rewind(claim, None).await.unwrap();
    store.append_points(claim, &[0, 4, 4, 5, 6].map(point)).await.unwrap();
    let last_seen = store.events(id, 0, 100).await.unwrap().last().unwrap().seq;
    store.rewind(claim, Some(4)).await.unwrap();
    assert_eq!(store.points(id).await.unwrap(), [0, 4, 4].map(|step| point(step).line));
    let news = store.events(id, last_seen, 100).await.unwrap();
    let [Event { kind, data, .. }] = &news[..] else { panic!("{news:?}") };
    assert_eq!((kind.as_str(), data.as_str()), ("rewind", r#"{"env_steps":4,"points":3}"#));
    // Where nothing is void, nothing is told.
    store.rewind(claim, Some(4)).await.unwrap();
    assert_eq!(kinds(&store, id).await, ["state", "state", "metric", "metric", "metric", "rewind"]);
    store.rewind(claim, None).await.unwrap();
    assert_eq!(store.n_points(id).await.unwrap(), 0);
    assert_eq!(
        store.events(id, 0, 100).await.unwrap().last().unwrap().data,
        r#"{"env_steps":null,"points":0}"#
    );
}

#[tokio::test]
async fn a_file_that_is_no_database_is_refused_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lpr.sqlite");
    std::fs::write(
        &path,
        "my notes, which are long enough for a header of a database, and then some more of them",
    )
    .unwrap();
    let before = std::fs::read(&path).unwrap();
    let error = SqliteStore::open(&path).await.unwrap_err().to_string();
    assert!(
        error.starts_with(&format!("{}: cannot be used as the database", path.display())),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[tokio::test]
async fn a_database_of_a_newer_version_is_refused() {
    let (folder, store) = store().await;
    let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) VALUES (99, '', 1, x'', 0)";
    query(newer).execute(&store.pool).await.unwrap();
    let error = SqliteStore::open(&folder.path().join("lpr.sqlite")).await.unwrap_err().to_string();
    assert!(error.contains("newer version of lpr: it has migration 99"), "{error}");
}
