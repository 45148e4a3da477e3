//! The server with several clients, on free ports.

use super::*;
use crate::emulator::world::KinematicWorld;
use crate::wire::State;
use lpr_core::robot::XARM7;
use std::net::{Ipv4Addr, TcpStream};

fn free() -> Emulator {
    start(EmulatorSettings::on_free_ports()).unwrap()
}

fn start(settings: EmulatorSettings) -> Result<Emulator, EmulatorError> {
    Emulator::start(settings, KinematicWorld::at(XARM7.start))
}

fn frame(stream: &mut impl io::Read) -> Frame {
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
    let emulator = start(settings).unwrap();
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
        start(EmulatorSettings { command_port, ..EmulatorSettings::on_free_ports() }).unwrap_err();
    assert!(error.to_string().contains(&format!("127.0.0.1:{command_port}")), "{error}");
}
