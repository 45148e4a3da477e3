//! End-to-end suites over the public surface of the crates.

mod architecture;
mod bad_input;
mod checkpoints;
mod cli;
mod dependencies;
mod docs;
mod evaluation;
mod events;
mod imports;
mod interrupted;
mod lpr;
mod old_files;
mod output;
mod page;
mod planner;
mod planning;
mod public_api;
mod runs;
mod scenes;
mod serve;
mod server;
mod signals;
mod simulation;
mod training;
mod world_hash;
mod xarm;
