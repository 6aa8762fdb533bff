//! Where the bytes come from and go to.
//!
//! Ports are named as people name them: `tcp:HOST:PORT`, `tcp:PORT` on this machine, `HOST:PORT`, the path of a
//! serial port or pseudo-terminal, or a file that holds captured bytes (read only; its end is the end of the link).

use crate::{Error, Result};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

/// Bit rate of the nodes' serial link.
pub const BITS_PER_SECOND: u32 = 921_600;
/// How long a read waits for bytes.
pub const READ_PATIENCE: Duration = Duration::from_millis(50);
/// How long a write may take: a node that does not read for so long is not there.
const WRITE_PATIENCE: Duration = Duration::from_secs(5);

/// How long a connection may take to come about.
const CONNECT_PATIENCE: Duration = Duration::from_secs(5);

/// A byte link.
pub trait Transport: Send {
    /// Reads what is there, waiting at most [`READ_PATIENCE`] for the first byte; `None` when the link has ended.
    ///
    /// # Errors
    /// Of the device; a mere absence of bytes is `Some(0)`.
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>>;

    /// Writes all bytes.
    ///
    /// # Errors
    /// Of the device, or when it takes none for five seconds.
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()>;
}

/// Opens a port by name; see the module's head.
///
/// # Errors
/// [`Error::Invalid`] with the port's name and the system's reason.
pub fn open(port: &str) -> Result<Box<dyn Transport>> {
    let refuse = |reason: &dyn std::fmt::Display| Error::invalid(format!("port {port}"), reason);
    if let Some(address) = network_address(port) {
        let stream = connect(&address).map_err(|e| refuse(&e))?;
        return Ok(Box::new(Tcp::new(stream).map_err(|e| refuse(&e))?));
    }
    if Path::new(port).is_file() {
        return replay(Path::new(port));
    }
    let serial = serialport::new(port, BITS_PER_SECOND).timeout(READ_PATIENCE).open().map_err(|e| refuse(&e))?;
    Ok(Box::new(Serial(serial)))
}

/// The address that `tcp:HOST:PORT`, `tcp:PORT` (this machine) or a bare `HOST:PORT` means; none for a path.
fn network_address(port: &str) -> Option<String> {
    match port.strip_prefix("tcp:") {
        Some(number) if number.parse::<u16>().is_ok() => Some(format!("127.0.0.1:{number}")),
        Some(address) => Some(address.to_owned()),
        None => {
            let (host, number) = port.rsplit_once(':')?;
            let is_network = number.parse::<u16>().is_ok() && !host.contains(['/', '\\']) && !Path::new(port).exists();
            is_network.then(|| port.to_owned())
        }
    }
}

/// The first address of a host that takes the connection in time.
fn connect(address: &str) -> std::io::Result<TcpStream> {
    let mut outcome = Err(ErrorKind::AddrNotAvailable.into());
    for address in address.to_socket_addrs()? {
        outcome = TcpStream::connect_timeout(&address, CONNECT_PATIENCE);
        if outcome.is_ok() {
            break;
        }
    }
    outcome
}

/// A captured link from a file.
///
/// # Errors
/// [`Error::File`] where it cannot be opened.
pub fn replay(path: &Path) -> Result<Box<dyn Transport>> {
    Ok(Box::new(Replay(crate::budget::open(path)?)))
}

/// A TCP connection.
pub struct Tcp(TcpStream);

impl Tcp {
    /// Takes over a connection.
    ///
    /// # Errors
    /// Of the socket's options.
    pub fn new(stream: TcpStream) -> std::io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(READ_PATIENCE))?;
        stream.set_write_timeout(Some(WRITE_PATIENCE))?;
        Ok(Self(stream))
    }
}

impl Transport for Tcp {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        match self.0.read(buffer) {
            // A peer that is killed resets the connection: its end as well.
            Err(e) if e.kind() == ErrorKind::ConnectionReset => Ok(None),
            other => patient(other, true),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.0.write_all(bytes)
    }
}

struct Serial(Box<dyn serialport::SerialPort>);

impl Transport for Serial {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        patient(self.0.read(buffer), false)
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.0.write_all(bytes)
    }
}

struct Replay(File);

impl Transport for Replay {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        patient(self.0.read(buffer), true)
    }

    fn write(&mut self, _: &[u8]) -> std::io::Result<()> {
        Err(std::io::Error::new(ErrorKind::Unsupported, "a captured link takes no commands"))
    }
}

/// Time-outs are no errors; nothing read is the end of what has an end.
fn patient(result: std::io::Result<usize>, has_end: bool) -> std::io::Result<Option<usize>> {
    match result {
        Ok(0) if has_end => Ok(None),
        Ok(count) => Ok(Some(count)),
        Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(Some(0))
        }
        Err(e) => Err(e),
    }
}
