//! The released image in an emulated board, spoken to in the link's own language.
#![allow(dead_code, reason = "every test program uses some of it")]

use meshband::config::Configuration;
use meshband::events::{Event, EventKind};
use meshband::frame::{Decoder, MAX_FRAME, Packet, encode};
use meshband::message::{Message, Reply, Request};
use meshband_emulator::board::Board;
use meshband_emulator::cpu::Snapshot;
use meshband_emulator::elf::Image;

/// From power to a program that listens, s: the loader's checksum, oscillators, self-test of the mathematics, and
/// blank sectors, which are read to their end.
const START_S: f64 = 0.25;
/// Longest time to an answer, s of the board: an erasure lies in between at worst.
const PATIENCE_S: f64 = 3.0;
/// Step in which an answer is waited for, s.
const STEP_S: f64 = 0.001;

/// The board and what it has said.
pub struct Node {
    pub board: Board,
    decoder: Decoder,
    sequence: u16,
    /// Everything received and not taken.
    pub heard: Vec<Packet>,
    /// Frames that could not be read.
    pub unreadable: u32,
}

impl Node {
    /// With erased configuration sectors, switched on, at its first instruction.
    pub fn new(image: &Image) -> Self {
        let board = Board::new(image).expect("a board");
        Self { board, decoder: Decoder::new(), sequence: 0, heard: Vec::new(), unreadable: 0 }
    }

    /// Runs until the program listens.
    pub fn start(&mut self) {
        self.run(START_S);
    }

    /// Runs for so many seconds.
    pub fn run(&mut self, seconds: f64) {
        let until = self.board.seconds() + seconds;
        self.board
            .run_until(until)
            .unwrap_or_else(|error| panic!("the run ends at {} s: {error}", self.board.seconds()));
        self.listen();
    }

    fn listen(&mut self) {
        for byte in self.board.take_sent() {
            match self.decoder.push(byte) {
                Some(Ok(frame)) => self.heard.push(frame.packet),
                Some(Err(_)) => self.unreadable += 1,
                None => {}
            }
        }
    }

    /// Sends a request without waiting.
    pub fn send(&mut self, request: &Request) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(request, self.sequence, &mut buffer).expect("a frame");
        self.sequence = self.sequence.wrapping_add(1);
        self.board.send(frame);
    }

    /// Sends a request and waits for its reply.
    pub fn ask(&mut self, request: &Request) -> Reply {
        self.send(request);
        self.reply()
    }

    /// Waits for a reply.
    pub fn reply(&mut self) -> Reply {
        let found = self.wait_for(|packet| matches!(packet, Packet::Reply(_)));
        let Packet::Reply(reply) = found else { unreachable!("as wanted") };
        reply
    }

    /// Waits for a packet and takes it, the oldest first.
    pub fn wait_for(&mut self, wanted: impl Fn(&Packet) -> bool) -> Packet {
        let end = self.board.seconds() + PATIENCE_S;
        loop {
            if let Some(place) = self.heard.iter().position(&wanted) {
                return self.heard.remove(place);
            }
            assert!(self.board.seconds() < end, "no such packet within {PATIENCE_S} s");
            self.run(STEP_S);
        }
    }

    /// Waits for an event of a kind.
    pub fn wait_for_event(&mut self, kind: EventKind) -> Event {
        let found = self.wait_for(|packet| matches!(packet, Packet::Message(Message::Event(e)) if e.kind == kind));
        let Packet::Message(Message::Event(event)) = found else { unreachable!("as wanted") };
        event
    }

    /// The configuration in force.
    pub fn configuration(&mut self) -> Configuration {
        match self.ask(&Request::GetConfiguration) {
            Reply::Configuration(configuration) => configuration,
            other => panic!("{other:?}"),
        }
    }

    /// Puts a configuration in force without storing it.
    pub fn configure(&mut self, configuration: &Configuration) {
        assert_eq!(self.ask(&Request::SetConfiguration(configuration.clone())), Reply::Done);
    }

    /// Stores the configuration in force.
    pub fn commit(&mut self) {
        assert_eq!(self.ask(&Request::CommitConfiguration), Reply::Committing);
        self.wait_for_event(EventKind::ConfigurationStored);
    }

    /// Events heard and not taken.
    pub fn events(&self) -> impl Iterator<Item = Event> {
        self.heard.iter().filter_map(|packet| match packet {
            Packet::Message(Message::Event(event)) => Some(*event),
            _ => None,
        })
    }

    /// Numbers of the board's own events of a kind, as heard.
    pub fn board_events(&self, kind: u32) -> Vec<u32> {
        let own = self.events().filter(|event| event.kind == EventKind::Board && event.detail >> 24 == kind);
        own.map(|event| event.detail & 0x00ff_ffff).collect()
    }

    /// Switches off and on; what was half received is forgotten.
    pub fn cycle_power(&mut self) {
        self.board.cycle_power();
        self.forget();
    }

    /// Everything as it is now.
    pub fn snapshot(&self) -> (Snapshot, f64) {
        self.board.snapshot()
    }

    /// Back to how everything was; what was heard is forgotten.
    pub fn restore(&mut self, snapshot: &(Snapshot, f64)) {
        self.board.restore(snapshot).expect("restored");
        self.forget();
    }

    /// Forgets what was heard: what comes next is of another life.
    pub fn forget(&mut self) {
        self.listen();
        (self.decoder, self.heard, self.unreadable) = (Decoder::new(), Vec::new(), 0);
    }
}
