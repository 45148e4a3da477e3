//! Our side of the connections: one owner of a socket of commands, and one reader of reports.

use crate::wire::{
    Answer, ArmReading, Frame, FrameReader, PRIVATE_PROTOCOL, Reply, ReportKind, ReportReader,
    Request, State, Status, WireError, register,
};
use lpr_core::robot::JointConfig;
use std::io::{self, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Time after which the reader of reports looks for a wish to end.
const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// Failure of a connection; each message begins with the attempt.
#[derive(Debug, Error)]
pub enum ClientError {
    /// Nobody listens there.
    #[error("cannot connect to the controller's {what} at {address}: {source}")]
    Connect {
        /// The port's purpose.
        what: &'static str,
        /// Its address.
        address: SocketAddr,
        /// The operating system's reason.
        source: io::Error,
    },
    /// Reading or writing failed.
    #[error("{what}: the connection failed: {source}")]
    Io {
        /// The request.
        what: &'static str,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The controller closed the connection.
    #[error("{what}: the controller closed the connection")]
    Closed {
        /// The request.
        what: &'static str,
    },
    /// No reply in time.
    #[error("{what}: no reply within {} ms", after.as_millis())]
    Timeout {
        /// The request.
        what: &'static str,
        /// Time that we waited.
        after: Duration,
    },
    /// Bytes that are not what the protocol asks for.
    #[error("{what}: {source}")]
    Wire {
        /// The request.
        what: &'static str,
        /// The fault in them.
        source: WireError,
    },
    /// The controller does not do that now.
    #[error("{what}: the controller refuses (status {:#04x})", status.0)]
    Refused {
        /// The request.
        what: &'static str,
        /// The bits of its reply.
        status: Status,
    },
    /// A reply of another kind than asked for.
    #[error("{what}: an answer of another kind: {answer}")]
    Answer {
        /// The request.
        what: &'static str,
        /// The answer.
        answer: String,
    },
}

/// Result with a [`ClientError`].
pub type Result<T, E = ClientError> = core::result::Result<T, E>;

/// The one owner of a connection for commands. One request is on its way at a time.
#[derive(Debug)]
pub struct Client {
    socket: TcpStream,
    reader: FrameReader,
    next_transaction: u16,
    timeout: Duration,
}

impl Client {
    /// Connects; `timeout` is also that of every later [`Self::call`].
    ///
    /// # Errors
    ///
    /// When nobody listens at `address`.
    pub fn connect(what: &'static str, address: SocketAddr, timeout: Duration) -> Result<Self> {
        let socket = connect(what, address, timeout)?;
        socket.set_write_timeout(Some(timeout)).map_err(|source| ClientError::Connect {
            what,
            address,
            source,
        })?;
        Ok(Self { socket, reader: FrameReader::default(), next_transaction: 1, timeout })
    }

    /// Asks and waits for the reply.
    ///
    /// # Errors
    ///
    /// When the connection fails, or there is no reply in time.
    pub fn call(&mut self, request: &Request) -> Result<Reply> {
        self.call_within(request, self.timeout)
    }

    /// [`Self::call`] with another timeout.
    ///
    /// # Errors
    ///
    /// As [`Self::call`].
    pub fn call_within(&mut self, request: &Request, timeout: Duration) -> Result<Reply> {
        let (what, deadline) = (name(request), Instant::now() + timeout);
        let asked = request.to_frame(self.next_transaction, PRIVATE_PROTOCOL);
        // 0 is no transaction.
        self.next_transaction = self.next_transaction.checked_add(1).unwrap_or(1);
        self.socket
            .write_all(&asked.encode())
            .map_err(|source| ClientError::Io { what, source })?;
        loop {
            while let Some(frame) =
                self.reader.next_frame().map_err(|source| ClientError::Wire { what, source })?
            {
                if is_reply(&frame, &asked) {
                    return Reply::from_frame(&frame)
                        .map_err(|source| ClientError::Wire { what, source });
                }
            }
            self.read_until(deadline, what, timeout)?;
        }
    }

    /// Asks for something that the controller must do: its bits may warn, not refuse.
    ///
    /// # Errors
    ///
    /// As [`Self::call`], and when the controller refuses or has an error.
    pub fn command(&mut self, request: &Request) -> Result<Answer> {
        let Reply { status, answer } = self.call(request)?;
        if status.has(Status::INVALID | Status::ERROR) {
            return Err(ClientError::Refused { what: name(request), status });
        }
        Ok(answer)
    }

    /// The state.
    ///
    /// # Errors
    ///
    /// As [`Self::call`].
    pub fn state(&mut self) -> Result<State> {
        match self.call(&Request::GetState)?.answer {
            Answer::State(state) => Ok(state),
            other => Err(unexpected(&Request::GetState, &other)),
        }
    }

    /// Error and warning, 0 for none.
    ///
    /// # Errors
    ///
    /// As [`Self::call`].
    pub fn codes(&mut self) -> Result<(u8, u8)> {
        match self.call(&Request::GetError)?.answer {
            Answer::Codes(error, warning) => Ok((error, warning)),
            other => Err(unexpected(&Request::GetError, &other)),
        }
    }

    /// Joint angles, radians.
    ///
    /// # Errors
    ///
    /// As [`Self::call`].
    pub fn joints(&mut self) -> Result<JointConfig> {
        let request = Request::GetJoints(None);
        let answer = self.call(&request)?.answer;
        answer.joints().filter(JointConfig::is_finite).ok_or_else(|| unexpected(&request, &answer))
    }

    /// Takes more bytes in.
    fn read_until(
        &mut self,
        deadline: Instant,
        what: &'static str,
        timeout: Duration,
    ) -> Result<()> {
        let left = deadline.saturating_duration_since(Instant::now());
        let late = || ClientError::Timeout { what, after: timeout };
        if left.is_zero() {
            return Err(late());
        }
        let mut buffer = [0; 1024];
        let read =
            self.socket.set_read_timeout(Some(left)).and_then(|()| self.socket.read(&mut buffer));
        match read {
            Ok(0) => Err(ClientError::Closed { what }),
            Ok(n) => {
                self.reader.push(&buffer[..n]);
                Ok(())
            }
            Err(error) if is_timeout(&error) => Ok(()),
            Err(source) => Err(ClientError::Io { what, source }),
        }
    }
}

/// True when `frame` answers `asked`; late replies and feedback do not.
fn is_reply(frame: &Frame, asked: &Frame) -> bool {
    (frame.transaction, frame.protocol, frame.body.first())
        == (asked.transaction, asked.protocol, asked.body.first())
}

fn unexpected(request: &Request, answer: &Answer) -> ClientError {
    ClientError::Answer { what: name(request), answer: format!("{answer:?}") }
}

fn connect(what: &'static str, address: SocketAddr, timeout: Duration) -> Result<TcpStream> {
    let failed = |source| ClientError::Connect { what, address, source };
    let socket = TcpStream::connect_timeout(&address, timeout).map_err(failed)?;
    socket.set_nodelay(true).map_err(failed)?;
    Ok(socket)
}

fn is_timeout(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
    )
}

/// Name of a request in messages.
const fn name(request: &Request) -> &'static str {
    match request.register() {
        register::GET_VERSION => "asking for the version",
        register::ENABLE_MOTION => "switching the drives",
        register::SET_STATE => "setting the state",
        register::GET_STATE => "asking for the state",
        register::GET_ERROR => "asking for errors",
        register::SET_MODE => "setting the mode",
        register::GET_JOINTS => "asking for the joint angles",
        register::SERVO_JOINTS => "sending a servo point",
        _ => "a request",
    }
}

/// The newest report, and when it came by our clock.
#[derive(Debug, Clone, Copy)]
pub struct Observed {
    /// Its content.
    pub arm: ArmReading,
    /// When it came.
    pub at: Instant,
}

/// Reads real-time reports in a thread of its own.
#[derive(Debug)]
pub struct Reports {
    shared: Arc<SharedReports>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct SharedReports {
    newest: Mutex<Option<Observed>>,
    news: Condvar,
    ends: AtomicBool,
}

impl Reports {
    /// Connects.
    ///
    /// # Errors
    ///
    /// When nobody listens at `address`.
    pub fn connect(address: SocketAddr, timeout: Duration) -> Result<Self> {
        const WHAT: &str = "reports";
        let socket = connect(WHAT, address, timeout)?;
        let failed = |source| ClientError::Connect { what: WHAT, address, source };
        socket.set_read_timeout(Some(READ_TIMEOUT)).map_err(failed)?;
        let shared = Arc::new(SharedReports::default());
        let reader = Arc::clone(&shared);
        let thread = thread::spawn(move || reader.read(socket));
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The newest report; none before the first.
    #[must_use]
    pub fn newest(&self) -> Option<Observed> {
        *self.shared.newest()
    }

    /// The first report after `after` that `wanted` takes; none when none came in time.
    #[must_use]
    pub fn wait(
        &self,
        after: Instant,
        timeout: Duration,
        wanted: impl Fn(&ArmReading) -> bool,
    ) -> Option<Observed> {
        let is_wanted =
            |newest: &Option<Observed>| newest.is_some_and(|it| it.at > after && wanted(&it.arm));
        let waited = self
            .shared
            .news
            .wait_timeout_while(self.shared.newest(), timeout, |newest| !is_wanted(newest));
        let newest = *waited.unwrap_or_else(PoisonError::into_inner).0;
        newest.filter(|_| is_wanted(&newest))
    }
}

impl Drop for Reports {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}

impl SharedReports {
    fn newest(&self) -> MutexGuard<'_, Option<Observed>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads until the connection or its bytes fail: whoever needs reports sees that they are old.
    fn read(&self, mut socket: TcpStream) {
        let mut reader = ReportReader::new(ReportKind::Realtime);
        let mut buffer = [0; 4096];
        while !self.ends.load(Ordering::Relaxed) {
            match socket.read(&mut buffer) {
                Ok(0) => return,
                Ok(n) => reader.push(&buffer[..n]),
                Err(error) if is_timeout(&error) => continue,
                Err(_) => return,
            }
            let at = Instant::now();
            loop {
                match reader.next_report() {
                    Ok(Some(report)) => {
                        *self.newest() = report.arm().map(|arm| Observed { arm: *arm, at });
                    }
                    Ok(None) => break,
                    Err(_) => return,
                }
            }
            self.news.notify_all();
        }
    }
}
