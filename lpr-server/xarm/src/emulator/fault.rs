//! Faults on purpose, to see how clients take them.

use core::fmt;
use core::str::FromStr;

/// A fault that begins after a number of servo points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault {
    /// Its kind.
    pub kind: FaultKind,
    /// Servo points that are received before.
    pub after_points: u64,
}

/// Kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// The first port of commands answers nothing any more.
    MuteReplies,
    /// No more reports.
    StallReports,
    /// Servo points are acknowledged, and the arm stays where it is.
    HoldArm,
    /// Every connection is closed and no new one accepted.
    Vanish,
    /// The controller stops with an error.
    RaiseError(u8),
}

impl FromStr for Fault {
    type Err = String;

    /// For example `mute-replies@20`.
    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || {
            format!(
                "`{text}`: expected mute-replies, stall-reports, hold-arm, vanish or error-CODE, then @POINTS"
            )
        };
        let (name, points) = text.split_once('@').ok_or_else(expected)?;
        let kind = match name {
            "mute-replies" => FaultKind::MuteReplies,
            "stall-reports" => FaultKind::StallReports,
            "hold-arm" => FaultKind::HoldArm,
            "vanish" => FaultKind::Vanish,
            name => {
                let code = name.strip_prefix("error-").and_then(|code| code.parse().ok());
                FaultKind::RaiseError(code.ok_or_else(expected)?)
            }
        };
        Ok(Self { kind, after_points: points.parse().map_err(|_| expected())? })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            FaultKind::MuteReplies => f.write_str("mute-replies")?,
            FaultKind::StallReports => f.write_str("stall-reports")?,
            FaultKind::HoldArm => f.write_str("hold-arm")?,
            FaultKind::Vanish => f.write_str("vanish")?,
            FaultKind::RaiseError(code) => write!(f, "error-{code}")?,
        }
        write!(f, "@{}", self.after_points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_read_as_it_is_written() {
        for text in ["mute-replies@0", "stall-reports@20", "hold-arm@3", "vanish@1", "error-31@7"] {
            assert_eq!(text.parse::<Fault>().unwrap().to_string(), text);
        }
        for text in ["", "vanish", "vanish@", "vanish@x", "error@1", "error-300@1", "explode@1"] {
            assert!(text.parse::<Fault>().unwrap_err().contains("expected"), "{text}");
        }
    }
}
