//! The one error of the wire: bytes that are not what the protocol asks for.

use super::MAX_BODY;
use thiserror::Error;

/// Bytes that are not what the protocol asks for.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WireError {
    /// A frame without a body, or with one longer than any that exists.
    #[error("frame: expected 1 to {MAX_BODY} bytes, found {0}")]
    FrameLength(usize),
    /// A report that is too short or too long for its port.
    #[error("report: expected {expected} bytes, found {found}")]
    ReportLength {
        /// Bytes of a report of that port.
        expected: usize,
        /// Bytes that the report says it has.
        found: usize,
    },
    /// Parameters of the wrong length.
    #[error("register {register}: expected parameters of another length, found {found} bytes")]
    Parameters {
        /// The register.
        register: u8,
        /// Bytes found.
        found: usize,
    },
    /// A parameter outside its range.
    #[error("register {register}: {name}: expected a known number, found {value}")]
    Value {
        /// The register.
        register: u8,
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: String,
    },
    /// A number that is no state of the controller.
    #[error("state: expected 1 to 6, found {0}")]
    State(u8),
    /// A number that should be finite.
    #[error("{0}: expected a finite number")]
    NotFinite(&'static str),
}

/// Result with a [`WireError`].
pub type Result<T, E = WireError> = core::result::Result<T, E>;
