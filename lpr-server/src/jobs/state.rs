//! The states of a job, and what leads from one to the next.

use core::fmt;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use utoipa::ToSchema;

/// Number of times that a job may lose its worker or its process before it fails.
pub(super) const MAX_LOSSES: u32 = 3;

/// State of a job. The last three are terminal: a job never leaves them.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, strum::IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// It waits for a worker.
    Queued,
    /// A worker runs it.
    Running,
    /// It was cancelled, and its process is being ended.
    Cancelling,
    /// It ended well and has a summary.
    Succeeded,
    /// It ended otherwise; `reason` and `message` say how.
    Failed,
    /// A user ended it.
    Cancelled,
}

impl State {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Queued,
        Self::Running,
        Self::Cancelling,
        Self::Succeeded,
        Self::Failed,
        Self::Cancelled,
    ];

    /// Its name in JSON and in the database.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// True if nothing more can happen.
    #[must_use]
    pub const fn is_terminal(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Reason of a job's state, when the state alone does not tell it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, strum::IntoStaticStr,
)]
#[strum(serialize_all = "snake_case")]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// A user asked for it.
    CancelledByUser,
    /// The training process failed.
    ExitStatus,
    /// The worker lost its process too often.
    MaxAttempts,
    /// The server was stopped; the job goes on when it starts again.
    ServerStopped,
    /// The worker could not run the process or keep what it wrote.
    WorkerError,
    /// The server or the process was killed; the job goes on from its last checkpoint.
    WorkerLost,
}

impl Reason {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::CancelledByUser,
        Self::ExitStatus,
        Self::MaxAttempts,
        Self::ServerStopped,
        Self::WorkerError,
        Self::WorkerLost,
    ];

    /// Its name in JSON and in the database.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Change in the life of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// A worker takes it.
    Claimed,
    /// A user wants it ended.
    CancelRequested,
    /// Its worker has ended the process, as a user asked.
    Ended,
    /// Its process ended well.
    Succeeded,
    /// Its process or its worker failed.
    Failed(Reason),
    /// The server stops in good order.
    ServerStopped,
    /// Its worker or its process has vanished.
    WorkerLost {
        /// Number of losses, this one included.
        losses: u32,
    },
}

/// A state with the reason for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Step {
    /// The state of the job now.
    pub(super) state: State,
    /// Reason of the state.
    pub(super) reason: Option<Reason>,
}

/// A change that cannot happen to a job in this state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the job is {state}")]
pub struct Refused {
    /// The state of the job, which stays.
    pub state: State,
}

/// The step that `change` makes from `state`; `None` when the job already is where the change
/// leads.
///
/// # Errors
///
/// When the change cannot happen in that state.
pub(super) fn next(state: State, change: Change) -> Result<Option<Step>, Refused> {
    let to = |state, reason| Ok(Some(Step { state, reason }));
    match (state, change) {
        (State::Queued, Change::Claimed) => to(State::Running, None),
        (State::Queued, Change::CancelRequested) => {
            to(State::Cancelled, Some(Reason::CancelledByUser))
        }
        (State::Running, Change::CancelRequested) => {
            to(State::Cancelling, Some(Reason::CancelledByUser))
        }
        (State::Cancelling | State::Cancelled, Change::CancelRequested) => Ok(None),
        (State::Running, Change::Succeeded) => to(State::Succeeded, None),
        (State::Running, Change::Failed(reason)) => to(State::Failed, Some(reason)),
        (State::Running, Change::ServerStopped) => to(State::Queued, Some(Reason::ServerStopped)),
        (State::Running, Change::WorkerLost { losses }) if losses < MAX_LOSSES => {
            to(State::Queued, Some(Reason::WorkerLost))
        }
        (State::Running, Change::WorkerLost { .. }) => to(State::Failed, Some(Reason::MaxAttempts)),
        // However its process ended: a user was told that it would.
        (
            State::Cancelling,
            Change::Ended
            | Change::Succeeded
            | Change::Failed(_)
            | Change::ServerStopped
            | Change::WorkerLost { .. },
        ) => to(State::Cancelled, Some(Reason::CancelledByUser)),
        _ => Err(Refused { state }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::sample::select;

    fn changes() -> impl Strategy<Value = Change> {
        prop_oneof![
            Just(Change::Claimed),
            Just(Change::CancelRequested),
            Just(Change::Ended),
            Just(Change::Succeeded),
            select(&Reason::ALL[..]).prop_map(Change::Failed),
            Just(Change::ServerStopped),
            (1_u32..6).prop_map(|losses| Change::WorkerLost { losses }),
        ]
    }

    /// The states of a new job to which `changes` happen; those that are refused change nothing.
    fn history(changes: &[Change]) -> Vec<State> {
        let mut states = vec![State::Queued];
        for change in changes {
            let state = *states.last().expect("the first is there");
            states.extend(next(state, *change).ok().flatten().map(|step| step.state));
        }
        states
    }

    proptest! {
        #[test]
        fn terminal_states_never_change(state in select(&State::ALL[..]), change in changes()) {
            let found = next(state, change);
            prop_assert!(!state.is_terminal() || matches!(found, Ok(None) | Err(_)));
            prop_assert!(found != Ok(None) || change == Change::CancelRequested);
        }

        #[test]
        fn a_job_runs_from_the_queue_and_ends_once(changes in proptest::collection::vec(changes(), 0..40)) {
            let states = history(&changes);
            for pair in states.windows(2) {
                prop_assert_ne!(pair[0], pair[1]);
                prop_assert!(pair[1] != State::Running || pair[0] == State::Queued);
                prop_assert!(pair[1] != State::Cancelling || pair[0] == State::Running);
                prop_assert!(pair[0] != State::Cancelling || pair[1] == State::Cancelled);
            }
            let ends = states.iter().filter(|state| state.is_terminal()).count();
            prop_assert!(ends == 0 || (ends == 1 && states.last().is_some_and(|last| last.is_terminal())));
        }

        #[test]
        fn what_a_user_cancels_is_cancelled_whatever_happens_then(
            before in proptest::collection::vec(changes(), 0..20),
            end in prop_oneof![Just(Change::Ended), Just(Change::Succeeded), Just(Change::ServerStopped)],
        ) {
            let state = *history(&before).last().expect("the first is there");
            let cancelled = !state.is_terminal() || state == State::Cancelled;
            let last = *history(&[&before[..], &[Change::CancelRequested, end]].concat()).last().expect("the first is there");
            prop_assert_eq!(last == State::Cancelled, cancelled);
        }
    }

    #[test]
    fn a_job_that_is_lost_again_and_again_fails() {
        let lost = |losses| {
            next(State::Running, Change::WorkerLost { losses })
                .map(|step| step.map(|step| step.state))
        };
        assert_eq!(lost(MAX_LOSSES - 1), Ok(Some(State::Queued)));
        assert_eq!(lost(MAX_LOSSES), Ok(Some(State::Failed)));
    }

    #[test]
    fn names_are_those_of_json() {
        let quoted = |name: &str| format!("\"{name}\"");
        for state in State::ALL {
            assert_eq!(serde_json::to_string(&state).expect("a word"), quoted(state.name()));
        }
        for reason in Reason::ALL {
            assert_eq!(serde_json::to_string(&reason).expect("a word"), quoted(reason.name()));
        }
    }
}
