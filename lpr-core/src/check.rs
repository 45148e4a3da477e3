//! Refusals of settings, all in the words `table.setting: expected X, found Y`.

use crate::error::{Error, Result};
use core::fmt::Display;

/// Refuses a setting unless its rule `holds`.
pub(crate) fn setting(holds: bool, name: &str, expected: &str, found: impl Display) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::Config(format!("{name}: expected {expected}, found {found}")))
}

/// The refusal `error` with the table that its setting is in.
pub(crate) fn in_table(table: &str, error: Error) -> Error {
    match error {
        Error::Config(refusal) => Error::Config(format!("{table}.{refusal}")),
        other => other,
    }
}
