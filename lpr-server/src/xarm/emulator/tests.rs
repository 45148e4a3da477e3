//! The controller as a value, with time that tests give it, and its server with several clients.

use super::controller::Controller;
use super::motion::Origin;
use super::*;
use crate::xarm::wire::{
    Answer, Axis, Check, Feedback, FeedbackCode, FeedbackKind, Frame, FrameReader, JointMove,
    LineForm, LineMove, MODBUS_PROTOCOL, Mode, Pace, Power, Reply, ReportKind, Request, State,
    StateCommand, Status, TcpPose,
};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

const PACE: Pace = Pace { speed: 1.0, acceleration: 10.0, duration: 0.0 };

struct Desk {
    controller: Controller,
    transaction: u16,
}

impl Desk {
    /// A controller that is switched on, enabled and ready in `mode`.
    fn ready(mode: Mode) -> Self {
        let mut desk = Self { controller: Controller::new("2.5.0", XARM7.start), transaction: 0 };
        desk.ask(&Request::EnableMotion(Axis::ALL, Power::On));
        desk.ask(&Request::SetMode(mode, Some(0)));
        desk.ask(&Request::SetState(StateCommand::Run));
        desk
    }

    fn ask(&mut self, request: &Request) -> Reply {
        self.transaction += 1;
        self.controller
            .answer(request, Origin { connection: 7, transaction: self.transaction, protocol: 3 })
    }

    fn state(&mut self) -> State {
        match self.ask(&Request::GetState).answer {
            Answer::State(state) => state,
            other => panic!("{other:?}"),
        }
    }

    fn joints(&mut self) -> JointConfig {
        self.ask(&Request::GetJoints(None)).answer.joints().unwrap()
    }

    fn told(&mut self) -> Vec<(FeedbackKind, FeedbackCode, u16)> {
        let told = self.controller.take_told();
        told.into_iter()
            .map(|(_, Feedback { kind, code, transaction, .. })| (kind, code, transaction))
            .collect()
    }
}

/// A move of the first joint to `angle`; the others stay.
fn turn(angle: f32) -> Request {
    let mut target = [None; 7];
    target[0] = Some(angle);
    Request::MoveJoints(JointMove { target, pace: PACE, check: Check::Absent })
}

#[test]
fn it_moves_only_after_enabling_a_mode_and_running() {
    let mut desk = Desk { controller: Controller::new("2.5.0", XARM7.start), transaction: 0 };
    assert_eq!(desk.state(), State::Stopped);
    let refused = desk.ask(&turn(0.5));
    assert_eq!(
        refused,
        Reply { status: Status(Status::NOT_READY), answer: Answer::Queued(0, None) }
    );
    assert_eq!(
        desk.ask(&Request::SetState(StateCommand::Run)).status,
        Status(Status::NOT_READY),
        "drives are off"
    );
    assert_eq!(
        desk.ask(&Request::EnableMotion(Axis::ALL, Power::On)).status,
        Status(Status::NOT_READY)
    );
    assert_eq!(desk.state(), State::Reconfigured);
    desk.ask(&Request::SetMode(Mode::POSITION, Some(0)));
    assert_eq!(desk.state(), State::Reconfigured);
    assert_eq!(desk.ask(&Request::SetState(StateCommand::Run)).status, Status(0));
    assert_eq!(desk.state(), State::Ready);
    assert_eq!(desk.ask(&turn(0.5)), Reply { status: Status(0), answer: Answer::Queued(1, None) });
    assert_eq!(desk.state(), State::Moving);
}

#[test]
fn a_move_takes_its_trapezoid_and_ends_where_it_was_asked_to() {
    let mut desk = Desk::ready(Mode::POSITION);
    desk.ask(&turn(1.0));
    // 1 rad at 1 rad/s and twice 0.1 s at half speed.
    desk.controller.advance(0.55);
    assert!((desk.joints()[0] - 0.5).abs() < 1e-5);
    desk.controller.advance(0.54);
    assert_eq!(desk.state(), State::Moving);
    desk.controller.advance(0.02);
    assert_eq!(desk.state(), State::Ready);
    let mut goal = XARM7.start;
    goal[0] = 1.0;
    assert_eq!(desk.joints(), goal);
}

#[test]
fn what_happens_does_not_depend_on_how_time_is_cut() {
    let run = |steps: &[f64]| {
        let mut desk = Desk::ready(Mode::POSITION);
        for angle in [0.3, -0.1, 0.6] {
            desk.ask(&turn(angle));
        }
        steps.iter().for_each(|step| desk.controller.advance(*step));
        (desk.joints(), desk.state())
    };
    let (whole, state) = run(&[1.0]);
    for n in [3, 100, 1009] {
        let (cut, same_state) = run(&vec![1.0 / f64::from(n); n as usize]);
        assert!(cut.max_joint_distance(&whole) < 1e-5 && same_state == state, "{n} steps");
    }
}

#[test]
fn feedback_follows_the_mask_of_the_moment_in_which_the_move_came() {
    let mut desk = Desk::ready(Mode::POSITION);
    desk.ask(&Request::SetFeedback(2));
    desk.ask(&turn(0.1));
    let asked = desk.transaction;
    desk.ask(&Request::SetFeedback(0));
    desk.ask(&turn(0.2));
    desk.controller.advance(5.0);
    assert_eq!(desk.told(), [(FeedbackKind::End, FeedbackCode::Done, asked)]);
}

#[test]
fn a_stop_ends_the_motion_at_once_and_discards_the_queue() {
    let mut desk = Desk::ready(Mode::POSITION);
    desk.ask(&Request::SetFeedback(3));
    desk.ask(&turn(1.0));
    desk.ask(&turn(0.0));
    let asked = desk.transaction;
    desk.controller.advance(0.3);
    desk.ask(&Request::SetState(StateCommand::Stop));
    let stopped_at = desk.joints();
    desk.controller.advance(1.0);
    assert_eq!((desk.joints(), desk.state()), (stopped_at, State::Stopped));
    assert!(stopped_at[0] > 0.1 && stopped_at[0] < 0.9);
    let discarded = |transaction| (FeedbackKind::End, FeedbackCode::Discarded, transaction);
    assert_eq!(
        desk.told(),
        [
            (FeedbackKind::Start, FeedbackCode::Done, asked - 1),
            discarded(asked - 1),
            discarded(asked)
        ]
    );
}

#[test]
fn a_pause_waits_and_running_goes_on() {
    let mut desk = Desk::ready(Mode::POSITION);
    desk.ask(&turn(1.0));
    desk.controller.advance(0.3);
    desk.ask(&Request::SetState(StateCommand::Pause));
    desk.ask(&turn(1.0));
    let paused_at = desk.joints();
    desk.controller.advance(1.0);
    assert_eq!((desk.joints(), desk.state()), (paused_at, State::Paused));
    desk.ask(&Request::SetState(StateCommand::Run));
    desk.controller.advance(1.0);
    assert_eq!(desk.joints()[0], 1.0);
}

#[test]
fn leaving_the_joint_limits_is_an_error_until_it_is_cleared() {
    for (mode, request) in [
        (Mode::POSITION, turn(7.0)),
        (Mode::SERVO, Request::ServoJoints(JointConfig::new([7.0; 7]), PACE)),
    ] {
        let mut desk = Desk::ready(mode);
        assert_eq!(desk.ask(&request).status, Status(Status::ERROR | Status::NOT_READY));
        assert_eq!(desk.ask(&Request::GetError).answer, Answer::Codes(23, 0));
        desk.ask(&Request::SetState(StateCommand::Run));
        assert_eq!(desk.state(), State::Stopped, "an error has to be cleared first");
        desk.ask(&Request::CleanError);
        desk.ask(&Request::SetState(StateCommand::Run));
        assert_eq!(desk.state(), State::Ready);
        assert_eq!(desk.joints(), XARM7.start);
    }
}

#[test]
fn the_newest_servo_point_wins() {
    let mut desk = Desk::ready(Mode::SERVO);
    let point = |angle| {
        let mut config = XARM7.start;
        config[0] = angle;
        config
    };
    desk.ask(&Request::ServoJoints(point(0.5), PACE));
    desk.controller.advance(0.01);
    assert!((desk.joints()[0] - 0.0314).abs() < 1e-3, "at the greatest speed of a joint");
    desk.ask(&Request::ServoJoints(point(0.0), PACE));
    desk.controller.advance(0.02);
    assert_eq!((desk.joints(), desk.state()), (point(0.0), State::Ready));
}

#[test]
fn a_stop_forgets_the_servo_point() {
    let mut desk = Desk::ready(Mode::SERVO);
    desk.ask(&Request::ServoJoints(JointConfig::new([1.0; 7]), PACE));
    desk.controller.advance(0.01);
    desk.ask(&Request::SetState(StateCommand::Stop));
    let stopped_at = desk.joints();
    desk.ask(&Request::SetState(StateCommand::Run));
    desk.controller.advance(1.0);
    assert_eq!((desk.joints(), desk.state()), (stopped_at, State::Ready));
}

#[test]
fn motions_of_another_mode_are_invalid() {
    let servo = Request::ServoJoints(XARM7.start, PACE);
    assert!(Desk::ready(Mode::POSITION).ask(&servo).status.has(Status::INVALID));
    assert!(Desk::ready(Mode::SERVO).ask(&turn(0.1)).status.has(Status::INVALID));
    assert!(
        Desk::ready(Mode::POSITION)
            .ask(&Request::SetMode(Mode(9), None))
            .status
            .has(Status::INVALID)
    );
}

#[test]
fn a_register_that_does_not_exist_is_answered_and_warned_of() {
    let mut desk = Desk::ready(Mode::POSITION);
    let reply = desk.ask(&Request::Other { register: 222, params: vec![1, 2] });
    assert_eq!(
        reply,
        Reply { status: Status(Status::INVALID | Status::WARNING), answer: Answer::Done }
    );
    assert_eq!(desk.ask(&Request::GetError).answer, Answer::Codes(0, 13));
    desk.ask(&Request::CleanWarning);
    assert_eq!(desk.ask(&Request::GetState).status, Status(0));
}

#[test]
fn a_line_keeps_the_tool_on_it() {
    let mut desk = Desk::ready(Mode::POSITION);
    let pose = |desk: &mut Desk| match desk.ask(&Request::GetTcpPose).answer {
        Answer::Pose(pose) => pose,
        other => panic!("{other:?}"),
    };
    let from = pose(&mut desk);
    let mut target = [None; 6];
    target[1] = Some(from.position[1] + 0.1);
    let pace = Pace { speed: 0.1, acceleration: 1.0, duration: 0.0 };
    let form =
        LineForm::Common { radius: None, frame: 0, rotation: 0, check: Check::Move, kind: None };
    let reply = desk.ask(&Request::MoveLine(LineMove { target, pace, form }));
    assert_eq!(reply, Reply { status: Status(0), answer: Answer::Queued(1, Some(0)) });
    let mut before = from.position[1];
    while desk.state() == State::Moving {
        desk.controller.advance(0.01);
        let TcpPose { position: [x, y, z], rpy } = pose(&mut desk);
        assert!(
            (x - from.position[0]).abs() < 1e-4
                && (z - from.position[2]).abs() < 1e-4
                && y >= before - 1e-6
        );
        assert!((rpy[1] - from.rpy[1]).abs() < 1e-3 && (rpy[2] - from.rpy[2]).abs() < 1e-3);
        before = y;
    }
    assert!((before - from.position[1] - 0.1).abs() < 1e-5);
}

#[test]
fn inverse_kinematics_lead_back_to_the_pose() {
    let mut desk = Desk::ready(Mode::POSITION);
    let offset = TcpPose { position: [0.0, 0.01, 0.15], rpy: [0.0, 0.0, 0.5] };
    desk.ask(&Request::SetTcpOffset(offset));
    let config = JointConfig::new([0.3, -0.5, 0.2, 1.0, 0.1, 1.4, -0.3]);
    let Answer::Pose(pose) = desk.ask(&Request::GetFk(config)).answer else { panic!("no pose") };
    let found = desk.ask(&Request::GetIk(pose)).answer.joints().unwrap();
    let Answer::Pose(again) = desk.ask(&Request::GetFk(found)).answer else { panic!("no pose") };
    for (a, b) in pose.position.iter().chain(&pose.rpy).zip(again.position.iter().chain(&again.rpy))
    {
        assert!((a - b).abs() < 1e-5, "{pose:?} {again:?}");
    }
}

#[test]
fn reports_say_what_the_controller_is() {
    let mut desk = Desk::ready(Mode::SERVO);
    let mut target = XARM7.start;
    target[5] += 0.1;
    desk.ask(&Request::ServoJoints(target, PACE));
    desk.controller.advance(1.0);
    for kind in [ReportKind::Realtime, ReportKind::Normal, ReportKind::Rich] {
        let report = desk.controller.report(kind);
        let motion = report.motion().unwrap();
        assert_eq!((motion.state, motion.mode, motion.joints), (State::Ready, Mode::SERVO, target));
        assert_eq!(report.encode().len(), kind.bytes());
    }
}

fn free() -> Emulator {
    Emulator::start(EmulatorSettings::on_free_ports()).unwrap()
}

fn frame(stream: &mut impl std::io::Read) -> Frame {
    let (mut reader, mut buffer) = (FrameReader::default(), [0; 256]);
    loop {
        if let Some(frame) = reader.next_frame().unwrap() {
            return frame;
        }
        let n = stream.read(&mut buffer).unwrap();
        assert!(n > 0, "the emulator closed the connection");
        reader.push(&buffer[..n]);
    }
}

fn connect(port: u16) -> TcpStream {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream
}

#[test]
fn several_clients_are_answered_however_their_bytes_arrive() {
    let emulator = free();
    let mut clients: Vec<_> = (0..4).map(|_| connect(emulator.ports().command)).collect();
    for (transaction, client) in (1..).zip(&mut clients) {
        for byte in Request::GetState.to_frame(transaction, 2).encode() {
            client.write_all(&[byte]).unwrap();
        }
    }
    for (transaction, client) in (1..).zip(&mut clients) {
        let reply = frame(client);
        assert_eq!(reply.transaction, transaction);
        assert_eq!(Reply::from_frame(&reply).unwrap().answer, Answer::State(State::Stopped));
    }
}

#[test]
fn heart_beats_are_not_answered_and_standard_modbus_is_refused() {
    let emulator = free();
    let mut client = connect(emulator.ports().command);
    client.write_all(&[0, 0, 0, 1, 0, 2, 0, 0]).unwrap();
    let read_holding =
        Frame { transaction: 5, protocol: MODBUS_PROTOCOL, body: vec![1, 3, 0, 0x20, 0, 1] };
    client.write_all(&read_holding.encode()).unwrap();
    assert_eq!(frame(&mut client), Frame { body: vec![1, 0x83, 1], ..read_holding });
}

#[test]
fn a_client_that_lost_its_place_is_cut_off_and_others_stay() {
    let emulator = free();
    let (mut lost, mut other) =
        (connect(emulator.ports().command), connect(emulator.ports().command));
    lost.write_all(&[0, 1, 0, 2, 0xff, 0xff, 1]).unwrap();
    assert_eq!(lost.read(&mut [0; 8]).unwrap(), 0);
    other.write_all(&Request::GetVersion.to_frame(1, 2).encode()).unwrap();
    let Answer::Text(version) = Reply::from_frame(&frame(&mut other)).unwrap().answer else {
        panic!("no text")
    };
    assert!(version.ends_with("v2.5.0"), "{version}");
}

#[test]
fn it_moves_in_real_time_and_reports_it() {
    let emulator = free();
    let mut reports = connect(emulator.ports().realtime);
    let mut report = vec![0; ReportKind::Realtime.bytes()];
    for _ in 0..20 {
        reports.read_exact(&mut report).unwrap();
        assert_eq!(report[..5], [0, 0, 0, 135, State::Stopped as u8]);
    }
}

#[test]
#[cfg(unix)]
fn unix_sockets_have_the_names_of_a_controllers_ports() {
    use std::os::unix::net::UnixStream;
    let directory = tempfile::tempdir().unwrap();
    let settings = EmulatorSettings {
        uds: Some(directory.path().to_owned()),
        ..EmulatorSettings::on_free_ports()
    };
    let emulator = Emulator::start(settings).unwrap();
    let mut client = UnixStream::connect(directory.path().join("xarmcontroller_uds_502")).unwrap();
    client.write_all(&Request::GetState.to_frame(1, 2).encode()).unwrap();
    assert_eq!(
        Reply::from_frame(&frame(&mut client)).unwrap().answer,
        Answer::State(State::Stopped)
    );
    assert!(directory.path().join("xarmcontroller_uds_30003").exists());
    drop(emulator);
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn a_port_that_is_taken_is_named() {
    let emulator = free();
    let command_port = emulator.ports().command;
    let error =
        Emulator::start(EmulatorSettings { command_port, ..EmulatorSettings::on_free_ports() })
            .unwrap_err();
    assert!(error.to_string().contains(&format!("127.0.0.1:{command_port}")), "{error}");
}
