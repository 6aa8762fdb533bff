//! The node's own code on the blocks and edges seen: edges before a block's end first, then the block.

use super::{Node, SampledBlock, TICKS_PER_SECOND, packets};
use meshband::board::Timing;
use meshband::events::{Event, EventKind};
use meshband::identity::Identity;
use meshband::node::Block;
use meshband::session::Session;
use meshband::time::TickExtender;
use std::collections::VecDeque;

/// Blocks at the end of a run whose frames may still be on their way, s.
const TRANSIT_S: f64 = 0.25;

/// Board and host, frame by frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Complete frames of the board.
    pub frames: usize,
    /// The first of them that is not the host's.
    pub first_difference: Option<usize>,
    /// Frames of the host, of blocks that ended well before the end, which the board had not sent.
    pub missing: usize,
}

impl Comparison {
    /// Whether all frames are equal and none is missing.
    pub fn is_equal(&self) -> bool {
        self.frames > 0 && self.first_difference.is_none() && self.missing == 0
    }
}

struct Host {
    session: Box<Session>,
    edges: VecDeque<u32>,
    /// Events of the board to come.
    own: VecDeque<Event>,
    /// The node's clock.
    time: Option<TickExtender>,
    frames: Vec<Vec<u8>>,
}

/// Complete frames of a line, delimiters included; they have one in front and one behind.
fn frames(link: &[u8]) -> Vec<&[u8]> {
    let ends: Vec<usize> = (0..link.len()).filter(|&n| link[n] == 0).collect();
    ends.windows(2).filter(|pair| pair[1] - pair[0] > 1).map(|pair| &link[pair[0]..=pair[1]]).collect()
}

/// Runs the host and compares. Which block a request comes before is not seen at the devices, so there must be none.
pub fn compare(node: &Node, cause: u32) -> Comparison {
    assert!(node.requests.is_empty(), "a run with requests cannot be compared");
    let sent = frames(&node.link);
    let mut host = Host::new(node, cause);
    let spared = (TRANSIT_S * TICKS_PER_SECOND) as i32;
    let last = node.blocks.last().map_or(0, |block| block.first_tick);
    let mut due = 0;
    for (sequence, block) in (0..).zip(&node.blocks) {
        host.take(sequence, block);
        if last.wrapping_sub(block.first_tick) as i32 > spared {
            due = host.frames.len();
        }
    }
    let first_difference = (0..sent.len()).find(|&n| host.frames.get(n).map(Vec::as_slice) != Some(sent[n]));
    if let Some(n) = first_difference {
        println!("frame {n} of the board is not the host's: {:?}", packets(sent[n]));
    }
    Comparison { frames: sent.len(), first_difference, missing: due.saturating_sub(sent.len()) }
}

/// The host's node after the blocks of the board, its arrays and waveform included.
pub fn node_after(node: &Node) -> Box<Session> {
    assert!(node.requests.is_empty(), "a run with requests cannot be compared");
    let mut host = Host::new(node, 0);
    (0..).zip(&node.blocks).for_each(|(sequence, block)| host.take(sequence, block));
    host.session
}

impl Host {
    fn new(node: &Node, cause: u32) -> Self {
        let identity = Identity { board: "stm32f405", ..Identity::HOST };
        let session = Session::new(node.config.clone(), Timing::STM32F405, identity).expect("accepted");
        let mut session = Box::new(session);
        session.node_mut().note(EventKind::Started, cause);
        let own = node.events().into_iter().filter(|event| event.kind == EventKind::Board).collect();
        let edges = node.edges.iter().copied().collect();
        Self { session, edges, own, time: None, frames: Vec::new() }
    }

    /// An instant of the node's clock; the first one starts it.
    fn extend(&mut self, tick: u32) {
        let time = self.time.get_or_insert_with(|| {
            let mut time = TickExtender::new(0);
            time.begin(tick);
            time
        });
        time.extend(tick);
    }

    /// Notes the board's own events that are due by the node's clock.
    fn note_own(&mut self) {
        let now = self.time.map_or(TickExtender::new(0).latest(), |time| time.latest());
        while let Some(event) = self.own.pop_front_if(|event| event.first_tick <= now) {
            self.session.node_mut().note(event.kind, event.detail);
        }
    }

    fn take(&mut self, sequence: u32, block: &SampledBlock) {
        let end = block.last_tick().wrapping_add(1);
        self.note_own();
        while let Some(edge) = self.edges.pop_front_if(|edge| (edge.wrapping_sub(end) as i32) < 0) {
            self.session.on_edge(edge);
            self.extend(edge);
            self.note_own();
        }
        let SampledBlock { first_tick, period: period_ticks, ref codes, ref second } = *block;
        let block = Block { codes, second, first_tick, period_ticks, sequence, overrun: false };
        let frames = &mut self.frames;
        self.session.on_block(block, &mut |frame| frames.push(frame.to_vec()));
        self.extend(first_tick);
    }
}
