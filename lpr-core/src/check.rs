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

/// The refusal of a word that is not among those that exist.
pub(crate) fn one_of<'a>(known: impl IntoIterator<Item = &'a str>, found: &str) -> String {
    let known: Vec<_> = known.into_iter().collect();
    format!("expected one of {}, found '{found}'", known.join(", "))
}

/// The refusal `error` with the table that its setting is in.
pub(crate) fn in_table(table: &str, error: Error) -> Error {
    match error {
        Error::Config(refusal) => Error::Config(format!("{table}.{refusal}")),
        other => other,
    }
}
