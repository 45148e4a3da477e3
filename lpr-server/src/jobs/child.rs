//! The process that an attempt runs.

use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use tokio::process::{Child, ChildStdin, Command};

/// A running `lpr train`.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    /// Closed by the operating system when this process ends, however it ends: then the child ends,
    /// too.
    _leash: Option<ChildStdin>,
}

impl Process {
    /// Starts `program`, whose standard error goes to `log`.
    pub(super) fn start(program: &Path, arguments: &[OsString], log: File) -> io::Result<Self> {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(log)
            .kill_on_drop(true);
        // Ctrl-C in a terminal is for the server, which then ends its children in good order.
        #[cfg(unix)]
        command.process_group(0);
        let mut child = command.spawn()?;
        // Waiting for the child would close it.
        let leash = child.stdin.take();
        Ok(Self { child, _leash: leash })
    }

    /// Waits for its end.
    pub(super) async fn wait(&mut self) -> io::Result<ExitStatus> {
        self.child.wait().await
    }

    /// Ends it. A run survives that at any moment: its files appear whole or not at all.
    pub(super) async fn kill(&mut self) -> io::Result<()> {
        self.child.kill().await
    }
}
