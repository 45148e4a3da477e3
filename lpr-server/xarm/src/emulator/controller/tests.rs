//! The controller as a value, with time that tests give it.

use super::*;
use crate::emulator::world::KinematicWorld;
use crate::wire::{
    Answer, Axis, Check, Feedback, FeedbackCode, FeedbackKind, JointMove, LineForm, LineMove, Mode,
    Pace, Power, Reply, Report, ReportKind, Request, Rtu, RtuBody, State, StateCommand, Status,
    TcpPose, gripper_register,
};
use lpr_core::robot::{JointConfig, XARM7};

const PACE: Pace = Pace { speed: 1.0, acceleration: 10.0, duration: 0.0 };

struct Desk {
    controller: Controller,
    transaction: u16,
}

impl Desk {
    /// A controller that is switched on, of an arm in `world`.
    fn new(world: impl World + 'static) -> Self {
        Self { controller: Controller::new("2.5.0", Box::new(world)), transaction: 0 }
    }

    /// A controller that is switched on, enabled and ready in `mode`.
    fn ready(mode: Mode) -> Self {
        Self::ready_in(KinematicWorld::at(XARM7.start), mode)
    }

    fn ready_in(world: impl World + 'static, mode: Mode) -> Self {
        let mut desk = Self::new(world);
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
    let mut desk = Desk::new(KinematicWorld::at(XARM7.start));
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
        let arm = report.arm().unwrap();
        assert_eq!((arm.state, arm.mode, arm.joints), (State::Ready, Mode::SERVO, target));
        assert_eq!(report.encode().len(), kind.bytes());
    }
}

/// A world in which the first joint and the fingers meet something.
#[derive(Debug)]
struct BlockedWorld {
    free: KinematicWorld,
    /// Greatest angle of the first joint, radians.
    most_angle: f32,
    /// Width of the thing between the fingers, pulses.
    least_opening: f64,
}

impl BlockedWorld {
    fn new() -> Self {
        Self { free: KinematicWorld::at(XARM7.start), most_angle: 0.2, least_opening: 300.0 }
    }
}

impl World for BlockedWorld {
    fn advance(&mut self, dt_secs: f64, setpoint: &Setpoint) {
        self.free.advance(dt_secs, setpoint);
    }

    fn joints(&self) -> JointConfig {
        let mut joints = self.free.joints();
        joints[0] = joints[0].min(self.most_angle);
        joints
    }

    fn fingers(&self) -> f64 {
        self.free.fingers().max(self.least_opening)
    }
}

#[test]
fn where_arm_and_fingers_are_is_for_the_world_to_say() {
    let mut desk = Desk::ready_in(BlockedWorld::new(), Mode::POSITION);
    desk.ask(&turn(1.0));
    let bus = |body| Request::Rs485(Rtu { host: 9, slave: 8, body });
    desk.ask(&bus(RtuBody::Write { address: gripper_register::TARGET, values: vec![0, 0] }));
    desk.controller.advance(0.6);
    desk.controller.advance(0.01);
    assert_eq!((desk.joints()[0], desk.state()), (0.2, State::Moving));
    let Report::Fast(report) = desk.controller.report(ReportKind::Fast) else { panic!("fast") };
    assert_eq!((report.joints[0], report.joint_speeds[0]), (0.2, 0.0));
    assert!(report.target[0] > 0.5, "{report:?}");
    let read = RtuBody::Read { address: gripper_register::POSITION, count: 2 };
    let Answer::Rs485(answer) = desk.ask(&bus(read)).answer else { panic!("no answer") };
    assert_eq!(answer[4..], 300_u32.to_be_bytes());
}

#[test]
fn after_a_stop_motions_begin_where_the_arm_is() {
    let mut desk = Desk::ready_in(BlockedWorld::new(), Mode::SERVO);
    let point = |angle| Request::ServoJoints(JointConfig::new([angle; 7]), PACE);
    desk.ask(&point(0.5));
    desk.controller.advance(1.0);
    assert_eq!(desk.joints()[0], 0.2);
    desk.ask(&Request::SetState(StateCommand::Stop));
    desk.ask(&Request::SetState(StateCommand::Run));
    desk.ask(&point(0.0));
    desk.controller.advance(0.01);
    assert!((desk.joints()[0] - 0.1686).abs() < 1e-3, "{:?}", desk.joints());
}
