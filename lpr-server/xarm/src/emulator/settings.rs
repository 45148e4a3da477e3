//! Settings of an emulator.

use super::fault::Fault;
use super::received::Received;
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::sync::mpsc::Sender;

/// Settings of an emulator.
#[derive(Debug, Clone)]
pub struct EmulatorSettings {
    /// Address that it listens on.
    pub bind: IpAddr,
    /// Port of commands; the next one up is the second port of commands. 0 takes two free ones.
    pub command_port: u16,
    /// Ports of fast, normal, rich and real-time reports; 0 takes a free one.
    pub report_ports: [u16; 4],
    /// Directory for Unix sockets beside the ports, with the names that the vendor's SDK looks for.
    pub uds: Option<PathBuf>,
    /// Version of the firmware that it claims to be.
    pub firmware: String,
    /// A fault on purpose.
    pub fault: Option<Fault>,
    /// Hears of every frame that is received.
    pub received: Option<Sender<Received>>,
}

impl EmulatorSettings {
    /// On free ports of the loopback interface.
    #[must_use]
    pub fn on_free_ports() -> Self {
        Self {
            bind: Ipv4Addr::LOCALHOST.into(),
            command_port: 0,
            report_ports: [0; 4],
            uds: None,
            firmware: "2.5.0".to_owned(),
            fault: None,
            received: None,
        }
    }
}
