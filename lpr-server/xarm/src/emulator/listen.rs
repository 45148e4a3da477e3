//! Listeners of the emulator: ports, and files for the vendor's SDK.

use super::received::Channel;
use super::settings::EmulatorSettings;
use super::socket::Listener;
use crate::ports::Ports;
use crate::wire::ReportKind;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};

/// Beginning of the names of Unix sockets in the vendor's SDK, before the port of a controller.
const UDS_PREFIX: &str = "xarmcontroller_uds_";

/// Purpose of a listener.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    Commands(Channel),
    Reports(ReportKind),
}

/// Reason why an emulator does not start.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// An address that cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: String,
        /// The operating system's reason.
        source: io::Error,
    },
    /// A socket file that cannot be made.
    #[error("{}: cannot {action}: {source}", path.display())]
    File {
        /// The attempt: "create" or "delete".
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
}

impl EmulatorError {
    fn file(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::File { action, path, source }
    }
}

/// Purposes with the port that each has on a controller.
fn purposes() -> [(Purpose, u16); 6] {
    let Ports { command, stop, fast, normal, rich, realtime } = Ports::CONTROLLER;
    [
        (Purpose::Commands(Channel::Command), command),
        (Purpose::Commands(Channel::Stop), stop),
        (Purpose::Reports(ReportKind::Fast), fast),
        (Purpose::Reports(ReportKind::Normal), normal),
        (Purpose::Reports(ReportKind::Rich), rich),
        (Purpose::Reports(ReportKind::Realtime), realtime),
    ]
}

/// Listens on every port, and says on which.
pub(super) fn listen(
    settings: &EmulatorSettings,
) -> Result<(Ports, Vec<(Purpose, Listener)>), EmulatorError> {
    let EmulatorSettings {
        bind, command_port, report_ports: [fast, normal, rich, realtime], ..
    } = *settings;
    let stop_port = if command_port == 0 { 0 } else { command_port.saturating_add(1) };
    let mut ports = [command_port, stop_port, fast, normal, rich, realtime];
    let mut listeners = Vec::new();
    for ((purpose, _), port) in purposes().into_iter().zip(&mut ports) {
        listeners.push((purpose, Listener::Tcp(listen_at(bind, port)?)));
    }
    let [command, stop, fast, normal, rich, realtime] = ports;
    Ok((Ports { command, stop, fast, normal, rich, realtime }, listeners))
}

/// Listens on `port`, which becomes the one that was free when it is 0.
fn listen_at(bind: IpAddr, port: &mut u16) -> Result<TcpListener, EmulatorError> {
    let address = SocketAddr::new(bind, *port);
    let open = || {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok((listener.local_addr()?.port(), listener))
    };
    let (found, listener) =
        open().map_err(|source| EmulatorError::Listen { address: address.to_string(), source })?;
    *port = found;
    Ok(listener)
}

/// Unix sockets in `directory`; those that an emulator left behind when it was killed are replaced.
#[cfg(unix)]
pub(super) fn listen_at_files(
    directory: &Path,
    listeners: &mut Vec<(Purpose, Listener)>,
) -> Result<Vec<PathBuf>, EmulatorError> {
    use std::os::unix::net::{UnixListener, UnixStream};
    let mut sockets = Vec::new();
    for (purpose, port) in purposes() {
        let path = directory.join(format!("{UDS_PREFIX}{port}"));
        if path.exists() && UnixStream::connect(&path).is_err() {
            std::fs::remove_file(&path).map_err(EmulatorError::file("delete", &path))?;
        }
        let listener = UnixListener::bind(&path).map_err(EmulatorError::file("create", &path))?;
        listener.set_nonblocking(true).map_err(EmulatorError::file("create", &path))?;
        listeners.push((purpose, Listener::Unix(listener)));
        sockets.push(path);
    }
    Ok(sockets)
}

#[cfg(not(unix))]
pub(super) fn listen_at_files(
    directory: &Path,
    _: &mut Vec<(Purpose, Listener)>,
) -> Result<Vec<PathBuf>, EmulatorError> {
    let path = directory.join(UDS_PREFIX);
    Err(EmulatorError::file("create", &path)(io::Error::from(io::ErrorKind::Unsupported)))
}
