//! The board on the host: the node's own code on a replay image, with the board's rule for blocks and periods.
//!
//! The rule (see the firmware's pipeline): blocks follow each other without a gap; the first two have the
//! node's first wish as their period, and the wish after block `j` governs block `j + 3`, which is the block
//! after the next when block `j + 1` ends. As long as the firmware's main loop keeps up (no block lost, none
//! late), it sends exactly the frames that come out here.

use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::message::Request;
use meshband::node::Block;
use meshband::replay::{BLOCK_SAMPLES, CodeDigest, LONGEST_PERIOD, Replay, START_TICK};
use meshband::self_test::BootTest;
use meshband::session::Session;
use meshband::units::TicksPerSecond;

/// What a run on the host gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Every byte sent over the link.
    pub link: Vec<u8>,
    /// Checksum of all codes sampled.
    pub codes_crc: u32,
    /// Sample period of each block, ticks.
    pub periods: Vec<u32>,
    /// Edges delivered.
    pub edges: usize,
}

/// Runs the node on an image to its end.
///
/// # Errors
/// [`Error::Invalid`] for an image or configuration that the firmware would refuse.
pub fn run(image: &[u8]) -> Result<Simulated> {
    let refuse = |what: String| Error::invalid("replay image", what);
    let replay = Replay::parse(image).map_err(|e| refuse(format!("{e:?}")))?;
    let config = match replay.configuration() {
        [] => Configuration::default(),
        bytes => postcard::from_bytes(bytes).map_err(|e| refuse(format!("configuration: {e}")))?,
    };
    let clock = TicksPerSecond(replay.header().ticks_per_second);
    let mut session = Session::new(config, clock).map_err(|e| refuse(format!("configuration: {e}")))?;
    let mut test = BootTest::new(clock);
    session.node_mut().set_self_test(test.result());
    let forced = replay.header().forced_period_ticks;
    let wanted =
        |session: &Session| forced.unwrap_or_else(|| session.node().requested_period_ticks()).clamp(1, LONGEST_PERIOD);
    let mut link = Vec::new();
    let mut send = |frame: &[u8]| link.extend_from_slice(frame);
    let mut codes = [0; BLOCK_SAMPLES];
    let (mut digest, mut periods, mut border, mut edges) = (CodeDigest::new(), Vec::new(), 0u32, 0);
    let first = wanted(&session);
    // Of the running block, the next one, and the newest wish.
    let (mut running, mut next, mut wish) = (first, first, first);
    loop {
        let end = border.saturating_add(running * BLOCK_SAMPLES as u32);
        if end >= replay.end_tick() {
            break;
        }
        replay.sample(border + running, running, &mut codes);
        // When a block ends, the wish in force is the one made after the block before it.
        let after = wish;
        while let Some(edge) = replay.edge(edges).filter(|&edge| edge < end + 1) {
            test.on_edge();
            session.on_edge(START_TICK.wrapping_add(edge));
            edges += 1;
        }
        digest.update(&codes);
        let first_tick = START_TICK.wrapping_add(border + running);
        let sequence = periods.len() as u32;
        let block = Block { codes: &codes, first_tick, period_ticks: running, sequence, overrun: false };
        if let Some(result) = test.on_block(&block, START_TICK.wrapping_add(end)) {
            session.node_mut().set_self_test(result);
        }
        session.on_block(block, &mut send);
        wish = wanted(&session);
        periods.push(running);
        border = end;
        (running, next) = (next, after);
    }
    session.on_request(Request::Statistics, &mut send);
    Ok(Simulated { link, codes_crc: digest.value(), periods, edges })
}
