//! The executor against an emulator in the same process.

use super::*;
use crate::emulator::{
    Channel, Emulator, EmulatorSettings, Fault, FaultKind, KinematicWorld, Received,
};
use crate::safety::{SafetyError, SafetyLimits, check_path};
use crate::schedule;
use crate::wire::{Check, JointMove, register};
use lpr_core::path::JointPath;
use lpr_core::robot::XARM7;
use std::sync::mpsc::{Receiver, channel};

/// Long enough for a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

const PATIENT: Watchdogs = Watchdogs {
    reply_timeout: PATIENCE,
    report_timeout: PATIENCE,
    // A machine that stands still for a moment is no reason to fail.
    max_tracking_error: 10.0,
    arrival_timeout: PATIENCE,
};

struct Setup {
    emulator: Emulator,
    received: Receiver<Received>,
    link: Link,
}

impl Setup {
    fn new(fault: Option<Fault>) -> Self {
        let (sender, received) = channel();
        let settings =
            EmulatorSettings { fault, received: Some(sender), ..EmulatorSettings::on_free_ports() };
        let emulator = Emulator::start(settings, KinematicWorld::at(XARM7.start)).unwrap();
        let link = connect(&emulator);
        Self { emulator, received, link }
    }

    fn execute(&mut self, path: &CheckedPath) -> Result<Execution, ExecutionError> {
        self.link.execute(path, &PATIENT, &AtomicBool::new(false))
    }

    /// Everything that was received so far.
    fn received(&self) -> Vec<Received> {
        self.received.try_iter().collect()
    }
}

fn connect(emulator: &Emulator) -> Link {
    Link::connect(std::net::Ipv4Addr::LOCALHOST.into(), emulator.ports(), Duration::from_secs(5))
        .unwrap()
}

/// A turn of the first joint from `start` in less than a second.
fn path_from(start: JointConfig) -> CheckedPath {
    path_at(start, 0.5)
}

/// A turn of the first joint from `start`, at that speed in rad/s.
fn path_at(start: JointConfig, max_velocity: f64) -> CheckedPath {
    let mut goal = start;
    goal[0] += 0.25;
    let path = JointPath::new(vec![start, goal]).unwrap();
    let pace = schedule::StreamPace { max_velocity, max_acceleration: 2.0, tick_secs: 0.01 };
    let points = schedule::schedule(&path, &XARM7, &pace);
    check_path(points, &start, &SafetyLimits::learned_agent(&XARM7, pace.tick_secs)).unwrap()
}

fn requests(received: &[Received], register: u8) -> Vec<Request> {
    let of_register = received.iter().filter(|received| received.frame.body[0] == register);
    of_register.map(|received| Request::from_frame(&received.frame).unwrap()).collect()
}

fn n_points(received: &[Received]) -> usize {
    requests(received, register::SERVO_JOINTS).len()
}

fn is_stop(received: &Received) -> bool {
    let stop = Request::SetState(StateCommand::Stop);
    received.channel == Channel::Stop && Request::from_frame(&received.frame) == Ok(stop)
}

/// Fails unless the arm was told to stop, on the connection for that, and got no point after.
#[track_caller]
fn assert_stopped_for_good(received: &[Received]) {
    let stop = received.iter().position(is_stop).expect("a command to stop");
    assert_eq!(n_points(&received[stop..]), 0, "points after the stop");
}

#[test]
fn a_path_is_streamed_point_by_point_to_its_end() {
    let mut setup = Setup::new(None);
    let path = path_from(XARM7.start);
    let execution = setup.execute(&path).unwrap();
    assert_eq!(execution.points_sent, path.points().len());
    assert!(farthest(&execution.arrived_at, path.goal()).1 <= 1e-4, "{execution:?}");
    let received = setup.received();
    let sent: Vec<_> =
        path.points().iter().map(|point| Request::ServoJoints(*point, SERVO_PACE)).collect();
    assert_eq!(requests(&received, register::SERVO_JOINTS), sent);
    assert!(!received.iter().any(is_stop));
    assert_eq!(setup.link.commands.state().unwrap(), State::Ready);
    let left_in = setup.link.newest_report().unwrap().arm.mode;
    assert_eq!(left_in, Mode::POSITION);
}

#[test]
fn observing_sends_nothing_that_enables_or_moves() {
    let mut setup = Setup::new(None);
    assert_eq!(setup.link.measured().unwrap(), XARM7.start);
    let registers: Vec<_> =
        setup.received().iter().map(|received| received.frame.body[0]).collect();
    assert_eq!(registers, [register::GET_JOINTS]);
}

#[test]
fn a_reply_that_does_not_come_ends_the_stream_and_stops_the_arm() {
    let mut setup = Setup::new(Some(Fault { kind: FaultKind::MuteReplies, after_points: 20 }));
    let watchdogs = Watchdogs { reply_timeout: Duration::from_secs(1), ..PATIENT };
    let error = setup
        .link
        .execute(&path_from(XARM7.start), &watchdogs, &AtomicBool::new(false))
        .unwrap_err();
    assert!(matches!(error.cause, Cause::Client(ClientError::Timeout { .. })), "{error}");
    assert_eq!((error.points_sent, error.stop), (20, StopOutcome::Acknowledged));
    let received = setup.received();
    assert_stopped_for_good(&received);
    assert_eq!(n_points(&received), 20);
    assert_eq!(setup.link.stop.state().unwrap(), State::Stopped);
}

#[test]
fn reports_that_stop_coming_end_the_stream_and_stop_the_arm() {
    let mut setup = Setup::new(Some(Fault { kind: FaultKind::StallReports, after_points: 10 }));
    let watchdogs = Watchdogs { report_timeout: Duration::from_millis(250), ..PATIENT };
    let error = setup
        .link
        .execute(&path_from(XARM7.start), &watchdogs, &AtomicBool::new(false))
        .unwrap_err();
    assert!(matches!(error.cause, Cause::ReportStalled { .. }), "{error}");
    assert!(error.points_sent < error.n_points, "{error}");
    let received = setup.received();
    assert_stopped_for_good(&received);
    assert_eq!(n_points(&received), error.points_sent);
}

#[test]
fn a_controller_that_vanishes_ends_the_stream_and_nobody_acknowledges_the_stop() {
    let mut setup = Setup::new(Some(Fault { kind: FaultKind::Vanish, after_points: 15 }));
    let error = setup.execute(&path_from(XARM7.start)).unwrap_err();
    assert!(matches!(error.cause, Cause::Client(_) | Cause::ReportStalled { .. }), "{error}");
    assert_eq!(error.stop, StopOutcome::Unanswered);
    assert!(error.to_string().ends_with("use the emergency button"), "{error}");
    assert!((15..=16).contains(&error.points_sent), "{error}");
}

#[test]
fn an_error_of_the_controller_ends_the_stream_with_its_number() {
    let mut setup = Setup::new(Some(Fault { kind: FaultKind::RaiseError(31), after_points: 12 }));
    let error = setup.execute(&path_from(XARM7.start)).unwrap_err();
    assert!(matches!(error.cause, Cause::ControllerError(31)), "{error}");
    assert_eq!(error.points_sent, 12);
    assert_stopped_for_good(&setup.received());
}

#[test]
fn an_arm_that_does_not_follow_is_stopped() {
    let mut setup = Setup::new(Some(Fault { kind: FaultKind::HoldArm, after_points: 5 }));
    let watchdogs = Watchdogs { max_tracking_error: 0.1, ..PATIENT };
    let error = setup
        .link
        .execute(&path_from(XARM7.start), &watchdogs, &AtomicBool::new(false))
        .unwrap_err();
    let Cause::Tracking { joint: 1, error: distance } = error.cause else { panic!("{error}") };
    assert!(distance > 0.1 && distance < 0.2 && error.points_sent < error.n_points, "{error}");
    assert_stopped_for_good(&setup.received());
}

/// Executes a path, and does something else once ten points were received.
fn execute_and(
    setup: &mut Setup,
    interrupted: &AtomicBool,
    then: impl FnOnce(&Emulator) + Send,
) -> ExecutionError {
    let (emulator, received, link) = (&setup.emulator, &setup.received, &mut setup.link);
    // Far from its end when the other thread gets its turn.
    let path = path_at(XARM7.start, 0.05);
    thread::scope(|scope| {
        let run = scope.spawn(|| link.execute(&path, &PATIENT, interrupted));
        let mut points =
            received.iter().filter(|received| received.frame.body[0] == register::SERVO_JOINTS);
        assert!(points.nth(9).is_some());
        then(emulator);
        run.join().unwrap().unwrap_err()
    })
}

#[test]
fn an_interrupt_stops_the_arm_where_it_is() {
    let mut setup = Setup::new(None);
    let interrupted = AtomicBool::new(false);
    let error =
        execute_and(&mut setup, &interrupted, |_| interrupted.store(true, Ordering::Relaxed));
    assert!(matches!(error.cause, Cause::Interrupted), "{error}");
    assert_eq!(error.stop, StopOutcome::Acknowledged);
    assert_stopped_for_good(&setup.received());
    assert_eq!(setup.link.commands.state().unwrap(), State::Stopped);
    let stopped_at = setup.link.measured().unwrap();
    assert!(
        stopped_at[0] > XARM7.start[0] && stopped_at[0] < XARM7.start[0] + 0.25,
        "{stopped_at:?}"
    );
}

#[test]
fn a_stop_by_someone_else_ends_the_stream() {
    let mut setup = Setup::new(None);
    let error = execute_and(&mut setup, &AtomicBool::new(false), |emulator| {
        connect(emulator).commands.command(&Request::SetState(StateCommand::Stop)).unwrap();
    });
    assert!(
        matches!(
            error.cause,
            Cause::TakenOver { state: State::Stopped, .. } | Cause::PointRefused(_)
        ),
        "{error}"
    );
    assert_stopped_for_good(&setup.received());
}

#[test]
fn a_path_that_starts_elsewhere_is_refused_without_a_point() {
    let mut setup = Setup::new(None);
    let mut elsewhere = XARM7.start;
    elsewhere[2] += 0.1;
    let error = setup.execute(&path_from(elsewhere)).unwrap_err();
    assert!(matches!(error.cause, Cause::Safety(SafetyError::Start { joint: 3, .. })), "{error}");
    let received = setup.received();
    assert_eq!(n_points(&received), 0);
    assert_stopped_for_good(&received);
}

/// Lets someone else make the arm ready and move all joints to `angle`.
fn someone_moves(setup: &Setup, angle: f32) -> Result<(), ClientError> {
    let mut other = connect(&setup.emulator);
    for request in [
        Request::EnableMotion(Axis::ALL, Power::On),
        Request::SetMode(Mode::POSITION, None),
        Request::SetState(StateCommand::Run),
    ] {
        other.commands.command(&request).unwrap();
    }
    let pace = Pace { speed: 0.01, acceleration: 1.0, duration: 0.0 };
    let motion = JointMove { target: [Some(angle); 7], pace, check: Check::Absent };
    let moved = other.commands.command(&Request::MoveJoints(motion));
    let _ = setup.received();
    moved.map(drop)
}

/// Fails unless nothing was sent but questions.
#[track_caller]
fn assert_only_looked(received: &[Received]) {
    let registers: Vec<_> = received.iter().map(|received| received.frame.body[0]).collect();
    assert!(
        registers.iter().all(|it| [register::GET_ERROR, register::GET_STATE].contains(it)),
        "{registers:?}"
    );
}

#[test]
fn an_arm_that_someone_else_moves_is_left_alone() {
    let mut setup = Setup::new(None);
    someone_moves(&setup, 0.5).unwrap();
    let error = setup.execute(&path_from(XARM7.start)).unwrap_err();
    assert!(matches!(error.cause, Cause::Busy), "{error}");
    assert_eq!(error.stop, StopOutcome::Unneeded);
    assert_only_looked(&setup.received());
    assert_eq!(setup.link.commands.state().unwrap(), State::Moving);
}

#[test]
fn an_error_from_before_is_neither_cleared_nor_ignored() {
    let mut setup = Setup::new(None);
    assert!(matches!(someone_moves(&setup, 100.0), Err(ClientError::Refused { .. })));
    let error = setup.execute(&path_from(XARM7.start)).unwrap_err();
    assert!(matches!(error.cause, Cause::ControllerError(23)), "{error}");
    assert_only_looked(&setup.received());
}

#[test]
fn a_stream_that_is_dropped_stops_the_arm() {
    let mut setup = Setup::new(None);
    let path = path_from(XARM7.start);
    drop(Stream::new(&mut setup.link, &path, &PATIENT, &AtomicBool::new(false)));
    assert_stopped_for_good(&setup.received());
}
