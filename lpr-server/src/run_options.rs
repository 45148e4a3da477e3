//! Limits of the options of a training run, which come from the command line or the API.

use lpr_core::agent::Method;

/// The preset of a run that names none.
pub const DEFAULT_PRESET: &str = "fast";
/// Minutes after which a run ends that names no others.
pub const DEFAULT_MINUTES: f64 = 15.0;

/// Refuses minutes at which a run cannot be capped.
///
/// # Errors
///
/// The right values.
pub fn check_minutes(minutes: f64) -> Result<(), String> {
    if minutes.is_finite() && minutes > 0.0 {
        Ok(())
    } else {
        Err(format!("expected above 0, found {minutes}"))
    }
}

/// Refuses a method that has nothing to train.
///
/// # Errors
///
/// That there is nothing to train.
pub fn check_trainable(method: Method) -> Result<(), String> {
    match method {
        Method::Lpr | Method::LprNoPolicy | Method::C2fArm => Ok(()),
        Method::Linear | Method::ShortestFree | Method::Random => {
            Err(format!("`{}` has nothing to train, use `lpr eval`", method.name()))
        }
    }
}
