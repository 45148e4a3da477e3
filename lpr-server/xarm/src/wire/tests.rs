//! The wire against the bytes of the vendor's client, against itself, and against noise.

use super::*;
use core::f64::consts::{FRAC_PI_3, PI};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{DOF, JointConfig};
use proptest::prelude::*;

/// Protocol identifier that the vendor's client uses once it knows the firmware.
const WITH_HEARTBEAT: u16 = 3;

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<_> = hex.chars().filter(|digit| !digit.is_whitespace()).collect();
    digits
        .chunks(2)
        .map(|pair| u8::from_str_radix(&pair.iter().collect::<String>(), 16).unwrap())
        .collect()
}

fn degrees(angles: [f64; DOF]) -> [Option<f32>; DOF] {
    angles.map(|angle| Some(angle.to_radians() as f32))
}

/// 60°/s and 500°/s².
const PACE: Pace = Pace { speed: FRAC_PI_3, acceleration: 500.0 / 180.0 * PI, duration: 0.0 };

/// Requests with the bytes that the vendor's client sends for them, after transaction and protocol.
fn golden_requests() -> Vec<(Request, &'static str)> {
    let target = degrees([10.0, -20.0, 5.0, 30.0, 0.0, 40.0, 0.0]);
    let pace = PACE;
    let joints = "c2b8323e c2b8b2be c2b8b23d 920a063f 00000000 c2b8323f 00000000";
    let to = |values: [f64; 6]| values.map(Some);
    let line = |target, speed| {
        let pace = Pace { speed, acceleration: 2.0, duration: 0.0 };
        let form = LineForm::Common {
            radius: None,
            frame: 0,
            rotation: 0,
            check: Check::Move,
            kind: None,
        };
        Request::MoveLine(LineMove { target, pace, form })
    };
    let mut only_z = [None; 6];
    only_z[2] = Some(0.22);
    let position = to([0.3, 0.0, 0.2, PI, 0.0, 0.0]);
    let rtu = |body| Request::Rs485(Rtu { host: 9, slave: 8, body });
    let write = |address, values: &[u16]| rtu(RtuBody::Write { address, values: values.to_vec() });
    let read = |address, count| rtu(RtuBody::Read { address, count });
    let hex = |text: String| &*text.leak();
    vec![
        (Request::GetVersion, "0001 01"),
        (Request::EnableMotion(Axis::ALL, Power::On), "0003 0b 08 01"),
        (Request::GetState, "0001 0d"),
        (Request::SetMode(Mode::POSITION, Some(0)), "0003 13 00 00"),
        (Request::SetMode(Mode::POSITION, None), "0002 13 00"),
        (Request::SetState(StateCommand::Run), "0002 0c 00"),
        (Request::SetState(StateCommand::Stop), "0002 0c 04"),
        (Request::GetJoints(None), "0001 2a"),
        (Request::GetJoints(Some(3)), "0002 2a 03"),
        (Request::GetTcpPose, "0001 29"),
        (
            Request::MoveJoints(JointMove { target, pace, check: Check::Absent }),
            hex(format!("0029 17 {joints} 920a863f 58a00b41 00000000")),
        ),
        (
            Request::MoveJointsBlended {
                target,
                speed: pace.speed,
                acceleration: pace.acceleration,
                radius: 0.01,
            },
            hex(format!("0029 18 {joints} 920a863f 58a00b41 00002041")),
        ),
        (
            Request::ServoJoints(JointConfig::new(target.map(Option::unwrap)), pace),
            hex(format!("0029 1d {joints} 920a863f 58a00b41 00000000")),
        ),
        (
            line(position, 0.2),
            "002c 15 00009643 00000000 00004843 db0f4940 00000000 00000000 00004843 0000fa44 00000000 000080bf 00 00 00",
        ),
        (
            line(only_z, 0.2),
            "002c 15 0000807f 0000807f 00005c43 0000807f 0000807f 0000807f 00004843 0000fa44 00000000 000080bf 00 00 00",
        ),
        (Request::CleanError, "0001 10"),
        (Request::SetFeedback(2), "0002 fe 02"),
        (Request::FeedbackCheck, "0001 fd"),
        (Request::ReadTool { host: 9, address: 0x0a0b }, "0004 80 09 0a0b"),
        (write(gripper_register::MODE, &[0]), "000b 7c 09 08 10 0101 0001 02 0000"),
        (write(gripper_register::TARGET, &[0, 600]), "000d 7c 09 08 10 0700 0002 04 00000258"),
        (read(gripper_register::ERROR, 1), "0008 7c 09 08 03 000f 0001"),
        (read(gripper_register::POSITION, 2), "0008 7c 09 08 03 0702 0002"),
        (
            Request::Other {
                register: register::SET_LOAD,
                params: bytes("85eb513f 00000000 00000000 00004042"),
            },
            "0011 24 85eb513f 00000000 00000000 00004042",
        ),
    ]
}

#[test]
fn requests_are_the_bytes_of_the_vendors_client() {
    for (request, rest) in golden_requests() {
        let frame = request.to_frame(7, WITH_HEARTBEAT);
        assert_eq!(frame.encode(), [bytes("0007 0003"), bytes(rest)].concat(), "{request:?}");
    }
}

#[test]
fn the_bytes_of_the_vendors_client_are_those_requests() {
    for (request, rest) in golden_requests() {
        let mut reader = FrameReader::default();
        reader.push(&[bytes("0007 0003"), bytes(rest)].concat());
        let frame = reader.next_frame().unwrap().unwrap();
        let found = Request::from_frame(&frame).unwrap();
        // The constants of this test are rounded, the bytes are not.
        assert_eq!(found.to_frame(7, WITH_HEARTBEAT), frame, "{found:?}");
        assert_eq!(core::mem::discriminant(&found), core::mem::discriminant(&request));
    }
}

#[test]
fn replies_are_the_bytes_that_the_vendors_client_takes() {
    let queued = |check| Answer::Queued(1, check);
    let gripper = |hex: &str| Answer::Rs485(bytes(hex));
    for (request, status, answer, rest) in [
        (
            "0001 01",
            0x10,
            Answer::Text("7,7,XI1304,AC1304,v2.5.0".to_owned()),
            "002a 01 10 372c372c",
        ),
        ("0003 0b 08 01", 0x10, Answer::Done, "0002 0b 10"),
        ("0001 0d", 0x10, Answer::State(State::Reconfigured), "0003 0d 10 05"),
        ("0002 0c 00", 0x00, Answer::Done, "0002 0c 00"),
        ("0001 2a", 0x00, Answer::Joints(vec![[0.0; DOF]]), "001e 2a 00 00000000"),
        ("0029 17", 0x00, queued(None), "0004 17 00 0001"),
        ("002c 15", 0x00, queued(Some(0)), "0005 15 00 0001 00"),
        ("0004 80", 0x00, Answer::Value(11), "0006 80 00 0000000b"),
        ("0008 7c", 0x00, gripper("09 08 03 04 00000258"), "000a 7c 00 09 08 03 04 00000258"),
    ] {
        let register = bytes(request)[2];
        let asked = Frame { transaction: 7, protocol: WITH_HEARTBEAT, body: vec![register] };
        let frame = Reply { status: Status(status), answer: answer.clone() }.to_frame(&asked);
        let (found, expected) = (frame.encode(), [bytes("0007 0003"), bytes(rest)].concat());
        assert!(found.starts_with(&expected), "{found:02x?} begins otherwise than {expected:02x?}");
        assert_eq!(Reply::from_frame(&frame).unwrap(), Reply { status: Status(status), answer });
    }
}

#[test]
fn feedback_is_the_bytes_that_the_vendors_client_takes() {
    let feedback = Feedback {
        transaction: 9,
        protocol: WITH_HEARTBEAT,
        register: register::MOVE_JOINTS,
        kind: FeedbackKind::End,
        code: FeedbackCode::Done,
        task: 2,
        micros: 0x0102,
    };
    assert_eq!(
        feedback.to_frame(Status(0)).encode(),
        bytes("0009 0003 000f ff 00 02 17 0002 00 0000000000000102")
    );
}

fn arm(state: State, joints: [f32; DOF], pose: TcpPose) -> ArmReading {
    ArmReading {
        state,
        mode: Mode::SERVO,
        queued: 3,
        joints: JointConfig::new(joints),
        pose,
        torques: [0.5; DOF],
    }
}

fn health(error: u8) -> Health {
    Health {
        brakes: 0xff,
        drives: 0xff,
        error,
        warning: 0,
        tcp_offset: TcpPose { position: [0.0; 3], rpy: [0.0; 3] },
        load_mass: 0.82,
        load_center: [0.0, 0.0, 0.048],
        collision_sensitivity: 3,
        teach_sensitivity: 3,
        gravity: [0.0, 0.0, -1.0],
    }
}

/// Numbers of the wire: an `f32` of millimetres, as metres.
fn length() -> impl Strategy<Value = f64> {
    (-2000.0_f32..2000.0).prop_map(|mm| f64::from(mm) / 1000.0)
}

fn angle() -> impl Strategy<Value = f64> {
    (-7.0_f32..7.0).prop_map(f64::from)
}

fn pose() -> impl Strategy<Value = TcpPose> {
    (prop::array::uniform3(length()), prop::array::uniform3(angle()))
        .prop_map(|(position, rpy)| TcpPose { position, rpy })
}

fn joints() -> impl Strategy<Value = [f32; DOF]> {
    prop::array::uniform7(-7.0_f32..7.0)
}

fn pace() -> impl Strategy<Value = Pace> {
    [angle(), angle(), angle()].prop_map(|[speed, acceleration, duration]| Pace {
        speed,
        acceleration,
        duration,
    })
}

fn joint_target() -> impl Strategy<Value = [Option<f32>; DOF]> {
    prop::array::uniform7(prop::option::of(-7.0_f32..7.0))
}

fn check() -> impl Strategy<Value = Check> {
    prop::sample::select(vec![Check::Absent, Check::Move, Check::Only])
}

fn line() -> impl Strategy<Value = LineMove> {
    let target = (
        prop::array::uniform3(prop::option::of(length())),
        prop::array::uniform3(prop::option::of(angle())),
    );
    let pace = (length(), length(), angle());
    let radius = (0.0_f32..100.0).prop_map(|mm| f64::from(mm) / 1000.0);
    let common =
        (prop::option::of(radius), 0..2_u8, 0..2_u8, any::<bool>(), prop::option::of(any::<u8>()));
    (target, pace, prop::option::of(common)).prop_map(
        |(([x, y, z], [roll, pitch, yaw]), pace, common)| {
            let (speed, acceleration, duration) = pace;
            let form = common.map_or(LineForm::Classic, |(radius, frame, rotation, only, kind)| {
                let check = if only { Check::Only } else { Check::Move };
                LineForm::Common { radius, frame, rotation, check, kind }
            });
            let pace = Pace { speed, acceleration, duration };
            LineMove { target: [x, y, z, roll, pitch, yaw], pace, form }
        },
    )
}

fn request() -> impl Strategy<Value = Request> {
    let commands =
        vec![StateCommand::Run, StateCommand::Pause, StateCommand::Stop, StateCommand::SlowStop];
    let bytes = || prop::collection::vec(any::<u8>(), 0..40);
    let write = (any::<u16>(), prop::collection::vec(any::<u16>(), 0..20));
    let body = prop_oneof![
        (any::<u16>(), any::<u16>()).prop_map(|(address, count)| RtuBody::Read { address, count }),
        write.prop_map(|(address, values)| RtuBody::Write { address, values }),
    ];
    prop_oneof![
        Just(Request::GetVersion),
        Just(Request::GetTcpPose),
        Just(Request::CleanWarning),
        (any::<u8>(), any::<bool>()).prop_map(|(axis, on)| Request::EnableMotion(
            Axis(axis),
            if on { Power::On } else { Power::Off }
        )),
        prop::sample::select(commands).prop_map(Request::SetState),
        (any::<u8>(), prop::option::of(any::<u8>()))
            .prop_map(|(mode, detection)| Request::SetMode(Mode(mode), detection)),
        line().prop_map(Request::MoveLine),
        (joint_target(), pace(), check()).prop_map(|(target, pace, check)| Request::MoveJoints(
            JointMove { target, pace, check }
        )),
        (joint_target(), angle(), angle(), length()).prop_map(
            |(target, speed, acceleration, radius)| {
                Request::MoveJointsBlended { target, speed, acceleration, radius }
            }
        ),
        pace().prop_map(Request::MoveHome),
        (joints(), pace())
            .prop_map(|(joints, pace)| Request::ServoJoints(JointConfig::new(joints), pace)),
        prop::option::of(any::<u8>()).prop_map(Request::GetJoints),
        pose().prop_map(Request::GetIk),
        joints().prop_map(|joints| Request::GetFk(JointConfig::new(joints))),
        (any::<u8>(), any::<u8>(), body).prop_map(|(host, slave, body)| Request::Rs485(Rtu {
            host,
            slave,
            body
        })),
        (any::<u8>(), any::<u16>()).prop_map(|(host, address)| Request::ReadTool { host, address }),
        (200..230_u8, bytes()).prop_map(|(register, params)| Request::Other { register, params }),
    ]
}

/// A register with an answer that it may give.
fn answer() -> impl Strategy<Value = (u8, Answer)> {
    let states = vec![
        State::Moving,
        State::Ready,
        State::Paused,
        State::Stopped,
        State::Reconfigured,
        State::Decelerating,
    ];
    prop_oneof![
        Just((register::SET_MODE, Answer::Done)),
        "[ -~]{1,40}".prop_map(|text| (register::GET_VERSION, Answer::Text(text))),
        prop::sample::select(states).prop_map(|state| (register::GET_STATE, Answer::State(state))),
        any::<u16>().prop_map(|count| (register::GET_COMMAND_COUNT, Answer::Count(count))),
        any::<(u8, u8)>()
            .prop_map(|(error, warning)| (register::GET_ERROR, Answer::Codes(error, warning))),
        (any::<u16>(), prop::option::of(any::<u8>()))
            .prop_map(|(number, check)| (register::MOVE_JOINTS, Answer::Queued(number, check))),
        prop::collection::vec(joints(), 1..4)
            .prop_map(|groups| (register::GET_JOINTS, Answer::Joints(groups))),
        pose().prop_map(|pose| (register::GET_FK, Answer::Pose(pose))),
        any::<i32>().prop_map(|value| (register::READ_TOOL_16, Answer::Value(value))),
        prop::collection::vec(any::<u8>(), 1..20)
            .prop_map(|bytes| (register::RS485, Answer::Rs485(bytes))),
    ]
}

fn report() -> impl Strategy<Value = Report> {
    let states = vec![
        State::Moving,
        State::Ready,
        State::Paused,
        State::Stopped,
        State::Reconfigured,
        State::Decelerating,
    ];
    let kinds = vec![ReportKind::Fast, ReportKind::Realtime, ReportKind::Normal, ReportKind::Rich];
    let parts = (
        prop::sample::select(kinds),
        prop::sample::select(states),
        joints(),
        pose(),
        any::<u8>(),
        length(),
    );
    parts.prop_map(|(kind, state, joints, pose, error, tcp_speed)| {
        let (arm, health) = (arm(state, joints, pose), health(error));
        match kind {
            ReportKind::Fast => Report::Fast(FastReport {
                micros: u64::from(error) << 40,
                state,
                mode: Mode::SERVO,
                queued: 3,
                target: JointConfig::new([0.1; DOF]),
                joints: JointConfig::new(joints),
                joint_speeds: [0.2; DOF],
                position: pose.position,
                axis_angle: [0.1, 0.2, 0.3],
            }),
            ReportKind::Realtime => Report::Realtime(RealtimeReport {
                arm,
                external_force: [1.0; 6],
                raw_force: [-1.0; 6],
            }),
            ReportKind::Normal => Report::Normal(NormalReport { arm, health }),
            ReportKind::Rich => Report::Rich(Box::new(RichReport {
                arm,
                health,
                firmware: "v2.5.0".to_owned(),
                tcp_limits: [1.0, 2.0, 50.0, 0.5, 1.0],
                joint_limits: [1.0, 2.0, 20.0, 0.5, 3.0],
                tcp_speed,
                joint_speeds: joints,
            })),
        }
    })
}

const fn kind(report: &Report) -> ReportKind {
    match report {
        Report::Fast(_) => ReportKind::Fast,
        Report::Realtime(_) => ReportKind::Realtime,
        Report::Normal(_) => ReportKind::Normal,
        Report::Rich(_) => ReportKind::Rich,
    }
}

proptest! {
    #[test]
    fn a_request_comes_back_as_it_was(request in request(), transaction in any::<u16>(), protocol in 2..4_u16) {
        let frame = request.to_frame(transaction, protocol);
        prop_assert_eq!(Request::from_frame(&frame).unwrap(), request);
    }

    #[test]
    fn a_reply_comes_back_as_it_was((register, answer) in answer(), status in any::<u8>()) {
        let asked = Frame { transaction: 1, protocol: PRIVATE_PROTOCOL, body: vec![register] };
        let reply = Reply { status: Status(status), answer };
        prop_assert_eq!(Reply::from_frame(&reply.to_frame(&asked)).unwrap(), reply);
    }

    #[test]
    fn a_report_comes_back_as_it_was_and_has_its_length(report in report()) {
        let bytes = report.encode();
        prop_assert_eq!(bytes.len(), kind(&report).bytes());
        let mut reader = ReportReader::new(kind(&report));
        reader.push(&bytes);
        prop_assert_eq!(reader.next_report().unwrap(), Some(report));
        prop_assert_eq!(reader.next_report().unwrap(), None);
    }

    #[test]
    fn frames_arrive_whole_however_they_are_cut(requests in prop::collection::vec(request(), 1..8), cut in 1..50_usize) {
        let frames: Vec<_> = (0..).zip(&requests).map(|(idx, request)| request.to_frame(idx, PRIVATE_PROTOCOL)).collect();
        let bytes: Vec<u8> = frames.iter().flat_map(Frame::encode).collect();
        let (mut reader, mut found) = (FrameReader::default(), Vec::new());
        for part in bytes.chunks(cut) {
            reader.push(part);
            while let Some(frame) = reader.next_frame().unwrap() {
                found.push(frame);
            }
        }
        prop_assert_eq!(found, frames);
    }
}

#[test]
fn a_length_that_no_frame_has_is_an_error() {
    for length in ["0000", "1001", "ffff"] {
        let mut reader = FrameReader::default();
        reader.push(&bytes(&format!("0001 0002 {length}")));
        assert!(matches!(reader.next_frame(), Err(WireError::FrameLength(_))), "{length}");
    }
    let mut reports = ReportReader::new(ReportKind::Realtime);
    reports.push(&bytes("00000091"));
    assert_eq!(reports.next_report(), Err(WireError::ReportLength { expected: 135, found: 145 }));
}

#[test]
fn a_report_of_a_joint_that_is_no_number_is_an_error() {
    let pose = TcpPose { position: [0.0; 3], rpy: [0.0; 3] };
    let mut joints = [0.0; DOF];
    joints[3] = f32::NAN;
    let report = Report::Realtime(RealtimeReport {
        arm: arm(State::Ready, joints, pose),
        external_force: [0.0; 6],
        raw_force: [0.0; 6],
    });
    let mut reader = ReportReader::new(ReportKind::Realtime);
    reader.push(&report.encode());
    assert_eq!(reader.next_report(), Err(WireError::NotFinite("reported joint angle")));
}

/// Bytes of every kind of frame, to be damaged.
fn samples() -> Vec<Vec<u8>> {
    golden_requests()
        .into_iter()
        .map(|(request, _)| request.to_frame(1, PRIVATE_PROTOCOL).encode())
        .collect()
}

#[test]
fn damaged_frames_are_refused_or_read_and_never_panic() {
    let rng = &mut stream(1, Stream::Noise, 0);
    let samples = samples();
    for _ in 0..100_000 {
        let mut bytes = samples[rng.random_range(0..samples.len())].clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
        bytes.truncate(rng.random_range(0..=bytes.len()));
        let mut reader = FrameReader::default();
        reader.push(&bytes);
        while let Ok(Some(frame)) = reader.next_frame() {
            let _ = Request::from_frame(&frame);
            let _ = Reply::from_frame(&frame);
        }
    }
}

#[test]
fn damaged_reports_are_refused_or_read_and_never_panic() {
    let rng = &mut stream(1, Stream::Noise, 1);
    let pose = TcpPose { position: [0.0; 3], rpy: [0.0; 3] };
    let arm = arm(State::Ready, [0.0; DOF], pose);
    let report = Report::Normal(NormalReport { arm, health: health(0) }).encode();
    for _ in 0..100_000 {
        let mut bytes = report.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
        let mut reader = ReportReader::new(ReportKind::Normal);
        reader.push(&bytes);
        while let Ok(Some(_)) = reader.next_report() {}
    }
}
