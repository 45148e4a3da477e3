//! Being interrupted without dying of it: the arm has to be stopped first.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use tokio::runtime::{Builder, Runtime};
#[cfg(unix)]
use tokio::signal::unix::{Signal, SignalKind, signal};

/// From now on an interrupt or a termination ends [`Self::wait`], not the program.
pub(super) struct Signals {
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
    pub(super) fn take() -> io::Result<Self> {
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
    #[cfg(unix)]
    pub(super) fn wait(self) {
        let [mut interrupt, mut terminate] = self.received;
        self.runtime.block_on(async {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
        });
    }

    /// Waits for one.
    #[cfg(not(unix))]
    pub(super) fn wait(self) {
        // Without a handler there is nothing to wait for.
        let _ = self.runtime.block_on(tokio::signal::ctrl_c());
    }

    /// What becomes true with the first one.
    pub(super) fn flag(self) -> Arc<AtomicBool> {
        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&interrupted);
        thread::spawn(move || {
            self.wait();
            flag.store(true, Ordering::Relaxed);
        });
        interrupted
    }
}
