//! The board on the host: the node's own code on a replay image, block by block.
//!
//! [`run`] follows the board's rule for blocks and periods (see the firmware's pipeline): blocks follow each other
//! without a gap; the first two have the node's first wish as their period, and the wish after block `j` governs
//! block `j + 3`, which is the block after the next when block `j + 1` ends. This is what a board does whose main
//! loop takes each block before the next one ends.
//!
//! A later main loop changes which blocks there are: a wish is taken up a border later, or a block is lost. The board
//! therefore logs the blocks its node really got, and [`follow`] gives the node here the same ones. Frames are then the
//! same byte for byte however late the board was, as long as no tach edge was lost.

use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::identity::Identity;
use meshband::message::Request;
use meshband::node::Block;
use meshband::replay::{BLOCK_SAMPLES, CodeDigest, LONGEST_PERIOD, Replay, START_TICK};
use meshband::session::Session;
use meshband::units::TicksPerSecond;

/// A block as the node gets it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TakenBlock {
    /// Counts blocks; gaps are lost ones.
    pub sequence: u32,
    /// Instant of the first sample, ticks of the record.
    pub first_tick: u32,
    /// Sample period, ticks.
    pub period: u32,
    /// The board lost at least one block before it.
    pub overrun: bool,
}

impl TakenBlock {
    /// First instant behind the block, ticks of the record.
    fn end(&self) -> u32 {
        self.first_tick + self.period * (BLOCK_SAMPLES as u32 - 1)
    }
}

/// What a run on the host gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Every byte sent over the link.
    pub link: Vec<u8>,
    /// Checksum of all codes sampled.
    pub codes_crc: u32,
    /// The blocks.
    pub blocks: Vec<TakenBlock>,
    /// Edges delivered.
    pub edges: usize,
}

/// Runs the node on an image to its end, as a board does that is never late.
///
/// # Errors
/// [`Error::Invalid`] for an image or configuration that the firmware would refuse.
pub fn run(image: &[u8]) -> Result<Simulated> {
    let mut host = Host::new(image)?;
    let forced = host.replay.header().forced_period_ticks;
    let wanted =
        |host: &Host| forced.unwrap_or_else(|| host.session.node().requested_period_ticks()).clamp(1, LONGEST_PERIOD);
    let first = wanted(&host);
    // Of the running block, the next one, and the newest wish.
    let (mut running, mut next, mut wish) = (first, first, first);
    let (mut border, mut sequence) = (0u32, 0);
    loop {
        let end = border.saturating_add(running * BLOCK_SAMPLES as u32);
        if end >= host.replay.end_tick() {
            return Ok(host.finish());
        }
        // When a block ends, the wish in force is the one made after the block before it.
        let after = wish;
        host.take(TakenBlock { sequence, first_tick: border + running, period: running, overrun: false });
        wish = wanted(&host);
        sequence += 1;
        border = end;
        (running, next) = (next, after);
    }
}

/// Runs the node on an image with exactly these blocks.
///
/// # Errors
/// As [`run`].
pub fn follow(image: &[u8], blocks: &[TakenBlock]) -> Result<Simulated> {
    let mut host = Host::new(image)?;
    blocks.iter().for_each(|&block| host.take(block));
    Ok(host.finish())
}

struct Host<'a> {
    replay: Replay<'a>,
    session: Session,
    link: Vec<u8>,
    digest: CodeDigest,
    blocks: Vec<TakenBlock>,
    edges: usize,
}

impl<'a> Host<'a> {
    fn new(image: &'a [u8]) -> Result<Self> {
        let refuse = |what: String| Error::invalid("replay image", what);
        let replay = Replay::parse(image).map_err(|e| refuse(format!("{e:?}")))?;
        let config = match replay.configuration() {
            [] => Configuration::default(),
            bytes => postcard::from_bytes(bytes).map_err(|e| refuse(format!("configuration: {e}")))?,
        };
        let clock = TicksPerSecond(replay.header().ticks_per_second);
        let session = Session::new(config, clock, Identity::HOST).map_err(|e| refuse(format!("configuration: {e}")))?;
        let digest = CodeDigest::new();
        Ok(Self { replay, session, link: Vec::new(), digest, blocks: Vec::new(), edges: 0 })
    }

    /// Edges before the block's end, then the block.
    fn take(&mut self, block: TakenBlock) {
        let mut codes = [0; BLOCK_SAMPLES];
        self.replay.sample(block.first_tick, block.period, &mut codes);
        let end = block.end();
        while let Some(edge) = self.replay.edge(self.edges).filter(|&edge| edge < end + 1) {
            self.session.on_edge(START_TICK.wrapping_add(edge));
            self.edges += 1;
        }
        self.digest.update(&codes);
        self.blocks.push(block);
        let TakenBlock { sequence, first_tick, period: period_ticks, overrun } = block;
        let block = Block {
            codes: &codes,
            second: &[],
            first_tick: START_TICK.wrapping_add(first_tick),
            period_ticks,
            sequence,
            overrun,
        };
        self.session.on_block(block, &mut |frame| self.link.extend_from_slice(frame));
    }

    fn finish(mut self) -> Simulated {
        self.session.on_request(Request::Statistics, &mut |frame| self.link.extend_from_slice(frame));
        Simulated { link: self.link, codes_crc: self.digest.value(), blocks: self.blocks, edges: self.edges }
    }
}
