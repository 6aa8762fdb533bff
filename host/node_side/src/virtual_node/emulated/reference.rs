//! The node's own code on the host, on the codes and edges that an emulated board's devices made.
//!
//! Edges before a block's end go first, then the block: what the board's main loop promises, whatever its interrupts'
//! latency. Events of the board itself (a new depth of its stack) are its own; they are taken over from its frames at
//! the instant they carry.

use super::run::{Heard, SampledBlock, TICKS_PER_SECOND};
use crate::{Error, Result};
use meshband::board::Timing;
use meshband::config::Configuration;
use meshband::events::{Event, EventKind};
use meshband::frame::{Decoder, Packet};
use meshband::identity::Identity;
use meshband::message::Message;
use meshband::node::Block;
use meshband::session::Session;
use meshband::time::TickExtender;
use std::collections::VecDeque;

/// Frames end with this byte.
const DELIMITER: u8 = 0;

/// Board and host, frame by frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Complete frames of the board.
    pub frames: usize,
    /// The first of them that is not the host's.
    pub first_difference: Option<usize>,
    /// Frames of the host that the board had not sent when the run ended, of blocks that ended well before.
    pub missing: usize,
}

impl Comparison {
    /// Whether all frames are equal and none is missing.
    pub fn is_equal(&self) -> bool {
        self.frames > 0 && self.first_difference.is_none() && self.missing == 0
    }
}

/// Blocks at the end of a run whose frames may still be on their way: what the line takes for the longest run of
/// messages.
const TRANSIT_S: f64 = 0.25;

/// Runs the host on what was heard and compares the frames.
///
/// # Errors
/// [`Error::Invalid`] for a configuration that the node refuses.
pub fn compare(heard: &Heard, config: &Configuration) -> Result<Comparison> {
    let sent: Vec<&[u8]> = frames(&heard.link);
    let (expected, due) = run(heard, config)?;
    let expected: Vec<&[u8]> = frames(&expected);
    let first_difference = sent.iter().enumerate().find(|(n, frame)| expected.get(*n) != Some(frame)).map(|(n, _)| n);
    Ok(Comparison { frames: sent.len(), first_difference, missing: due.saturating_sub(sent.len()) })
}

/// Complete frames of a line.
pub fn frames(link: &[u8]) -> Vec<&[u8]> {
    let mut frames: Vec<&[u8]> = link.split_inclusive(|byte| *byte == DELIMITER).collect();
    if frames.last().is_some_and(|frame| frame.last() != Some(&DELIMITER)) {
        frames.pop();
    }
    frames
}

/// Everything the host sends, and how many of its frames the board must have sent by now.
///
/// # Errors
/// As [`compare`].
pub fn run(heard: &Heard, config: &Configuration) -> Result<(Vec<u8>, usize)> {
    let mut host = Host::new(heard, config)?;
    let spared_ticks = (TRANSIT_S * f64::from(TICKS_PER_SECOND)) as i32;
    let last = heard.blocks.last().map_or(0, |block| block.first_tick);
    let mut due = 0;
    for (sequence, block) in (0..).zip(&heard.blocks) {
        host.take(sequence, block);
        if (last.wrapping_sub(block.first_tick) as i32) > spared_ticks {
            due = frames(&host.link).len().max(due);
        }
    }
    Ok((host.link, due))
}

struct Host<'a> {
    session: Session,
    edges: std::iter::Peekable<std::slice::Iter<'a, u32>>,
    /// Events of the board to come.
    own: VecDeque<Event>,
    /// The node's clock.
    time: TickExtender,
    link: Vec<u8>,
}

impl<'a> Host<'a> {
    fn new(heard: &'a Heard, config: &Configuration) -> Result<Self> {
        let refuse = |e| Error::invalid("the node's configuration", format!("{e}"));
        let mut session = Session::new(config.clone(), Timing::STM32F405, Identity::HOST).map_err(refuse)?;
        // Power came.
        session.node_mut().note(EventKind::Started, 0);
        let own = board_events(&heard.link);
        let edges = heard.edges.iter().peekable();
        Ok(Self { session, edges, own, time: TickExtender::new(0), link: Vec::new() })
    }

    /// Notes the board's own events that are due by the node's clock.
    fn note_own(&mut self) {
        while let Some(event) = self.own.pop_front_if(|event| event.first_tick <= self.time.latest()) {
            self.session.node_mut().note(event.kind, event.detail);
        }
    }

    fn take(&mut self, sequence: u32, block: &SampledBlock) {
        let samples = block.codes.len() as u32;
        let end = block.first_tick.wrapping_add(block.period * (samples - 1)).wrapping_add(1);
        self.note_own();
        while let Some(&edge) = self.edges.next_if(|edge| (edge.wrapping_sub(end) as i32) < 0) {
            self.session.on_edge(edge);
            self.time.extend(edge);
            self.note_own();
        }
        let SampledBlock { first_tick, period: period_ticks, ref codes, ref second } = *block;
        let block = Block { codes, second, first_tick, period_ticks, sequence, overrun: false };
        self.session.on_block(block, &mut |frame| self.link.extend_from_slice(frame));
        self.time.extend(first_tick.wrapping_add(period_ticks * samples));
    }
}

/// Events of the board's own code among its frames.
fn board_events(link: &[u8]) -> VecDeque<Event> {
    let mut decoder = Decoder::new();
    let packets = link.iter().filter_map(|&byte| Some(decoder.push(byte)?.ok()?.packet));
    packets
        .filter_map(|packet| match packet {
            Packet::Message(Message::Event(event)) if event.kind == EventKind::Board => Some(event),
            _ => None,
        })
        .collect()
}
