//! The `lpr` binary; see [`lpr_server::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    lpr_server::cli::run(std::env::args_os())
}
