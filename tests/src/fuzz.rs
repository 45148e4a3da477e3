//! A few broken inputs in every run of the tests, or many, each against the clock.

use std::time::Instant;

/// Inputs of each test, if not a few.
const MANY: &str = "LPR_FUZZ_CASES";
/// Longest that one of many may take, seconds.
const LONGEST: f32 = 1.0;

/// The number of inputs in `LPR_FUZZ_CASES`, or else `few`.
///
/// # Panics
///
/// When that is no number.
#[must_use]
pub fn few_or_many(few: u32) -> u32 {
    std::env::var(MANY).map_or(few, |many| many.parse().expect("a number of inputs"))
}

/// The result of some work, which takes no more than a second if there are many inputs.
///
/// # Panics
///
/// When it takes longer.
pub fn in_time<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    let seconds = start.elapsed().as_secs_f32();
    assert!(std::env::var_os(MANY).is_none() || seconds < LONGEST, "{seconds} s");
    done
}
