//! `lpr xarm`: an agent on a UFACTORY xArm7, and an emulator of its controller.

mod emulate;
mod run;

use super::failure::Result;
use super::output::Format;
use clap::Subcommand;

/// Action on an arm.
#[derive(Debug, Subcommand)]
pub(super) enum Action {
    /// Emulate the controller of an arm on this computer, until interrupted
    Emulate(emulate::Arguments),
    /// Let a trained agent act once on an arm; without --execute nothing moves
    Run(run::Arguments),
}

pub(super) fn run(action: &Action, format: Format) -> Result<()> {
    match action {
        Action::Emulate(arguments) => emulate::run(arguments, format),
        Action::Run(arguments) => super::print(&run::run(arguments)?, format),
    }
}
