//! Reports on standard output, and the line of a failure on standard error.

use super::failure::Result;
use core::fmt::Display;
use serde::Serialize;
use std::io::{self, Write as _};

/// Format of a printed report.
#[derive(Debug, Clone, Copy)]
pub(super) enum Format {
    Json,
    Table,
}

/// Prints the one line that a failure prints.
pub(super) fn report_error(message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    // With standard error closed there is no one left to tell.
    let _ = writeln!(io::stderr(), "error: {line}");
}

/// Prints one line about something that was left out.
pub(super) fn report_warning(message: &str) {
    let _ = writeln!(io::stderr(), "warning: {message}");
}

pub(super) fn print<R: Serialize + Display>(report: &R, format: Format) -> Result<()> {
    match format {
        Format::Json => print_line(&serde_json::to_string(report).map_err(io::Error::from)?),
        Format::Table => print_line(report.to_string().trim_end()),
    }
}

/// Prints on standard output; a reader that has seen enough (`lpr … | head`) is no failure.
pub(super) fn print_line(text: &str) -> Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
