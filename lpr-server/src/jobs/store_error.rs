//! Reasons why the store refuses.

use super::state::Refused;
use thiserror::Error;

/// Reason why the store did not do what it was asked for.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The database failed.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// Something in the database is not what this program writes.
    #[error("database: a job's {column} cannot be read: {reason}")]
    Unreadable {
        /// The column that holds it.
        column: &'static str,
        /// The error in it, in words.
        reason: String,
    },
    /// There is no such job.
    #[error("no such job")]
    NoSuchJob,
    /// The job's state does not allow the change.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The job has been given to another worker, or has ended.
    #[error("the job is no longer this worker's")]
    Stale,
    /// The idempotency key belongs to a job of another description.
    #[error("the key belongs to another job")]
    KeyReused,
}

pub(super) type Result<T, E = StoreError> = core::result::Result<T, E>;
