//! Reasons why a command fails, and the exit status of each.

use crate::files::FileError;
use crate::gallery::GalleryError;
use crate::signals;
use lpr_xarm::client::ClientError;
use lpr_xarm::emulator::EmulatorError;
use lpr_xarm::executor::ExecutionError;
use lpr_xarm::safety::SafetyError;
use std::io;
use std::net::SocketAddr;
use thiserror::Error;

/// Exit status of a command that could not do its work.
const FAILED: u8 = 1;
/// Exit status of arguments that are unknown, out of range or do not go together.
pub(super) const WRONG_USAGE: u8 = 2;

/// Reason why a command failed.
#[derive(Debug, Error)]
pub(super) enum Failure {
    /// Input that the algorithms refuse.
    #[error(transparent)]
    Core(#[from] lpr_core::Error),
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A task that cannot be shown.
    #[error(transparent)]
    Gallery(#[from] GalleryError),
    /// Arguments that do not go together.
    #[error("{0}")]
    Usage(String),
    /// An address at which nothing can be served.
    #[error("--bind {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The server cannot go on.
    #[error("the server: {0}")]
    Server(io::Error),
    /// An emulator that cannot start.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// A controller that cannot be reached or does not answer.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// A path that the arm must not run.
    #[error("the path is not safe: {0}")]
    Safety(#[from] SafetyError),
    /// A path that was not run to its end.
    #[error(transparent)]
    Execution(#[from] ExecutionError),
    /// The agent proposes nothing to run.
    #[error("the agent found no path: {0}")]
    NoPath(String),
    /// A signal ended the run, which said before where it can go on.
    #[error("interrupted")]
    Interrupted,
    /// Standard output is closed or full.
    #[error("cannot write to standard output: {0}")]
    Output(#[from] io::Error),
}

pub(super) type Result<T, E = Failure> = core::result::Result<T, E>;

impl Failure {
    /// The exit status of the command that fails so.
    pub(super) const fn exit_status(&self) -> u8 {
        match self {
            Self::Usage(_) => WRONG_USAGE,
            Self::Interrupted => signals::INTERRUPTED,
            _ => FAILED,
        }
    }
}
