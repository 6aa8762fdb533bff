//! Requests among the bytes of a shared line: runs of bytes between silences, told by the node's clock.
//!
//! A frame ends with 3.5 characters of silence (above 19 200 bit/s: 1.75 ms). Bytes come by DMA and are looked at
//! once per turn of the main loop, so what is measured is the time in which no character was completed: one character
//! is added for one under way. That time is never too short. It may be too long: what the master and another node
//! said while the loop was busy then looks like one run. The request for this node is its end, because the master now
//! waits for the answer: where a run as a whole has no valid checksum, its last eight bytes are tried. (They pass by
//! chance once in 2^16 runs that end in this node's address and a function, and then the answer is one that nobody
//! waits for.)
//!
//! What was received while the loop stood still for longer than 0.1 s (an erasure of the flash) is not answered: the
//! master has given up meanwhile, and an answer would meet its next request. An interface that hears itself gives
//! back the node's own answer: it is recognised by length and checksum and taken off. Damage is silent and counted.

use super::{CRC16, MAX_FRAME};
use crate::config::LineFormat;
use crate::units::TicksPerSecond;
use heapless::Vec;

/// A request of the functions for single registers and ranges.
const REQUEST: usize = 8;
/// Address, function, checksum.
const MIN_FRAME_BYTES: usize = 4;
/// Half characters of silence that end a frame, and the one that may be under way.
const SILENT_HALVES: u64 = 7 + 2;
/// Rate above which the silence no longer follows the characters, and that silence, microseconds.
const MAX_SCALED_BITS_PER_SECOND: u32 = 19_200;
const FIXED_US: u64 = 1_750;
/// Longest time between two looks after which what came between them may still be answered, ms.
const STALE_MS: u64 = 100;

/// Function codes of reads, whose requests are eight bytes long. A write is not looked for at the end of a longer run:
/// by chance nothing is changed.
const EIGHT_BYTES_LONG: core::ops::RangeInclusive<u8> = 1..=4;

/// A request for this node, with its checksum right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Function code.
    pub function: u8,
    /// The first two words behind it.
    pub words: [u16; 2],
    /// The byte behind those, and the word behind that: length and first value of what function 16 writes.
    pub written: (u8, u16),
    /// Bytes behind the function code, without the checksum.
    pub length: usize,
}

impl Request {
    /// Of a function code and what follows it, without the checksum.
    pub fn of(function: u8, rest: &[u8]) -> Self {
        let word =
            |at: usize| rest.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |word| u16::from_be_bytes(*word));
        let written = (rest.get(4).copied().unwrap_or(0), word(5));
        Self { function, words: [word(0), word(2)], written, length: rest.len() }
    }
}

/// What a run is.
enum Found {
    /// A request for this node; `at_end`: behind something else.
    Request { request: Request, at_end: bool },
    /// For all.
    Broadcast,
    /// For or from another node.
    Other,
    /// No frame.
    Damaged,
}

/// What was heard and not answered, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heard {
    /// Requests for this node.
    pub requests: u16,
    /// Of these: found at the end of a longer run.
    pub merged: u16,
    /// Runs without a valid checksum.
    pub damaged: u16,
    /// Frames for or from others.
    pub others: u16,
    /// Frames for all.
    pub broadcasts: u16,
    /// Runs that were found too late.
    pub late: u16,
}

/// The receiver.
#[derive(Clone, Debug)]
pub struct Line {
    silence: u32,
    stale: u32,
    run: Vec<u8, MAX_FRAME>,
    /// Earlier bytes of the run have made room for later ones.
    long: bool,
    /// Bytes have come since the last look.
    fresh: bool,
    /// When the last look was, and the last one that found bytes.
    looked: Option<u32>,
    heard_at: u32,
    /// Length and checksum of the latest answer, until the next run.
    echo: Option<(usize, [u8; 2])>,
    heard: Heard,
}

impl Line {
    /// A silent line.
    pub fn new(format: LineFormat, clock: TicksPerSecond) -> Self {
        let (clock, rate) = (u64::from(clock.0), u64::from(format.bits_per_second.max(1)));
        let halves = |count: u64| clock * u64::from(format.parity.bits()) * count / (2 * rate);
        let silence = if format.bits_per_second > MAX_SCALED_BITS_PER_SECOND {
            clock * FIXED_US / 1_000_000 + halves(2)
        } else {
            halves(SILENT_HALVES)
        };
        Self {
            silence: silence.min(u64::from(u32::MAX / 4)) as u32,
            stale: (clock * STALE_MS / 1000).min(u64::from(u32::MAX / 4)) as u32,
            run: Vec::new(),
            long: false,
            fresh: false,
            looked: None,
            heard_at: 0,
            echo: None,
            heard: Heard::default(),
        }
    }

    /// A byte that was received since the last look.
    pub fn push(&mut self, byte: u8) {
        self.fresh = true;
        if self.run.is_full() {
            self.long = true;
            let kept = self.run.last_chunk::<REQUEST>().copied().unwrap_or_default();
            self.run.clear();
            let _ = self.run.extend_from_slice(&kept);
        }
        let _ = self.run.push(byte);
    }

    /// A look at the line at a tick, after the bytes that were there: a request for this address that has ended by now.
    pub fn look(&mut self, address: u8, now: u32) -> Option<Request> {
        let since = now.wrapping_sub(self.looked.replace(now).unwrap_or(now));
        if core::mem::take(&mut self.fresh) {
            self.heard_at = now;
            if since > self.stale {
                self.heard.late = self.heard.late.wrapping_add(1);
                self.clear();
            }
            return None;
        }
        if self.run.is_empty() || now.wrapping_sub(self.heard_at) < self.silence {
            return None;
        }
        let request = self.judge(address);
        self.clear();
        request
    }

    /// This answer goes out now.
    pub fn answered(&mut self, frame: &[u8]) {
        self.echo = frame.last_chunk().map(|checksum| (frame.len(), *checksum));
    }

    /// What was heard so far.
    pub fn heard(&self) -> Heard {
        self.heard
    }

    fn clear(&mut self) {
        self.run.clear();
        (self.long, self.echo) = (false, None);
    }

    fn judge(&mut self, address: u8) -> Option<Request> {
        let found = self.find(address)?;
        let Heard { requests, merged, damaged, others, broadcasts, .. } = &mut self.heard;
        let count = |counter: &mut u16| *counter = counter.wrapping_add(1);
        match found {
            Found::Request { request, at_end } => {
                count(requests);
                if at_end {
                    count(merged);
                }
                return Some(request);
            }
            Found::Broadcast => count(broadcasts),
            Found::Other => count(others),
            Found::Damaged => count(damaged),
        }
        None
    }

    fn find(&self, address: u8) -> Option<Found> {
        let run = self.without_echo(address);
        if run.is_empty() {
            return None;
        }
        let to_here =
            |end: &[u8]| matches!(end, [to, function, ..] if *to == address && EIGHT_BYTES_LONG.contains(function));
        let whole = (!self.long && is_intact(run)).then_some(run);
        let end =
            || run.last_chunk::<REQUEST>().map(<[u8; REQUEST]>::as_slice).filter(|end| to_here(end) && is_intact(end));
        Some(match whole.or_else(end) {
            None => Found::Damaged,
            Some([0, ..]) => Found::Broadcast,
            Some([to, function, rest @ .., _, _]) if *to == address => {
                Found::Request { request: Request::of(*function, rest), at_end: whole.is_none() }
            }
            Some(_) => Found::Other,
        })
    }

    /// The run without the node's own answer in front.
    fn without_echo(&self, address: u8) -> &[u8] {
        let own = |(length, checksum): (usize, [u8; 2])| {
            let (front, rest) = self.run.split_at_checked(length).filter(|_| !self.long)?;
            (front.first() == Some(&address) && front.ends_with(&checksum)).then_some(rest)
        };
        self.echo.and_then(own).unwrap_or(&self.run)
    }
}

/// Whether the last two bytes are the checksum of those before.
fn is_intact(frame: &[u8]) -> bool {
    let Some((content, checksum)) = frame.split_last_chunk::<2>() else { return false };
    frame.len() >= MIN_FRAME_BYTES && CRC16.checksum(content).to_le_bytes() == *checksum
}
