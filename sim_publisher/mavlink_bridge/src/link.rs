//! The link to the vehicle: a UDP socket or a serial port. It blocks only in a wait with a time limit.

use crate::frames::Peer;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, ioctl_tiocexcl, tcflush, tcgetattr, tcsetattr,
};
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::str::FromStr;
use std::time::Duration;

/// Baud rate of a serial port, unless stated: the default of autopilots' telemetry ports.
const DEFAULT_BAUD: u32 = 57_600;

/// The address at which the vehicle's messages arrive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// Listens there.
    Udp(String),
    /// Sends first, to this address.
    UdpOut(String),
    /// A serial port.
    Serial {
        /// Its device file.
        path: String,
        /// Its speed (bit/s).
        baud: u32,
    },
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let needed = || {
            format!(
                "'{text}': needed: udp:ADDRESS:PORT to listen there, udpout:HOST:PORT to speak first, \
                 or serial:DEVICE[:BAUD], for example udp:0.0.0.0:14550 or serial:/dev/ttyUSB0:921600"
            )
        };
        let (kind, rest) = text.split_once(':').ok_or_else(needed)?;
        let has_port =
            rest.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
        match kind {
            "udp" | "udpin" if has_port => Ok(Self::Udp(rest.into())),
            "udpout" if has_port => Ok(Self::UdpOut(rest.into())),
            "serial" if rest.starts_with('/') => Ok(match rest.rsplit_once(':') {
                // Names of devices may hold colons of their own.
                Some((path, baud)) if baud.parse::<u32>().is_ok_and(|baud| baud >= 300) => {
                    Self::Serial { path: path.into(), baud: baud.parse().map_err(|_| needed())? }
                }
                _ => Self::Serial { path: rest.into(), baud: DEFAULT_BAUD },
            }),
            _ => Err(needed()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(at) => write!(f, "udp:{at}"),
            Self::UdpOut(to) => write!(f, "udpout:{to}"),
            Self::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
        }
    }
}

/// Why the link cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Another program listens there.
    #[error(
        "{0} is in use by another program (a ground station?); needed: a port of its own: end that program (ss -ulpn tells \
         which), or let the vehicle or a MAVLink router send to another port, too"
    )]
    InUse(Address),
    /// The system refused the socket of this address.
    #[error("cannot open {0}: {1}; needed: an address of this machine, or 0.0.0.0 for all of them")]
    Socket(Address, #[source] std::io::Error),
    /// This name leads nowhere.
    #[error("cannot find '{0}': {1}; needed: HOST:PORT")]
    Host(String, #[source] std::io::Error),
    /// No such device; those that are there.
    #[error("no serial port '{0}'; {1}")]
    NoPort(String, String),
    /// No right to use it.
    #[error(
        "no permission for '{0}'; needed: to be in the group that owns it (often dialout): \
         sudo usermod -a -G dialout $USER, then log in again"
    )]
    Permission(String),
    /// Another program holds the port.
    #[error(
        "'{0}' is held by another program (ModemManager? a ground station?); end that one first: fuser -v {0}"
    )]
    Held(String),
    /// It is no serial port, or cannot be set.
    #[error("cannot use '{path}' as a serial port at {baud} baud: {cause}")]
    Port {
        /// Which.
        path: String,
        /// Speed asked for (bit/s).
        baud: u32,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// The device of this address has gone.
    #[error("{0}: {1}")]
    Gone(Address, #[source] std::io::Error),
}

/// An open link.
#[derive(Debug)]
pub enum Link {
    /// A socket, and the address of its answers if `to` names no other.
    Udp(UdpSocket, Peer),
    /// A serial port.
    Serial(File),
}

/// The first address of `HOST:PORT`.
///
/// # Errors
/// `Host` where there is none.
pub(crate) fn resolve(name: &str) -> Result<SocketAddr, LinkError> {
    let host = |cause| LinkError::Host(name.into(), cause);
    let mut found = name.to_socket_addrs().map_err(host)?;
    found.next().ok_or_else(|| host(ErrorKind::NotFound.into()))
}

impl Link {
    /// Opens it.
    ///
    /// # Errors
    /// What was found, and what to do.
    pub fn open(address: &Address) -> Result<Self, LinkError> {
        let socket_error = |cause: std::io::Error| match cause.kind() {
            ErrorKind::AddrInUse => LinkError::InUse(address.clone()),
            _ => LinkError::Socket(address.clone(), cause),
        };
        let (at, to) = match address {
            Address::Udp(at) => (resolve(at)?, None),
            Address::UdpOut(to) => {
                let to = resolve(to)?;
                (if to.is_ipv4() { ([0; 4], 0).into() } else { ([0u16; 8], 0).into() }, Some(to))
            }
            Address::Serial { path, baud } => return serial(path, *baud).map(Self::Serial),
        };
        let socket = UdpSocket::bind(at).map_err(socket_error)?;
        socket.set_nonblocking(true).map_err(socket_error)?;
        Ok(Self::Udp(socket, to))
    }

    /// Waits until bytes arrive, at most this long.
    pub fn wait(&self, max: Duration) {
        let mut fds = [PollFd::new(self, PollFlags::IN)];
        let max = Timespec { tv_sec: max.as_secs().cast_signed(), tv_nsec: i64::from(max.subsec_nanos()) };
        // A signal ends the wait, as intended; other errors show in the next read.
        let _ = poll(&mut fds, Some(&max));
    }

    /// Reads the next bytes into `bytes` and returns their number and sender; `None` if nothing has arrived.
    ///
    /// # Errors
    /// The system's reason where the device has gone.
    pub fn receive(&self, bytes: &mut [u8]) -> Result<Option<(usize, Peer)>, std::io::Error> {
        let received = match self {
            Self::Udp(socket, _) => socket.recv_from(bytes).map(|(n, from)| (n, Some(from))),
            Self::Serial(port) => (&*port).read(bytes).map(|n| (n, None)),
        };
        match received {
            // A serial port whose device was removed reads nothing.
            Ok((0, None)) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(received) => Ok(Some(received)),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(None),
                // Of an earlier datagram without a receiver.
                ErrorKind::ConnectionRefused if matches!(self, Self::Udp(..)) => Ok(None),
                _ => Err(error),
            },
        }
    }

    /// Sends to `to`, or to the link's own peer; `false` if there is none yet, or if the link takes nothing now.
    ///
    /// # Errors
    /// The system's reason where the device has gone.
    pub fn send(&self, bytes: &[u8], to: Peer) -> Result<bool, std::io::Error> {
        let sent = match self {
            Self::Udp(socket, given) => match to.or(*given) {
                Some(to) => socket.send_to(bytes, to),
                None => return Ok(false),
            },
            Self::Serial(port) => (&*port).write(bytes),
        };
        match (sent, self) {
            (Ok(n), _) => Ok(n == bytes.len()),
            (Err(error), Self::Serial(_)) if error.kind() != ErrorKind::WouldBlock => Err(error),
            (Err(_), _) => Ok(false),
        }
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Udp(socket, _) => socket.as_fd(),
            Self::Serial(port) => port.as_fd(),
        }
    }
}

/// The port for this program alone, eight bits, no parity, no flow control, bytes as they come.
fn serial(path: &str, baud: u32) -> Result<File, LinkError> {
    let flags = (OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC).bits().cast_signed();
    let refused = |cause: std::io::Error| match cause.kind() {
        ErrorKind::NotFound => LinkError::NoPort(path.into(), ports()),
        ErrorKind::PermissionDenied => LinkError::Permission(path.into()),
        ErrorKind::ResourceBusy => LinkError::Held(path.into()),
        _ => LinkError::Port { path: path.into(), baud, cause },
    };
    let port = OpenOptions::new().read(true).write(true).custom_flags(flags).open(path).map_err(refused)?;
    let set = || {
        let mut settings = tcgetattr(&port)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.control_modes &= !(ControlModes::CRTSCTS | ControlModes::CSTOPB);
        settings.set_speed(baud)?;
        tcsetattr(&port, OptionalActions::Now, &settings)?;
        ioctl_tiocexcl(&port)?;
        // Bytes that arrived at another speed are noise.
        tcflush(&port, QueueSelector::IFlush)
    };
    set().map_err(|cause| LinkError::Port { path: path.into(), baud, cause: cause.into() })?;
    Ok(port)
}

/// The serial ports of this machine, for a message.
fn ports() -> String {
    let names = |directory: &str, prefixes: &[&str]| -> Vec<String> {
        let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        names
            .filter(|name| prefixes.iter().any(|prefix| name.starts_with(prefix)))
            .map(|name| format!("{directory}/{name}"))
            .collect()
    };
    let mut found = names("/dev/serial/by-id", &[""]);
    found.extend(names("/dev", &["ttyUSB", "ttyACM", "ttyAMA", "ttyTHS"]));
    match found.is_empty() {
        true => {
            "this machine has none at all: plug the radio or the autopilot in, and look with dmesg".into()
        }
        false => format!("there are: {}", found.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written() {
        let serial = |path: &str, baud| Address::Serial { path: path.into(), baud };
        for (text, expected) in [
            ("udp:0.0.0.0:14550", Address::Udp("0.0.0.0:14550".into())),
            ("udp:[::1]:14550", Address::Udp("[::1]:14550".into())),
            ("udpout:vehicle.local:14540", Address::UdpOut("vehicle.local:14540".into())),
            ("serial:/dev/ttyUSB0:921600", serial("/dev/ttyUSB0", 921_600)),
            ("serial:/dev/ttyACM0", serial("/dev/ttyACM0", DEFAULT_BAUD)),
            // A colon and digits that are part of the name.
            (
                "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0",
                serial("/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0", DEFAULT_BAUD),
            ),
        ] {
            assert_eq!(text.parse(), Ok(expected.clone()), "{text}");
            assert_eq!(expected.to_string().parse(), Ok(expected), "{text}");
        }
        for text in
            ["", "udp", "udp:14550", "udp::14550", "udp:host:99999", "tcp:host:1", "serial:ttyUSB0", "14550"]
        {
            let refused = text.parse::<Address>().unwrap_err();
            assert!(refused.contains("needed: udp:ADDRESS:PORT"), "{refused}");
        }
    }

    #[test]
    fn a_datagram_comes_with_its_sender_and_an_answer_finds_it() {
        let link = Link::open(&"udp:127.0.0.1:0".parse().unwrap()).unwrap();
        let Link::Udp(socket, None) = &link else { panic!("{link:?}") };
        let mut bytes = [0; 100];
        assert_eq!(link.receive(&mut bytes).unwrap(), None);
        assert!(!link.send(b"nobody", None).unwrap());
        let peer = UdpSocket::bind("127.0.0.1:0").unwrap();
        peer.send_to(b"here", socket.local_addr().unwrap()).unwrap();
        link.wait(Duration::from_secs(10));
        assert_eq!(link.receive(&mut bytes).unwrap(), Some((4, Some(peer.local_addr().unwrap()))));
        assert!(link.send(b"there", Some(peer.local_addr().unwrap())).unwrap());
        assert_eq!(peer.recv(&mut bytes).unwrap(), 5);
    }
}
