//! End-to-end suites over the public surface of the crates.

mod architecture;
mod bad_input;
mod checkpoints;
mod dependencies;
mod evaluation;
mod events;
mod interrupted;
mod longer_arms;
mod lpr;
mod output;
mod page;
mod planner;
mod planning;
mod public_api;
mod runs;
mod scenes;
mod serve;
mod server;
mod world_hash;
mod xarm;
