//! Training jobs: what they are, where they are kept, and the workers that run them.
//!
//! A job is run by a child process of this binary. It goes through the states of [`State`];
//! everything that happens to it is an event with a number of its own in one history, which streams
//! replay from any number on. A worker holds a job by the number of its attempt: what an earlier
//! attempt still writes is refused.
//!
//! The metrics in the history are the lines of the run's `metrics.jsonl`. When a run goes on from a
//! checkpoint, the trainer cuts that file back to it; the same points leave the history, and an
//! event `rewind` tells those who had seen them.

mod child;
mod data_directory;
mod event;
mod folder;
mod job;
mod rows;
mod spec;
mod state;
mod store;
mod store_error;
mod tail;
mod worker;

pub use data_directory::DataDirectory;
pub use event::{Event, EventKind};
pub use job::{Claim, Job, JobId, Transition};
pub use spec::{JobSpec, SpecError, pointer};
pub use state::{Change, Reason, Refused, State};
pub use store::{Ended, Filter, SqliteStore, Submitted};
pub use store_error::StoreError;
pub use worker::Worker;

use std::io::{self, Write as _};
use tokio::sync::watch;

/// Phase of the server's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// It takes requests and jobs.
    Serving,
    /// It ends: streams close, children are ended and their jobs wait for the next start.
    Stopping,
}

/// Returns when the server stops.
pub async fn stopping(phase: &mut watch::Receiver<Phase>) {
    // Without a sender nobody is left to serve.
    let _ = phase.wait_for(|phase| *phase == Phase::Stopping).await;
}

/// A line for those who run the server; nobody may be listening.
pub(crate) fn report(text: &str) {
    let _ = writeln!(io::stderr(), "lpr: {text}");
}
