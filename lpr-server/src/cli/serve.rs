//! `lpr serve`: the REST API, the workers behind it, and the page.

use super::failure::{Failure, Result};
use crate::api::{self, Api};
use crate::jobs::{DataDirectory, Phase, SqliteStore, Worker, report, stopping};
use clap::Args;
use core::time::Duration;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use tokio::net::TcpListener;
use tokio::runtime;
use tokio::sync::watch;
use tokio::task::JoinSet;

/// Time that requests which are being answered may take when the server stops.
const GRACE: Duration = Duration::from_secs(5);

/// Options of `lpr serve`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address to listen on; port 0 is any free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    bind: SocketAddr,
    /// Directory of jobs and their runs
    #[arg(long, value_name = "DIR", default_value = "lpr-data")]
    data_dir: PathBuf,
    /// Jobs that run at a time; with none, jobs wait
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(0..=64))]
    workers: u16,
    /// The files of the page
    #[arg(long, value_name = "DIR", default_value = "www/dist")]
    page: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let bind = arguments.bind;
    if !bind.ip().is_loopback() {
        let message = format!(
            "--bind {bind}: only a loopback address for now, such as 127.0.0.1: there is no authentication yet"
        );
        return Err(Failure::Usage(message));
    }
    let runtime = runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(Failure::Server)?;
    runtime.block_on(serve(arguments))
}

async fn serve(arguments: &Arguments) -> Result<()> {
    let address = arguments.bind;
    let unusable = |source| Failure::Listen { address, source };
    let listener = TcpListener::bind(address).await.map_err(unusable)?;
    let data = DataDirectory::open(&arguments.data_dir)?;
    let store = SqliteStore::open(&data.database()).await?;
    store.recover().await.map_err(|error| Failure::Server(io::Error::other(error)))?;
    report(&format!("http://{}", listener.local_addr().map_err(unusable)?));
    let phase = phase_of_signals().map_err(Failure::Server)?;
    let mut workers = start_workers(arguments.workers, &store, &data, &phase)?;
    let api = Api { store: store.clone(), phase: phase.clone(), page: arguments.page.clone() };
    let served = answer(listener, api, phase).await;
    // Their children are ended and their jobs are back in the queue when they have.
    while let Some(ended) = workers.join_next().await {
        // One that panicked keeps no other from ending well.
        ended.unwrap_or_else(|error| report(&format!("a worker: {error}")));
    }
    store.close().await;
    served.map_err(Failure::Server)
}

fn start_workers(
    n_workers: u16,
    store: &SqliteStore,
    data: &DataDirectory,
    phase: &watch::Receiver<Phase>,
) -> Result<JoinSet<()>> {
    let program = std::env::current_exe().map_err(Failure::Server)?;
    let worker = Worker { store: store.clone(), program, jobs: data.jobs(), phase: phase.clone() };
    Ok((0..n_workers).map(|_| worker.clone().work()).collect())
}

/// Answers requests until the server stops, and those that have begun a little longer.
async fn answer(listener: TcpListener, api: Api, phase: watch::Receiver<Phase>) -> io::Result<()> {
    let stopped = |mut phase: watch::Receiver<Phase>| async move { stopping(&mut phase).await };
    let server =
        axum::serve(listener, api::app(api)).with_graceful_shutdown(stopped(phase.clone()));
    let late = async {
        stopped(phase).await;
        tokio::time::sleep(GRACE).await;
    };
    tokio::select! {
        served = server.into_future() => served,
        () = late => Ok(()),
    }
}

/// Changes to stopping when the process is asked to end.
fn phase_of_signals() -> io::Result<watch::Receiver<Phase>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut interrupt, mut terminate) =
        (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    let (phase, receiver) = watch::channel(Phase::Serving);
    tokio::spawn(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        // With no one left to tell, it has stopped already.
        let _ = phase.send(Phase::Stopping);
    });
    Ok(receiver)
}
