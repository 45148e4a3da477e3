//! The `lpr` binary; see [`lpr_server::cli`].

use std::process::ExitCode;

// An update of the networks takes and returns hundreds of tensors of megabytes. glibc hands each
// back to the kernel, which clears it again: BENCHMARKS.md.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    lpr_server::cli::run(std::env::args_os())
}
