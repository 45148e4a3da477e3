//! Streams a checked path to the arm and watches it all the time.
//!
//! A point is sent every tick and never sooner after the one before, so that a late tick delays the
//! rest and is not caught up. Whatever goes wrong ends the stream for good: no further point is
//! sent, and the arm is told to stop on a connection of its own, opened before. That is no
//! safety-rated stop.

mod failure;

pub use failure::{Cause, ExecutionError, StopOutcome};

use crate::client::{Client, ClientError, Observed, Reports};
use crate::ports::Ports;
use crate::safety::{CheckedPath, START_TOLERANCE, check_start};
use crate::wire::{
    ArmReading, Axis, Mode, Pace, Power, Reply, Request, State, StateCommand, Status,
};
use lpr_core::robot::JointConfig;
use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Longest wait for the arm to do what a command asks before the stream.
const PREPARE_TIMEOUT: Duration = Duration::from_secs(2);
/// The arm has arrived when every joint is that near, radians.
const ARRIVED: f32 = 1e-4;
/// The controller ignores it, and every point must have one; the vendor's client sends its last.
const SERVO_PACE: Pace = Pace { speed: 0.0, acceleration: 0.0, duration: 0.0 };

/// When the stream is given up.
#[derive(Debug, Clone, Copy)]
pub struct Watchdogs {
    /// Longest wait for the reply to a point.
    pub reply_timeout: Duration,
    /// Oldest report.
    pub report_timeout: Duration,
    /// Largest distance of a joint from the last point sent, radians.
    pub max_tracking_error: f32,
    /// Longest wait for the arm to arrive after the last point.
    pub arrival_timeout: Duration,
}

impl Watchdogs {
    /// For a controller on a cable of its own.
    pub const STANDARD: Self = Self {
        reply_timeout: Duration::from_millis(50),
        report_timeout: Duration::from_millis(200),
        max_tracking_error: 0.1,
        arrival_timeout: Duration::from_secs(2),
    };
}

/// The connections to one arm.
#[derive(Debug)]
pub struct Link {
    commands: Client,
    stop: Client,
    reports: Reports,
}

/// Course of an execution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Execution {
    /// Points that were sent.
    pub points_sent: usize,
    /// Largest distance of a joint from the last point sent, radians.
    pub max_tracking_error: f32,
    /// Longest delay of a tick.
    pub max_lateness: Duration,
    /// Longest wait for a reply.
    pub max_reply: Duration,
    /// Configuration of the arm in the end.
    pub arrived_at: JointConfig,
}

impl Link {
    /// Connects to a controller and only observes.
    ///
    /// # Errors
    ///
    /// When one of its ports does not answer.
    pub fn connect(host: IpAddr, ports: Ports, timeout: Duration) -> Result<Self, ClientError> {
        let at = |port| SocketAddr::new(host, port);
        Ok(Self {
            commands: Client::connect("commands", at(ports.command), timeout)?,
            stop: Client::connect("second port of commands", at(ports.stop), timeout)?,
            reports: Reports::connect(at(ports.realtime), timeout)?,
        })
    }

    /// Measured configuration of the arm, radians.
    ///
    /// # Errors
    ///
    /// When the controller does not answer.
    pub fn measured(&mut self) -> Result<JointConfig, ClientError> {
        self.commands.joints()
    }

    /// The newest report.
    #[must_use]
    pub fn newest_report(&self) -> Option<Observed> {
        self.reports.newest()
    }

    /// Enables the arm, streams `path`, waits until the arm is there and leaves it ready in
    /// position mode.
    ///
    /// `interrupted` ends the stream within a tick.
    ///
    /// # Errors
    ///
    /// Whatever goes wrong: the arm has been told to stop then.
    pub fn execute(
        &mut self,
        path: &CheckedPath,
        watchdogs: &Watchdogs,
        interrupted: &AtomicBool,
    ) -> Result<Execution, ExecutionError> {
        let n_points = path.points().len();
        self.refuse_unfit().map_err(|cause| ExecutionError {
            cause,
            points_sent: 0,
            n_points,
            stop: StopOutcome::Unneeded,
        })?;
        let mut stream = Stream::new(self, path, watchdogs, interrupted);
        match stream.run() {
            Ok(()) => {
                stream.is_over = true;
                Ok(stream.execution)
            }
            Err(cause) => {
                let points_sent = stream.execution.points_sent;
                Err(ExecutionError { cause, points_sent, n_points, stop: stream.stop() })
            }
        }
    }

    /// Looks before anything is changed: an arm with an error, or one that someone else moves, is
    /// left alone.
    fn refuse_unfit(&mut self) -> Result<(), Cause> {
        self.refuse_errors()?;
        match self.commands.state()? {
            State::Moving | State::Paused | State::Decelerating => Err(Cause::Busy),
            _ => Ok(()),
        }
    }

    fn refuse_errors(&mut self) -> Result<(), Cause> {
        match self.commands.codes()? {
            (0, _) => Ok(()),
            (error, _) => Err(Cause::ControllerError(error)),
        }
    }
}

/// One execution. Dropping it before its end stops the arm: also a panic does.
struct Stream<'a> {
    link: &'a mut Link,
    path: &'a CheckedPath,
    watchdogs: &'a Watchdogs,
    interrupted: &'a AtomicBool,
    execution: Execution,
    is_over: bool,
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        if !self.is_over {
            self.stop();
        }
    }
}

impl<'a> Stream<'a> {
    fn new(
        link: &'a mut Link,
        path: &'a CheckedPath,
        watchdogs: &'a Watchdogs,
        interrupted: &'a AtomicBool,
    ) -> Self {
        let execution = Execution {
            points_sent: 0,
            max_tracking_error: 0.0,
            max_lateness: Duration::ZERO,
            max_reply: Duration::ZERO,
            arrived_at: *path.start(),
        };
        Self { link, path, watchdogs, interrupted, execution, is_over: false }
    }

    fn run(&mut self) -> Result<(), Cause> {
        self.prepare()?;
        self.send_points()?;
        self.arrive()?;
        self.leave()
    }

    /// Tells the arm to stop, on the connection that nothing else uses; once.
    fn stop(&mut self) -> StopOutcome {
        self.is_over = true;
        match self.link.stop.call(&Request::SetState(StateCommand::Stop)) {
            Ok(_) => StopOutcome::Acknowledged,
            Err(_) => StopOutcome::Unanswered,
        }
    }

    /// Enables the arm in servo mode, and looks again where it is.
    fn prepare(&mut self) -> Result<(), Cause> {
        match self.link.commands.command(&Request::EnableMotion(Axis::ALL, Power::On)) {
            // Some firmware does not answer it; the report that the arm is ready says whether it
            // was done.
            Ok(_) | Err(ClientError::Timeout { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        self.configure(Mode::SERVO)?;
        check_start(self.path.start(), &self.link.measured()?, START_TOLERANCE)?;
        Ok(())
    }

    /// Changes the mode, and waits for a report that says so.
    fn configure(&mut self, mode: Mode) -> Result<(), Cause> {
        let commands = &mut self.link.commands;
        commands.command(&Request::SetMode(mode, Some(0)))?;
        commands.command(&Request::SetState(StateCommand::Run))?;
        let asked = Instant::now();
        let is_ready = |arm: &ArmReading| arm.state == State::Ready && arm.mode == mode;
        if self.link.reports.wait(asked, PREPARE_TIMEOUT, is_ready).is_some() {
            return Ok(());
        }
        match self.link.reports.newest() {
            Some(Observed { arm: ArmReading { state, mode, .. }, at }) if at > asked => {
                Err(Cause::NotReady { state, mode })
            }
            newest => Err(Cause::ReportStalled {
                age: newest.map_or(PREPARE_TIMEOUT, |newest| newest.at.elapsed()),
            }),
        }
    }

    fn send_points(&mut self) -> Result<(), Cause> {
        let tick = Duration::from_secs_f64(self.path.tick_secs());
        let mut due = Instant::now();
        let mut last_sent = *self.path.start();
        for point in self.path.points() {
            thread::sleep(due.saturating_duration_since(Instant::now()));
            self.watch(&last_sent)?;
            let now = Instant::now();
            self.execution.max_lateness =
                self.execution.max_lateness.max(now.saturating_duration_since(due));
            self.send(point)?;
            last_sent = *point;
            due = now + tick;
        }
        Ok(())
    }

    /// Everything that is known of the arm before the next point.
    fn watch(&mut self, last_sent: &JointConfig) -> Result<(), Cause> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(Cause::Interrupted);
        }
        let newest = self.link.reports.newest();
        let age = newest.map_or(Duration::MAX, |newest| newest.at.elapsed());
        let Some(Observed { arm, .. }) = newest.filter(|_| age <= self.watchdogs.report_timeout)
        else {
            return Err(Cause::ReportStalled { age });
        };
        let ArmReading { state, mode, joints, .. } = arm;
        if !matches!(state, State::Moving | State::Ready) || mode != Mode::SERVO {
            return Err(self.stopped_by(state, mode));
        }
        let (joint, error) = farthest(&joints, last_sent);
        self.execution.max_tracking_error = self.execution.max_tracking_error.max(error);
        if error > self.watchdogs.max_tracking_error {
            return Err(Cause::Tracking { joint, error });
        }
        Ok(())
    }

    /// The cause of a stop: an error of the controller, or someone else.
    fn stopped_by(&mut self, state: State, mode: Mode) -> Cause {
        match self.link.commands.codes() {
            Ok((error, _)) if error != 0 => Cause::ControllerError(error),
            _ => Cause::TakenOver { state, mode },
        }
    }

    fn send(&mut self, point: &JointConfig) -> Result<(), Cause> {
        let asked = Instant::now();
        let request = Request::ServoJoints(*point, SERVO_PACE);
        self.execution.points_sent += 1;
        let Reply { status, .. } =
            self.link.commands.call_within(&request, self.watchdogs.reply_timeout)?;
        self.execution.max_reply = self.execution.max_reply.max(asked.elapsed());
        if status.has(Status::ERROR) {
            let (error, _) = self.link.commands.codes()?;
            return Err(Cause::ControllerError(error));
        }
        if status.has(Status::INVALID | Status::NOT_READY) {
            return Err(Cause::PointRefused(status));
        }
        Ok(())
    }

    /// Waits until the arm stands at the end of the path.
    fn arrive(&mut self) -> Result<(), Cause> {
        let goal = *self.path.goal();
        let deadline = Instant::now() + self.watchdogs.arrival_timeout;
        loop {
            self.watch(&goal)?;
            let seen = Instant::now();
            let wait = self.watchdogs.report_timeout.min(deadline.saturating_duration_since(seen));
            let arrived = |arm: &ArmReading| farthest(&arm.joints, &goal).1 <= ARRIVED;
            if let Some(observed) = self.link.reports.wait(seen, wait, arrived) {
                self.execution.arrived_at = observed.arm.joints;
                return Ok(());
            }
            if Instant::now() >= deadline {
                let (joint, error) = farthest(&self.link.measured()?, &goal);
                return Err(Cause::NotArrived { joint, error });
            }
        }
    }

    /// Leaves the arm as the vendor's tools expect it: ready, in position mode.
    fn leave(&mut self) -> Result<(), Cause> {
        self.link.refuse_errors()?;
        self.configure(Mode::POSITION)
    }
}

/// The joint, from 1, that is farthest from where it should be, and how far, radians.
fn farthest(joints: &JointConfig, target: &JointConfig) -> (usize, f32) {
    let errors = (1..).zip(joints.iter().zip(target.iter()).map(|(a, b)| (a - b).abs()));
    errors.fold((1, 0.0), |most, error| if error.1 > most.1 { error } else { most })
}

#[cfg(test)]
mod tests;
