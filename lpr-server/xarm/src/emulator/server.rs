//! Sockets and the time of day for the controller.

use super::controller::Controller;
use super::fault::{Fault, FaultKind};
use super::listen::{EmulatorError, Purpose, listen, listen_at_files};
use super::motion::{ConnectionId, Origin};
use super::received::{Channel, Received};
use super::settings::EmulatorSettings;
use super::socket::{Listener, Socket};
use super::world::World;
use crate::ports::Ports;
use crate::wire::{
    Answer, Frame, FrameReader, HEARTBEAT_PROTOCOL, MODBUS_PROTOCOL, Reply, Report, ReportKind,
    Request,
};
use std::collections::BTreeMap;
use std::io::{self, Read as _, Write as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Step of the controller's time, and time between two fast reports.
const TICK: Duration = Duration::from_millis(4);
/// Time between two looks for connections.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(10);
/// Between two real-time reports.
const REALTIME_INTERVAL: Duration = Duration::from_millis(10);
/// Between two normal or rich reports.
const SLOW_INTERVAL: Duration = Duration::from_millis(200);

/// A running emulator; dropping it ends it.
#[derive(Debug)]
pub struct Emulator {
    ports: Ports,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    sockets: Vec<PathBuf>,
}

#[derive(Debug)]
struct Shared {
    clocked: Mutex<Clocked>,
    commanders: Mutex<BTreeMap<ConnectionId, Arc<Mutex<Socket>>>>,
    reporters: Mutex<Vec<(ReportKind, Socket)>>,
    ends: AtomicBool,
    next_connection: AtomicU64,
    fault: Option<Fault>,
    servo_points: AtomicU64,
    received: Option<Mutex<Sender<Received>>>,
}

/// The controller and until when time has passed for it.
#[derive(Debug)]
struct Clocked {
    controller: Controller,
    until: Instant,
}

impl Emulator {
    /// Starts one that commands the arm in `world`.
    ///
    /// # Errors
    ///
    /// When a port or a socket file is taken or not allowed: the message names it.
    pub fn start(
        settings: EmulatorSettings,
        world: impl World + 'static,
    ) -> Result<Self, EmulatorError> {
        let (ports, mut listeners) = listen(&settings)?;
        let sockets = settings
            .uds
            .as_deref()
            .map(|directory| listen_at_files(directory, &mut listeners))
            .transpose()?;
        let shared = Arc::new(Shared::new(settings, Box::new(world)));
        let mut threads = vec![spawn(&shared, Shared::tick)];
        for (purpose, listener) in listeners {
            threads.push(spawn(&shared, move |shared| shared.accept(purpose, &listener)));
        }
        Ok(Self { ports, shared, threads, sockets: sockets.unwrap_or_default() })
    }

    /// Ports on which it listens.
    #[must_use]
    pub const fn ports(&self) -> Ports {
        self.ports
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.shared.end();
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
        for socket in &self.sockets {
            // A file that is gone needs no removing.
            let _ = std::fs::remove_file(socket);
        }
    }
}

fn spawn(shared: &Arc<Shared>, run: impl FnOnce(&Arc<Shared>) + Send + 'static) -> JoinHandle<()> {
    let shared = Arc::clone(shared);
    thread::spawn(move || run(&shared))
}

/// A thread that panicked while it held the lock has left a value that can be used.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    fn new(settings: EmulatorSettings, world: Box<dyn World>) -> Self {
        let EmulatorSettings { firmware, fault, received, .. } = settings;
        Self {
            clocked: Mutex::new(Clocked {
                controller: Controller::new(&firmware, world),
                until: Instant::now(),
            }),
            commanders: Mutex::default(),
            reporters: Mutex::default(),
            ends: AtomicBool::new(false),
            next_connection: AtomicU64::new(0),
            fault,
            servo_points: AtomicU64::new(0),
            received: received.map(Mutex::new),
        }
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    /// Closes everything.
    fn end(&self) {
        self.ends.store(true, Ordering::Relaxed);
        for socket in lock(&self.commanders).values() {
            lock(socket).shut_down();
        }
        lock(&self.reporters).clear();
    }

    /// True once that fault has begun.
    fn suffers(&self, kind: FaultKind) -> bool {
        let points = self.servo_points.load(Ordering::Relaxed);
        self.fault.is_some_and(|fault| fault.kind == kind && points >= fault.after_points)
    }

    /// The controller of this moment.
    fn now(&self) -> MutexGuard<'_, Clocked> {
        let mut clocked = lock(&self.clocked);
        let now = Instant::now();
        let elapsed = now.saturating_duration_since(clocked.until);
        clocked.until = now;
        clocked.controller.advance(elapsed.as_secs_f64());
        clocked
    }

    /// Lets time pass, and sends feedback and reports.
    fn tick(self: &Arc<Self>) {
        let (mut realtime, mut slow) = (Instant::now(), Instant::now());
        while !self.ends() {
            self.send_feedback();
            self.send_reports(&[ReportKind::Fast]);
            let now = Instant::now();
            if now >= realtime {
                realtime = (realtime + REALTIME_INTERVAL).max(now);
                self.send_reports(&[ReportKind::Realtime]);
            }
            if now >= slow {
                slow = (slow + SLOW_INTERVAL).max(now);
                self.send_reports(&[ReportKind::Normal, ReportKind::Rich]);
            }
            // Real-time reports keep their rate although the tick does not divide their interval.
            thread::sleep(TICK.min(realtime.saturating_duration_since(Instant::now())));
        }
    }

    fn send_feedback(&self) {
        let (told, status) = {
            let mut clocked = self.now();
            (clocked.controller.take_told(), clocked.controller.status())
        };
        for (connection, feedback) in told {
            let socket = lock(&self.commanders).get(&connection).cloned();
            if let Some(socket) = socket {
                // A client that is gone needs no feedback.
                let _ = lock(&socket).write_all(&feedback.to_frame(status).encode());
            }
        }
    }

    fn send_reports(&self, kinds: &[ReportKind]) {
        if self.suffers(FaultKind::StallReports) {
            return;
        }
        let mut reporters = lock(&self.reporters);
        for kind in kinds {
            if !reporters.iter().any(|(of, _)| of == kind) {
                continue;
            }
            let bytes = Report::encode(&self.now().controller.report(*kind));
            // A client that does not read, or is gone, is cut off: half a report would be worse.
            reporters.retain_mut(|(of, socket)| {
                of != kind || socket.write(&bytes).is_ok_and(|n| n == bytes.len())
            });
        }
    }

    fn accept(self: &Arc<Self>, purpose: Purpose, listener: &Listener) {
        let mut threads = Vec::new();
        while !self.ends() {
            let Some(socket) = listener.accept() else {
                thread::sleep(ACCEPT_INTERVAL);
                continue;
            };
            match purpose {
                Purpose::Reports(kind) => self.add_reporter(kind, socket),
                Purpose::Commands(channel) => {
                    threads.push(spawn(self, move |shared| shared.serve(channel, socket)));
                }
            }
            threads.retain(|thread| !thread.is_finished());
        }
        for thread in threads {
            let _ = thread.join();
        }
    }

    fn add_reporter(&self, kind: ReportKind, socket: Socket) {
        if socket.set_nonblocking().is_ok() {
            lock(&self.reporters).push((kind, socket));
        }
    }

    /// Answers one client until it is gone.
    fn serve(&self, channel: Channel, mut socket: Socket) {
        let Ok(writer) = socket.try_clone().map(|socket| Arc::new(Mutex::new(socket))) else {
            return;
        };
        let connection = self.next_connection.fetch_add(1, Ordering::Relaxed);
        lock(&self.commanders).insert(connection, Arc::clone(&writer));
        let mut reader = FrameReader::default();
        let mut buffer = [0; 4096];
        while !self.ends() {
            match socket.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => reader.push(&buffer[..n]),
                Err(error) if is_timeout(&error) => continue,
                Err(_) => break,
            }
            if self.answer_all(&mut reader, &writer, connection, channel).is_err() {
                break;
            }
        }
        lock(&self.commanders).remove(&connection);
        socket.shut_down();
    }

    /// Answers the frames that arrived whole.
    ///
    /// # Errors
    ///
    /// When the connection is lost, or the client has lost its place in the stream.
    fn answer_all(
        &self,
        reader: &mut FrameReader,
        writer: &Mutex<Socket>,
        connection: ConnectionId,
        channel: Channel,
    ) -> io::Result<()> {
        while let Some(frame) = reader.next_frame().map_err(io::Error::other)? {
            // Held until the reply is out, so that no feedback overtakes it.
            let mut writer = lock(writer);
            let reply = self.reply(&frame, connection, channel);
            if let Some(reply) =
                reply.filter(|_| channel == Channel::Stop || !self.suffers(FaultKind::MuteReplies))
            {
                writer.write_all(&reply.encode())?;
            }
            if self.suffers(FaultKind::Vanish) {
                drop(writer);
                self.end();
            }
        }
        Ok(())
    }

    /// The reply to a frame; a heart-beat has none.
    fn reply(&self, frame: &Frame, connection: ConnectionId, channel: Channel) -> Option<Frame> {
        if let Some(received) = &self.received {
            // Nobody listening is as good as having no listener.
            let _ = lock(received).send(Received { connection, channel, frame: frame.clone() });
        }
        match frame.protocol {
            HEARTBEAT_PROTOCOL => None,
            MODBUS_PROTOCOL => Some(modbus_refusal(frame)),
            _ => Some(self.private_reply(frame, connection)),
        }
    }

    fn private_reply(&self, frame: &Frame, connection: ConnectionId) -> Frame {
        let mut clocked = self.now();
        let Frame { transaction, protocol, .. } = *frame;
        let Ok(request) = Request::from_frame(frame) else {
            return clocked.controller.refuse_malformed().to_frame(frame);
        };
        if let Request::ServoJoints(..) = request {
            self.servo_points.fetch_add(1, Ordering::Relaxed);
            if let Some(Fault { kind: FaultKind::RaiseError(code), .. }) = self.fault
                && self.suffers(FaultKind::RaiseError(code))
            {
                clocked.controller.raise(code);
            }
            if self.suffers(FaultKind::HoldArm) {
                return Reply { status: clocked.controller.status(), answer: Answer::Done }
                    .to_frame(frame);
            }
        }
        clocked
            .controller
            .answer(&request, Origin { connection, transaction, protocol })
            .to_frame(frame)
    }
}

fn is_timeout(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
    )
}

/// The answer of standard Modbus to a function that is not there.
fn modbus_refusal(frame: &Frame) -> Frame {
    const ILLEGAL_FUNCTION: u8 = 1;
    let unit = frame.body.first().copied().unwrap_or_default();
    let function = frame.body.get(1).copied().unwrap_or_default();
    Frame { body: vec![unit, function | 0x80, ILLEGAL_FUNCTION], ..frame.clone() }
}

#[cfg(test)]
mod tests;
