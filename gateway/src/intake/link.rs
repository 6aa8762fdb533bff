//! One node's thread: connect, ask who it is, pass on every frame, send commands, and begin anew when the link ends.
//!
//! Frames that come before the answer wait for it: they belong to the chip that answers. A measuring node sends a
//! status every second, a stopped one nothing: after [`QUIET`] it is asked who it is, and one that says nothing for
//! [`SILENCE`] is gone.

use super::{News, Report, port};
use crate::clock;
use crate::health::Health;
use crate::journal::entry::decode;
use crate::stop::Stop;
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband::message::{Identification, Reply, Request};
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

/// Time between frames after which a node counts as gone.
const SILENCE: Duration = Duration::from_secs(10);
/// Time between frames after which a node is asked whether it is there.
const QUIET: Duration = Duration::from_secs(3);
/// How long each question who it is waits for the answer.
const ANSWER: Duration = Duration::from_secs(2);
/// Questions before the node counts as absent.
const QUESTIONS: u32 = 3;
/// Frames kept until the answer comes.
const WAITING: usize = 4096;

/// A node and everything its thread needs.
pub struct Link {
    /// Index in the configuration.
    pub index: usize,
    /// Name, for messages.
    pub name: String,
    /// `tcp:HOST:PORT` or a serial port.
    pub port: String,
    /// The chip that must answer.
    pub unit: Option<String>,
    /// Commands to send.
    pub commands: Receiver<Request>,
    /// To the journal.
    pub reports: Sender<Report>,
    /// Counters.
    pub health: Arc<Health>,
    /// Steady clock's zero.
    pub start: Instant,
    /// Request to stop.
    pub stop: Stop,
}

impl Link {
    /// Serves the node until the gateway stops.
    pub fn run(self) {
        let mut pause = Duration::from_millis(500);
        let mut said = String::new();
        while !self.stop.asked() {
            let mut session =
                Session { link: &self, piece: Vec::new(), waiting: Vec::new(), online: false, sequence: 0 };
            let reason = match port::open(&self.port) {
                Ok(port) => session.serve(port),
                Err(reason) => reason.to_string(),
            };
            if session.online {
                self.report(News::Offline(reason.clone()));
                pause = Duration::from_millis(500);
            }
            // The same reason every few seconds would fill the log.
            if reason != said && !self.stop.asked() {
                eprintln!("node {} on {}: {reason}", self.name, self.port);
            }
            said = reason;
            self.stop.sleep(pause);
            pause = (pause * 2).min(Duration::from_secs(5));
        }
    }

    fn report(&self, news: News) {
        let (wall_us, steady_us) = (clock::wall_us(), clock::steady_us(self.start));
        // The journal's thread outlives this one; where it died, the gateway is stopping.
        let _ = self.reports.send(Report { node: self.index, wall_us, steady_us, news });
    }
}

struct Session<'a> {
    link: &'a Link,
    piece: Vec<u8>,
    waiting: Vec<Vec<u8>>,
    online: bool,
    sequence: u16,
}

impl Session<'_> {
    /// Until the link ends; gives why.
    fn serve(&mut self, mut port: Box<dyn port::Port>) -> String {
        let mut buffer = [0; 4096];
        let (mut heard, mut asked, mut questions) = (Instant::now(), None::<Instant>, 0);
        loop {
            if self.link.stop.asked() {
                return "the gateway stops".into();
            }
            if let Err(reason) = self.ask(&mut port, heard, &mut asked, &mut questions) {
                return reason;
            }
            while self.online
                && let Ok(request) = self.link.commands.try_recv()
            {
                if let Err(reason) = self.send(&mut port, &request) {
                    return reason;
                }
            }
            match port.read(&mut buffer) {
                Ok(0) => return self.closed().into(),
                Ok(count) => {
                    heard = Instant::now();
                    if let Err(reason) = self.take(&buffer[..count]) {
                        return reason;
                    }
                }
                Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                Err(reason) => return self.ended(&reason),
            }
            if heard.elapsed() > SILENCE {
                return format!("silent for {} s", SILENCE.as_secs());
            }
        }
    }

    /// Asks who the node is: at first, and when it has been quiet.
    fn ask(
        &mut self,
        port: &mut Box<dyn port::Port>,
        heard: Instant,
        asked: &mut Option<Instant>,
        questions: &mut u32,
    ) -> Result<(), String> {
        let since = |patience: Duration| asked.is_none_or(|at| at.elapsed() > patience);
        let due = if self.online { heard.elapsed() > QUIET && since(QUIET) } else { since(ANSWER) };
        if !due {
            return Ok(());
        }
        if !self.online {
            if *questions == QUESTIONS {
                return Err("does not say who it is: no node, another bit rate, or its lines interchanged".into());
            }
            *questions += 1;
        }
        *asked = Some(Instant::now());
        self.send(port, &Request::Identify)
    }

    fn send(&mut self, port: &mut Box<dyn port::Port>, request: &Request) -> Result<(), String> {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(request, self.sequence, &mut buffer).map_err(|e| format!("command does not fit: {e:?}"))?;
        self.sequence = self.sequence.wrapping_add(1);
        port.write_all(frame).map_err(|reason| self.ended(&reason))
    }

    fn closed(&self) -> &'static str {
        match self.online {
            true => "closed the connection",
            false => "closed the connection before it said who it is; is another gateway on it?",
        }
    }

    fn ended(&self, reason: &std::io::Error) -> String {
        match reason.kind() {
            ErrorKind::ConnectionReset | ErrorKind::BrokenPipe => self.closed().to_owned(),
            _ => reason.to_string(),
        }
    }

    /// Cuts bytes into frames.
    fn take(&mut self, bytes: &[u8]) -> Result<(), String> {
        for &byte in bytes {
            if byte != 0 {
                // Longer than any frame: rubbish, which the decoder refuses.
                if self.piece.len() <= MAX_FRAME {
                    self.piece.push(byte);
                }
            } else if !self.piece.is_empty() {
                let piece = std::mem::take(&mut self.piece);
                self.frame(piece)?;
            }
        }
        Ok(())
    }

    fn frame(&mut self, piece: Vec<u8>) -> Result<(), String> {
        if self.online {
            self.link.report(News::Frame(piece));
            return Ok(());
        }
        let frame = decode(&piece);
        self.waiting.push(piece);
        if self.waiting.len() > WAITING {
            self.waiting.remove(0);
        }
        match frame.map(|frame| frame.packet) {
            Some(Packet::Reply(Reply::Identity(identity))) => self.identified(identity),
            _ => Ok(()),
        }
    }

    fn identified(&mut self, identity: Identification) -> Result<(), String> {
        let unit = super::state::unit_text(identity.unique_id);
        if let Some(wanted) = self.link.unit.as_ref().filter(|wanted| !wanted.eq_ignore_ascii_case(&unit)) {
            self.link.health.node(&self.link.name, |node| node.refused_units += 1);
            return Err(format!("chip {unit} answers, {wanted} is configured: not taken"));
        }
        self.online = true;
        self.link.report(News::Online(Box::new(identity)));
        for piece in std::mem::take(&mut self.waiting) {
            self.link.report(News::Frame(piece));
        }
        Ok(())
    }
}
