//! `lpr xarm emulate`: the controller of an arm on this computer.
//!
//! The vendor's SDK looks for its ports (502, 503, 30000 to 30003), which need a privileged user
//! below 1024, or for Unix sockets in `/tmp`: `--uds /tmp`.

use super::super::{Failure, Format, Result};
use crate::files::FileError;
use crate::signals::Signals;
use clap::Args;
use core::fmt;
use lpr_core::robot::{DOF, JointConfig, XARM7};
use lpr_xarm::Ports;
use lpr_xarm::emulator::{Channel, Emulator, EmulatorSettings, Fault, KinematicWorld, Received};
use serde::Serialize;
use std::fs::File;
use std::io::{self, LineWriter, Write as _};
use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};
use std::thread;

/// Options of `lpr xarm emulate`.
#[derive(Debug, Args)]
pub(in super::super) struct Arguments {
    /// Address to listen on
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    bind: IpAddr,
    /// Firmware that it claims to be
    #[arg(long, value_name = "VERSION", default_value = "2.5.0", value_parser = firmware)]
    firmware: String,
    /// Port of commands; the second one is the next. 0 takes free ones
    #[arg(long, value_name = "PORT", default_value_t = Ports::CONTROLLER.command)]
    command_port: u16,
    /// Ports of fast (804 bytes, 250 Hz), normal (145 bytes, 5 Hz), rich (587 bytes, 5 Hz) and
    /// real-time (135 bytes, 100 Hz) reports; 0 takes a free one
    #[arg(long, value_name = "PORTS", default_value = "30000,30001,30002,30003", value_parser = report_ports)]
    report_ports: [u16; 4],
    /// Directory for Unix sockets beside the ports, named as the vendor's SDK looks for them (in
    /// /tmp)
    #[arg(long, value_name = "DIR")]
    uds: Option<PathBuf>,
    /// Joint angles at first, radians [default: the start of the robot]
    #[arg(long, value_name = "Q,Q,Q,Q,Q,Q,Q", value_parser = start, allow_hyphen_values = true)]
    start: Option<JointConfig>,
    /// File that gets a line of JSON for every frame that is received
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// What goes wrong on purpose after a number of servo points: mute-replies@N, stall-reports@N,
    /// hold-arm@N, vanish@N or error-CODE@N
    #[arg(long, value_name = "FAULT", hide = true)]
    fault: Option<Fault>,
}

fn firmware(text: &str) -> Result<String, String> {
    let parts: Vec<_> = text.split('.').collect();
    let is_version = parts.len() == 3 && parts.iter().all(|part| part.parse::<u16>().is_ok());
    is_version
        .then(|| text.to_owned())
        .ok_or_else(|| "expected three numbers, as in 2.5.0".to_owned())
}

fn numbers<T: core::str::FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

fn report_ports(text: &str) -> Result<[u16; 4], String> {
    numbers(text).ok_or_else(|| "expected four ports, as in 30000,30001,30002,30003".to_owned())
}

fn start(text: &str) -> Result<JointConfig, String> {
    let config = JointConfig::new::<DOF>(
        numbers(text)
            .ok_or_else(|| format!("expected {DOF} angles in radians, separated by commas"))?,
    );
    match XARM7.within_limits(&config) {
        true => Ok(config),
        false => Err("outside the joint limits".to_owned()),
    }
}

/// Its addresses.
#[derive(Debug, Serialize)]
struct Listening {
    bind: IpAddr,
    command_port: u16,
    stop_port: u16,
    report_ports: [u16; 4],
}

pub(in super::super) fn run(arguments: &Arguments, format: Format) -> Result<()> {
    let signals = Signals::take()?;
    let mut settings = EmulatorSettings {
        bind: arguments.bind,
        command_port: arguments.command_port,
        report_ports: arguments.report_ports,
        uds: arguments.uds.clone(),
        firmware: arguments.firmware.clone(),
        fault: arguments.fault,
        received: None,
    };
    if let Some(path) = &arguments.log {
        let file = File::create(path).map_err(FileError::io("create", path))?;
        let (sender, receiver) = channel();
        settings.received = Some(sender);
        thread::spawn(move || log(&receiver, file));
    }
    let world = KinematicWorld::at(arguments.start.unwrap_or(XARM7.start));
    let emulator = Emulator::start(settings, world)?;
    let Ports { command, stop, fast, normal, rich, realtime } = emulator.ports();
    let report_ports = [fast, normal, rich, realtime];
    let listening =
        Listening { bind: arguments.bind, command_port: command, stop_port: stop, report_ports };
    match format {
        Format::Json => super::super::print(&listening, format)?,
        Format::Table => writeln!(io::stderr(), "{listening}").map_err(Failure::Output)?,
    }
    signals.wait();
    Ok(())
}

impl fmt::Display for Listening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bind, command_port, stop_port, report_ports: [fast, normal, rich, realtime] } =
            self;
        write!(
            f,
            "listening on {bind}: commands {command_port} and {stop_port}, reports {fast}, {normal}, {rich} and {realtime}"
        )
    }
}

/// One line of the log.
#[derive(Debug, Serialize)]
struct Line {
    connection: u64,
    port: &'static str,
    register: Option<u8>,
    /// The parameters in hexadecimal.
    params: String,
}

/// Writes what is received until the emulator ends, or the disk is full: an emulator without a log
/// is better than none.
fn log(received: &Receiver<Received>, file: File) {
    let mut writer = LineWriter::new(file);
    for Received { connection, channel, frame } in received {
        let port = if channel == Channel::Command { "command" } else { "stop" };
        let params = frame.body.iter().skip(1).map(|byte| format!("{byte:02x}")).collect();
        let line = Line { connection, port, register: frame.body.first().copied(), params };
        let Ok(text) = serde_json::to_string(&line) else { return };
        if writeln!(writer, "{text}").is_err() {
            return;
        }
    }
}
