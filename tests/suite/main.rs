//! End-to-end suites over the public surface of the crates.

mod architecture;
mod bad_input;
mod checkpoints;
mod evaluation;
mod events;
mod interrupted;
mod lpr;
mod output;
mod runs;
mod xarm;
