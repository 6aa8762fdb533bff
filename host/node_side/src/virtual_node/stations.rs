//! A served node as a Modbus station: over TCP (one frame per request, any unit number) and as RTU over a
//! pseudo-terminal.
//!
//! Both are answered by the node's own server from the node's own map ([`meshband::modbus`]); RTU by its own receiver,
//! too, with the silence of its rate, measured on this host's clock. A board speaks RTU only, and the link or Modbus,
//! not both: here both may be tried at once. Sources: "MODBUS messaging on TCP/IP implementation guide V1.0b" (header
//! of seven bytes).

use crate::virtual_node::image::TICKS_PER_SECOND;
use crate::{Error, Result};
use meshband::config::{LineFormat, LinkConfig, Personality};
use meshband::modbus::Command;
use meshband::modbus::bank::Bank;
use meshband::modbus::line::{Line, Request};
use meshband::modbus::map::{Traffic, View};
use meshband::modbus::server::{Answer, Outcome, answer};
use meshband::node::Node;
use meshband::units::TicksPerSecond;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Instant;

/// Header before a request over TCP: transaction, protocol, length, unit.
const HEADER: usize = 7;
/// Bytes that the header's length counts of the header itself.
const UNIT: usize = 1;
/// Longest request: header and a PDU of 253 bytes.
const MAX_REQUEST_BYTES: usize = HEADER + 253;
/// Most masters at once.
const MAX_MASTERS: usize = 16;
/// Address of the station where none is configured.
pub const ADDRESS: u8 = 1;

/// All ways in which registers of a served node are read.
pub struct Stations {
    address: u8,
    listeners: Vec<TcpListener>,
    masters: Vec<Master>,
    #[cfg(unix)]
    lines: Vec<rtu::Terminal>,
    exceptions: u16,
    begun: Instant,
}

/// What requests of one look have brought.
#[derive(Default)]
struct Served {
    refused: u16,
    commands: Vec<Command>,
}

impl Served {
    /// Counts what came of a request; its answer.
    fn take(&mut self, (answer, outcome): Outcome) -> Answer {
        self.refused += u16::from(outcome.is_err());
        self.commands.extend(outcome.unwrap_or(None));
        answer
    }
}

struct Master {
    stream: TcpStream,
    pending: Vec<u8>,
    gone: bool,
}

impl Stations {
    /// None, or those of `--modbus`: `tcp:PORT`, `tcp:HOST:PORT`, `rtu`.
    ///
    /// # Errors
    /// Another text, a port that cannot be had.
    pub fn new(wanted: &[String], link: &LinkConfig) -> Result<Self> {
        let address = if link.address == 0 { ADDRESS } else { link.address };
        let mut stations = Self {
            address,
            listeners: Vec::new(),
            masters: Vec::new(),
            #[cfg(unix)]
            lines: Vec::new(),
            exceptions: 0,
            begun: Instant::now(),
        };
        for text in wanted {
            stations.add(text, link).map_err(|error| Error::invalid("--modbus", error))?;
        }
        Ok(stations)
    }

    fn add(&mut self, text: &str, link: &LinkConfig) -> std::result::Result<(), String> {
        if text == "rtu" {
            return self.add_line(link);
        }
        let address = super::peers::address("--modbus", text)
            .map_err(|_| format!("'{text}' is neither tcp:PORT nor rtu (a pseudo-terminal)"))?;
        let listener = TcpListener::bind(&address).map_err(|error| format!("{text}: {error}"))?;
        listener.set_nonblocking(true).map_err(|error| format!("{text}: {error}"))?;
        self.listeners.push(listener);
        Ok(())
    }

    #[cfg(unix)]
    fn add_line(&mut self, link: &LinkConfig) -> std::result::Result<(), String> {
        self.lines.push(rtu::Terminal::new(link).map_err(|error| format!("rtu: {error}"))?);
        Ok(())
    }

    #[cfg(not(unix))]
    fn add_line(&mut self, _: &LinkConfig) -> std::result::Result<(), String> {
        Err("rtu needs a pseudo-terminal, which this system has not".into())
    }

    /// Each as a master names it.
    pub fn names(&self) -> Vec<String> {
        let of_tcp = self.listeners.iter().filter_map(|listener| listener.local_addr().ok());
        let names = of_tcp.map(|address| format!("Modbus TCP at {address}"));
        #[cfg(unix)]
        let names = names.chain(self.lines.iter().map(|line| format!("Modbus RTU at {}", line.name)));
        names.map(|name| format!("{name}, address {}", self.address)).collect()
    }

    /// Answers what has been asked; what masters ask the node to do.
    pub fn serve(&mut self, node: &Node, bank: &Bank) -> Vec<Command> {
        #[cfg(unix)]
        let heard = self.lines.first().map(rtu::Terminal::heard).unwrap_or_default();
        #[cfg(not(unix))]
        let heard = Default::default();
        let view = View::of(node, bank, Traffic { heard, exceptions: self.exceptions });
        let address = self.address;
        let asked = |request: &Request| answer(address, request, &view, &|place: u32| node.held_sample(place));
        let mut served = Served::default();
        #[cfg(unix)]
        for line in &mut self.lines {
            let now = (self.begun.elapsed().as_secs_f64() * f64::from(TICKS_PER_SECOND)) as u64 as u32;
            line.serve(address, now, &asked, &mut served);
        }
        for listener in &self.listeners {
            while let Ok((stream, _)) = listener.accept() {
                if stream.set_nonblocking(true).is_ok() && self.masters.len() < MAX_MASTERS {
                    self.masters.push(Master { stream, pending: Vec::new(), gone: false });
                }
            }
        }
        for master in &mut self.masters {
            master.serve(&asked, &mut served);
        }
        self.exceptions = self.exceptions.wrapping_add(served.refused);
        self.masters.retain(|master| !master.gone);
        served.commands
    }
}

impl Master {
    /// Answers all whole requests.
    fn serve(&mut self, asked: &impl Fn(&Request) -> Option<Outcome>, served: &mut Served) {
        let mut buffer = [0; 1024];
        match self.stream.read(&mut buffer) {
            Ok(0) => self.gone = true,
            Ok(count) => self.pending.extend_from_slice(&buffer[..count]),
            Err(error) => self.gone |= !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        }
        while let Some(length) = self.length() {
            let request: Vec<u8> = self.pending.drain(..length).collect();
            let (header, pdu) = request.split_at(HEADER);
            let request = pdu.split_first().map(|(&function, rest)| Request::of(function, rest));
            let Some(outcome) = request.and_then(|request| asked(&request)) else { continue };
            self.gone |= self.stream.write_all(&framed(header, &served.take(outcome))).is_err();
        }
    }

    /// Length of the first request, once it is whole; nonsense ends the connection.
    fn length(&mut self) -> Option<usize> {
        let header = self.pending.get(..HEADER)?;
        let length = HEADER - UNIT + usize::from(u16::from_be_bytes([header[4], header[5]]));
        let sane = header[2..4] == [0, 0] && (HEADER + 1..=MAX_REQUEST_BYTES).contains(&length);
        self.gone |= !sane;
        (sane && self.pending.len() >= length).then_some(length)
    }
}

/// An answer of the serial line, address before and checksum behind it, as TCP has it.
fn framed(header: &[u8], answer: &Answer) -> Vec<u8> {
    let pdu = &answer[1..answer.len() - 2];
    let length = (pdu.len() + UNIT) as u16;
    [&header[..4], &length.to_be_bytes()[..], &header[6..HEADER], pdu].concat()
}

/// How the line of a station is set, whatever language the configuration names.
pub fn format(link: &LinkConfig) -> LineFormat {
    LineFormat::of_modbus(&LinkConfig { personality: Personality::Modbus, ..*link })
}

#[cfg(unix)]
mod rtu {
    use super::{Line, LinkConfig, Outcome, Read, Request, Served, TICKS_PER_SECOND, TicksPerSecond, Write, format};
    use meshband::modbus::line::Heard;
    use serialport::{SerialPort, TTYPort};
    use std::time::Duration;

    /// How long a look waits for bytes.
    const LOOK: Duration = Duration::from_millis(1);

    /// A pseudo-terminal with a station behind it.
    pub struct Terminal {
        /// While no master has the far end open, reading and writing fail: that is silence.
        near: TTYPort,
        /// Path for the master.
        pub name: String,
        line: Line,
    }

    impl Terminal {
        pub fn new(link: &LinkConfig) -> Result<Self, String> {
            // The far end is let go: who holds it keeps masters out.
            let (mut near, far) = TTYPort::pair().map_err(|error| error.to_string())?;
            near.set_timeout(LOOK).map_err(|error| error.to_string())?;
            let name = far.name().ok_or("the pseudo-terminal has no path")?;
            let line = Line::new(format(link), TicksPerSecond(TICKS_PER_SECOND));
            Ok(Self { near, name, line })
        }

        pub fn heard(&self) -> Heard {
            self.line.heard()
        }

        /// Answers a request that has ended.
        pub fn serve(
            &mut self,
            address: u8,
            now: u32,
            asked: &impl Fn(&Request) -> Option<Outcome>,
            served: &mut Served,
        ) {
            let mut buffer = [0; 256];
            let count = self.near.read(&mut buffer).unwrap_or(0);
            buffer[..count].iter().for_each(|&byte| self.line.push(byte));
            let Some(outcome) = self.line.look(address, now).and_then(|request| asked(&request)) else { return };
            let answer = served.take(outcome);
            self.line.answered(&answer);
            // A master that has gone misses its answer.
            let _ = self.near.write_all(&answer);
        }
    }
}
