//! Streams of events.

use super::*;
use crate::jobs::JobSpec;

/// The events of a stream to its end: identifier, kind, data.
fn events(answer: &Answer) -> Vec<(i64, String, Value)> {
    let field = |event: &str, name: &str| {
        let line = event.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
        line.unwrap_or_else(|| panic!("no {name} in {event:?}")).to_owned()
    };
    let events = answer.body.split_terminator("\n\n").filter(|event| !event.starts_with(':'));
    let read = |event| {
        (
            field(event, "id").parse().unwrap(),
            field(event, "event"),
            serde_json::from_str(&field(event, "data")).unwrap(),
        )
    };
    events.map(read).collect()
}

#[tokio::test]
async fn a_stream_tells_all_goes_on_anywhere_and_ends() {
    let service = Service::new().await;
    let id = service.submit(&reach()).await.json()["id"].as_str().unwrap().to_owned();
    service.end_next(Change::Succeeded).await;
    let path = format!("/v1/jobs/{id}/events");
    let answer = service.get(&path).await;
    assert_eq!((answer.status, answer.header("content-type")), (200, "text/event-stream"));
    assert_eq!(
        (answer.header("x-accel-buffering"), answer.header("cache-control")),
        ("no", "no-cache")
    );
    let all = events(&answer);
    let kinds: Vec<_> = all.iter().map(|(_, kind, _)| kind.as_str()).collect();
    assert_eq!(kinds, ["state", "state", "state", "end"]);
    assert_eq!(all[3].2, json!({"state": "succeeded"}));
    let job = service.get(&format!("/v1/jobs/{id}")).await.json();
    assert_eq!(
        job["transitions"],
        Value::from(all[..3].iter().map(|(_, _, data)| data.clone()).collect::<Vec<_>>())
    );
    for (idx, (seq, ..)) in all.iter().enumerate() {
        // The header goes before the parameter.
        let again =
            request("GET", &format!("{path}?after=0")).header("Last-Event-ID", seq.to_string());
        let again = service.answer(again.body(Body::empty()).unwrap()).await;
        assert_eq!(events(&again), all[idx + 1..]);
        assert_eq!(again.status, if idx == 3 { 204 } else { 200 });
        assert_eq!(events(&service.get(&format!("{path}?after={seq}")).await), all[idx + 1..]);
    }
    let soon = request("GET", &path).header("Last-Event-ID", "soon").body(Body::empty()).unwrap();
    service.answer(soon).await.assert_problem(400, "invalid_header");
}

#[tokio::test]
async fn a_stream_of_a_waiting_job_ends_with_the_server() {
    let service = Service::new().await;
    let id = service.submit(&reach()).await.json()["id"].as_str().unwrap().to_owned();
    let path = format!("/v1/jobs/{id}/events");
    let response = service
        .app
        .clone()
        .oneshot(request("GET", &path).body(Body::empty()).unwrap())
        .await
        .unwrap();
    service.phase.send(Phase::Stopping).unwrap();
    let seen = events(&Answer::of(response).await);
    assert_eq!(seen.len(), 1, "{seen:?}");
}

#[tokio::test]
async fn a_stream_reads_more_than_it_holds_at_a_time() {
    let service = Service::new().await;
    let spec: JobSpec = serde_json::from_value(reach()).unwrap();
    let id = service.store.submit(&spec, None).await.unwrap().id;
    for _ in 0..400 {
        let (claim, _) = service.store.claim().await.unwrap().unwrap();
        service.store.finish(claim, &Ended::new(Change::ServerStopped)).await.unwrap();
    }
    service.store.cancel(id).await.unwrap();
    assert_eq!(events(&service.get(&format!("/v1/jobs/{id}/events")).await).len(), 1 + 2 * 400 + 2);
}
