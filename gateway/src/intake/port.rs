//! Links to nodes: serial ports and TCP.
//!
//! The host's command has the same in its `link::transport`; taken from there it would bring the whole workbench into
//! the gateway's build (solver, importers, pictures: ten times the code). What is common, frames and messages, is
//! `meshband`'s.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Bit rate of the nodes' serial link.
const BITS_PER_SECOND: u32 = meshband::link::BITS_PER_SECOND;
/// How long a read waits for its first byte; commands wait as long.
const READ_PATIENCE: Duration = Duration::from_millis(50);
/// How long connecting and writing may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// An open link.
pub trait Port: Read + Write + Send {}
impl<T: Read + Write + Send> Port for T {}

/// Opens `tcp:HOST:PORT` or a serial port, which is then locked against others.
///
/// # Errors
/// The system's reason.
pub fn open(name: &str) -> std::io::Result<Box<dyn Port>> {
    if let Some(address) = name.strip_prefix("tcp:") {
        let mut outcome = Err(ErrorKind::AddrNotAvailable.into());
        for address in address.to_socket_addrs()? {
            outcome = TcpStream::connect_timeout(&address, PATIENCE);
            if outcome.is_ok() {
                break;
            }
        }
        let stream = outcome?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(READ_PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        return Ok(Box::new(stream));
    }
    let serial = serialport::new(name, BITS_PER_SECOND).timeout(READ_PATIENCE).open()?;
    Ok(Box::new(Serial(serial)))
}

struct Serial(Box<dyn serialport::SerialPort>);

impl Read for Serial {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self.0.read(buffer) {
            // A serial line has no end.
            Ok(0) => Err(ErrorKind::TimedOut.into()),
            other => other,
        }
    }
}

impl Write for Serial {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}
