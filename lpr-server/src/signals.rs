//! Interrupts and terminations that do not end the program at once: an arm has to be stopped first,
//! a run has to be saved.

use std::io::{self, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{process, thread};
use tokio::runtime::{Builder, Runtime};
#[cfg(unix)]
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Exit status of a program that ended because of a signal, as shells know it of an interrupt.
pub const INTERRUPTED: u8 = 130;

/// The signals of the process. From now on an interrupt or a termination ends [`Self::wait`], not
/// the program.
#[derive(Debug)]
pub struct Signals {
    runtime: Runtime,
    #[cfg(unix)]
    received: [Signal; 2],
}

impl Signals {
    /// Takes them over.
    ///
    /// # Errors
    ///
    /// When the operating system refuses.
    pub fn take() -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        #[cfg(unix)]
        let received = {
            let _context = runtime.enter();
            [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?]
        };
        Ok(Self {
            runtime,
            #[cfg(unix)]
            received,
        })
    }

    /// Waits for one.
    pub fn wait(mut self) {
        self.wait_for_next();
    }

    #[cfg(unix)]
    fn wait_for_next(&mut self) {
        let Self { runtime, received: [interrupt, terminate] } = self;
        runtime.block_on(async {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
        });
    }

    #[cfg(not(unix))]
    fn wait_for_next(&mut self) {
        // Without a handler there is nothing to wait for.
        let _ = self.runtime.block_on(tokio::signal::ctrl_c());
    }

    /// A flag that becomes true with the first one.
    #[must_use]
    pub fn flag(self) -> Arc<AtomicBool> {
        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&interrupted);
        thread::spawn(move || {
            self.wait();
            flag.store(true, Ordering::Relaxed);
        });
        interrupted
    }

    /// A flag that becomes true with the first one, for which standard error gets the line
    /// `answer`. The second one ends the program with the status [`INTERRUPTED`].
    #[must_use]
    pub fn flag_then_exit(mut self, answer: &'static str) -> Arc<AtomicBool> {
        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&interrupted);
        thread::spawn(move || {
            self.wait_for_next();
            flag.store(true, Ordering::Relaxed);
            // Nobody may be listening.
            let _ = writeln!(io::stderr(), "{answer}");
            self.wait_for_next();
            exit_interrupted();
        });
        interrupted
    }
}

#[expect(clippy::exit, reason = "the second signal asks not to wait for the end in good order")]
fn exit_interrupted() {
    process::exit(INTERRUPTED.into());
}
