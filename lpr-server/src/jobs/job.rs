//! A job as the API shows it.

use super::spec::JobSpec;
use super::state::{Reason, State};
use core::fmt;
use core::str::FromStr;
use jiff::Timestamp;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value};
use utoipa::ToSchema;
use uuid::Uuid;

/// Which job: a UUID of version 7, so that identifiers sort by the time of creation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct JobId(Uuid);

impl JobId {
    /// A new one.
    #[must_use]
    pub fn generate() -> Self {
        Self(Uuid::now_v7())
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for JobId {
    type Err = uuid::Error;

    fn from_str(text: &str) -> Result<Self, uuid::Error> {
        text.parse().map(Self)
    }
}

impl Serialize for JobId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A training job.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Job {
    /// Its identifier, by whose order jobs sort by their creation.
    #[schema(value_type = String, format = "uuid")]
    pub id: JobId,
    /// Its state.
    pub state: State,
    /// Reason of the state, when the state alone does not tell it.
    pub reason: Option<Reason>,
    /// The last words of a failed job.
    pub message: Option<String>,
    /// Its settings.
    pub spec: JobSpec,
    /// Number of times that a worker has taken it.
    pub attempt: u32,
    /// When it was submitted.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When a worker first took it.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub started_at: Option<Timestamp>,
    /// When it came to its terminal state.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub finished_at: Option<Timestamp>,
    /// Environment steps at the last log point.
    pub env_steps: Option<u64>,
    /// Success rate of the last validation.
    pub success_rate: Option<f64>,
    /// The run's `summary.json` once it has ended well.
    #[schema(value_type = Option<Object>)]
    pub summary: Option<Map<String, Value>>,
    /// Every state that it has been in, in order.
    pub transitions: Vec<Transition>,
}

/// A state that a job came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Transition {
    /// The state.
    pub state: State,
    /// Reason of the state, when the state alone does not tell it.
    pub reason: Option<Reason>,
    /// When.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
}

/// A worker's hold on a job: writes of an earlier attempt are refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// The job.
    pub id: JobId,
    /// Which attempt at it this is.
    pub attempt: u32,
}
