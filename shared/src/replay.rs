//! The replay image: an "analogue" signal, its tachometer edges and run options as one block of memory.
//!
//! The QEMU board has no ADC and no wire to a tachometer. Its signal therefore lies in memory, sampled far
//! above any rate the node can choose (1 MHz or more) and already through the fixed analogue anti-alias
//! filter; the board reads it at the instants of the timer that the firmware itself programs, so a wrong
//! rate aliases as it would on a wire. The host reads the same image with the same functions, hence with
//! the same bits.
//!
//! Everything is little-endian: a header of [`HEADER_BYTES`], the node's configuration (opaque here, padded
//! to a multiple of four), the edges (`u32` ticks from the record's start, ascending), the samples (`i16`).
//! The signal's sample period is a whole number of ticks, so interpolation needs integers only.
//!
//! Limits: 2^32 ticks (171 s at 25 MHz) and the 16 MiB of the board's PSRAM. Between samples the signal is
//! taken as linear, which costs at a frequency f and signal rate F at most `(pi f / F)^2 / 2` of a
//! component's amplitude: 0.5 % at f = F/31, 0.02 % at f = F/157.

use crc::{CRC_32_ISO_HDLC, Crc};

/// Size of the header; the configuration begins here.
pub const HEADER_BYTES: usize = 64;
/// Address of the image on the QEMU board: the PSRAM of AN386.
pub const IMAGE_ADDRESS: u32 = 0x2100_0000;
/// Size of that PSRAM, less the flash at its end.
pub const IMAGE_CAPACITY: usize = (16 << 20) - FLASH_CAPACITY;
/// Address of the imitated configuration flash, at the end of the PSRAM: two sectors of 128 KiB, as on an STM32F405.
/// QEMU can keep this memory in a file, so that it outlives the machine.
pub const FLASH_ADDRESS: u32 = IMAGE_ADDRESS + IMAGE_CAPACITY as u32;
/// Size of that flash.
pub const FLASH_CAPACITY: usize = 256 << 10;
/// The node's time stamp of the record's start: the counter wraps one second later at 25 MHz, so that every
/// replay crosses the wrap.
pub const START_TICK: u32 = u32::MAX - 25_000_000;
pub use crate::config::BLOCK_SAMPLES;
/// Longest sample period a board grants, ticks: a block's period still fits a 32-bit timer.
pub const LONGEST_PERIOD: u32 = 0xffff;
/// Largest configuration carried, bytes.
pub const MAX_CONFIGURATION: usize = 4096;
/// Most ticks between two samples of the signal: keeps the interpolation within 32 bits.
pub const MAX_TICKS_PER_SAMPLE: u32 = 4096;

const MAGIC: [u8; 4] = *b"MBRP";
const VERSION: u16 = 1;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// How the board takes samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SamplingMode {
    /// One interrupt per block, as DMA gives on a real board.
    #[default]
    PerBlock,
    /// One interrupt per sample: the proof that the first form is exact.
    PerSample,
}

/// A failure staged on purpose, so that tests can see it being noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drill {
    /// None: run the record.
    #[default]
    None,
    /// Panic after boot.
    Panic,
    /// Stop making progress after boot.
    Hang,
    /// Fault inside a fault handler: the core locks up.
    LockUp,
    /// Exhaust the stack.
    StackOverflow,
}

/// Run options and scales of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// Rate of the time base in which edges and sample period are given, Hz.
    pub ticks_per_second: u32,
    /// Sample period of the signal, ticks; 1..=[`MAX_TICKS_PER_SAMPLE`].
    pub ticks_per_sample: u32,
    /// Acceleration of code 32767, m/s^2; finite and positive.
    pub full_scale_m_s2: f32,
    /// Resolution of the imitated converter, bits, 8..=16; codes stay left-aligned to 16 bits.
    pub converter_bits: u8,
    /// How the board takes samples.
    pub sampling: SamplingMode,
    /// Sample period to use whatever the node requests, ticks; `None` follows the node.
    pub forced_period_ticks: Option<u32>,
    /// Staged failure.
    pub drill: Drill,
    /// The record begins when the host asks to start; until then the node only serves its link.
    pub waits_for_start: bool,
}

impl Header {
    /// A header with a 16-bit converter that samples by blocks and follows the node.
    pub fn new(ticks_per_second: u32, ticks_per_sample: u32, full_scale_m_s2: f32) -> Self {
        Self {
            ticks_per_second,
            ticks_per_sample,
            full_scale_m_s2,
            converter_bits: 16,
            sampling: SamplingMode::PerBlock,
            forced_period_ticks: None,
            drill: Drill::None,
            waits_for_start: false,
        }
    }
}

/// Why an image was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReplayError {
    /// Does not begin like an image.
    NotAnImage,
    /// Written by another version of this format.
    Version(u16),
    /// The header is damaged or holds a value outside its range.
    Header,
    /// The header promises more than there is, or more than the buffer holds.
    Length,
    /// The contents do not match their checksum.
    Checksum,
    /// Edges do not ascend.
    Edges,
}

/// A checked image.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    header: Header,
    configuration: &'a [u8],
    edges: &'a [[u8; 4]],
    samples: &'a [[u8; 2]],
}

impl<'a> Replay<'a> {
    /// Checks an image; bytes behind its end are ignored.
    ///
    /// # Errors
    /// Any of [`ReplayError`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, ReplayError> {
        let (head, body) = bytes.split_at_checked(HEADER_BYTES).ok_or(ReplayError::Length)?;
        if head[..4] != MAGIC {
            return Err(ReplayError::NotAnImage);
        }
        let version = u16::from_le_bytes([head[4], head[5]]);
        if version != VERSION {
            return Err(ReplayError::Version(version));
        }
        if CHECKSUM.checksum(&head[..HEADER_BYTES - 4]) != word(head, HEADER_BYTES - 4) {
            return Err(ReplayError::Header);
        }
        let lengths = Lengths {
            configuration: word(head, 40) as usize,
            edges: word(head, 44) as usize,
            samples: word(head, 48) as usize,
        };
        let body = body.get(..lengths.body().ok_or(ReplayError::Header)?).ok_or(ReplayError::Length)?;
        if CHECKSUM.checksum(body) != word(head, 52) {
            return Err(ReplayError::Checksum);
        }
        let header = read_header(head).ok_or(ReplayError::Header)?;
        let (configuration, rest) = body.split_at(lengths.configuration_padded());
        let (edges, samples) = rest.split_at(4 * lengths.edges);
        let replay = Self {
            header,
            configuration: &configuration[..lengths.configuration],
            edges: edges.as_chunks().0,
            samples: samples.as_chunks().0,
        };
        let ascending = replay.edges.is_sorted_by(|a, b| u32::from_le_bytes(*a) < u32::from_le_bytes(*b));
        if ascending { Ok(replay) } else { Err(ReplayError::Edges) }
    }

    /// Run options and scales.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The node's configuration, as the host wrote it.
    pub fn configuration(&self) -> &'a [u8] {
        self.configuration
    }

    /// Number of tachometer edges.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    /// Instant of an edge, ticks from the record's start.
    pub fn edge(&self, index: usize) -> Option<u32> {
        self.edges.get(index).map(|bytes| u32::from_le_bytes(*bytes))
    }

    /// First instant at which the signal has ended, ticks from the record's start.
    pub fn end_tick(&self) -> u32 {
        // Lengths were checked to stay below 2^32 ticks.
        (self.samples.len() as u32).saturating_sub(1).saturating_mul(self.header.ticks_per_sample)
    }

    /// What the converter gives at an instant: offset binary, left-aligned to 16 bits, `None` after the end.
    pub fn code_at(&self, tick: u32) -> Option<u16> {
        let period = self.header.ticks_per_sample;
        let (index, part) = ((tick / period) as usize, tick % period);
        let [left, right] = *self.samples.get(index..)?.first_chunk::<2>()?;
        let (left, right) = (offset_binary(left), offset_binary(right));
        let value = (left * (period - part) + right * part + period / 2) / period;
        Some(quantise(value, self.header.converter_bits))
    }

    /// Samples from `first_tick` on, `period_ticks` apart; tells whether the signal lasted.
    ///
    /// Behind the end the last code is held.
    pub fn sample(&self, first_tick: u32, period_ticks: u32, codes: &mut [u16]) -> bool {
        let mut tick = first_tick;
        let mut held = 0x8000;
        let mut complete = true;
        for code in codes {
            match self.code_at(tick) {
                Some(value) => held = value,
                None => complete = false,
            }
            *code = held;
            tick = tick.saturating_add(period_ticks);
        }
        complete
    }
}

/// Bytes an image of these lengths takes.
pub const fn image_bytes(configuration: usize, edges: usize, samples: usize) -> usize {
    HEADER_BYTES + configuration.next_multiple_of(4) + 4 * edges + 2 * samples
}

/// Writes an image and returns its length.
///
/// `edges`: ticks from the record's start, ascending. `samples`: codes of the signal.
///
/// # Errors
/// [`ReplayError::Length`] where `out` is shorter than [`image_bytes`] or the signal lasts 2^32 ticks or more,
/// [`ReplayError::Header`] for a value outside its range, [`ReplayError::Edges`] for edges out of order.
pub fn write(
    header: &Header,
    configuration: &[u8],
    edges: &[u32],
    samples: &[i16],
    out: &mut [u8],
) -> Result<usize, ReplayError> {
    let lengths = Lengths { configuration: configuration.len(), edges: edges.len(), samples: samples.len() };
    let length = image_bytes(configuration.len(), edges.len(), samples.len());
    let out = out.get_mut(..length).ok_or(ReplayError::Length)?;
    if configuration.len() > MAX_CONFIGURATION {
        return Err(ReplayError::Length);
    }
    if !edges.is_sorted_by(|a, b| a < b) {
        return Err(ReplayError::Edges);
    }
    let (head, body) = out.split_at_mut(HEADER_BYTES);
    let (configuration_out, rest) = body.split_at_mut(lengths.configuration_padded());
    let (edges_out, samples_out) = rest.split_at_mut(4 * edges.len());
    configuration_out.fill(0);
    configuration_out[..configuration.len()].copy_from_slice(configuration);
    for (bytes, edge) in edges_out.as_chunks_mut().0.iter_mut().zip(edges) {
        *bytes = edge.to_le_bytes();
    }
    for (bytes, sample) in samples_out.as_chunks_mut().0.iter_mut().zip(samples) {
        *bytes = sample.to_le_bytes();
    }
    let body_checksum = CHECKSUM.checksum(body);
    head.fill(0);
    head[..4].copy_from_slice(&MAGIC);
    head[4..6].copy_from_slice(&VERSION.to_le_bytes());
    write_header(header, head);
    for (at, value) in
        [(40, configuration.len() as u32), (44, edges.len() as u32), (48, samples.len() as u32), (52, body_checksum)]
    {
        put(head, at, value);
    }
    let checksum = CHECKSUM.checksum(&head[..HEADER_BYTES - 4]);
    put(head, HEADER_BYTES - 4, checksum);
    if read_header(head).is_none() || lengths.body().is_none() {
        return Err(ReplayError::Header);
    }
    if (samples.len() as u64) * u64::from(header.ticks_per_sample) > u64::from(u32::MAX) {
        return Err(ReplayError::Length);
    }
    Ok(length)
}

/// Checksum of a stream of codes: the digest by which board and host compare what was sampled.
pub struct CodeDigest(crc::Digest<'static, u32>);

impl CodeDigest {
    /// Of nothing yet.
    pub fn new() -> Self {
        static TABLE: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
        Self(TABLE.digest())
    }

    /// Appends codes.
    pub fn update(&mut self, codes: &[u16]) {
        for code in codes {
            self.0.update(&code.to_le_bytes());
        }
    }

    /// The checksum of all codes so far.
    pub fn value(&self) -> u32 {
        self.0.clone().finalize()
    }
}

impl Default for CodeDigest {
    fn default() -> Self {
        Self::new()
    }
}

struct Lengths {
    configuration: usize,
    edges: usize,
    samples: usize,
}

impl Lengths {
    fn configuration_padded(&self) -> usize {
        self.configuration.next_multiple_of(4)
    }

    /// Bytes behind the header; `None` for lengths no image can have.
    fn body(&self) -> Option<usize> {
        if self.configuration > MAX_CONFIGURATION || self.edges > IMAGE_CAPACITY || self.samples > IMAGE_CAPACITY {
            return None;
        }
        Some(image_bytes(self.configuration, self.edges, self.samples) - HEADER_BYTES)
    }
}

fn write_header(header: &Header, head: &mut [u8]) {
    put(head, 8, header.ticks_per_second);
    put(head, 12, header.ticks_per_sample);
    put(head, 16, header.full_scale_m_s2.to_bits());
    put(head, 20, u32::from(header.converter_bits));
    put(head, 24, u32::from(header.sampling == SamplingMode::PerSample));
    put(head, 28, header.forced_period_ticks.unwrap_or(0));
    let drill = match header.drill {
        Drill::None => 0,
        Drill::Panic => 1,
        Drill::Hang => 2,
        Drill::LockUp => 3,
        Drill::StackOverflow => 4,
    };
    put(head, 32, drill);
    put(head, 36, u32::from(header.waits_for_start));
}

fn read_header(head: &[u8]) -> Option<Header> {
    let header = Header {
        ticks_per_second: word(head, 8),
        ticks_per_sample: word(head, 12),
        full_scale_m_s2: f32::from_bits(word(head, 16)),
        converter_bits: u8::try_from(word(head, 20)).ok()?,
        sampling: match word(head, 24) {
            0 => SamplingMode::PerBlock,
            1 => SamplingMode::PerSample,
            _ => return None,
        },
        forced_period_ticks: Some(word(head, 28)).filter(|&period| period != 0),
        drill: match word(head, 32) {
            0 => Drill::None,
            1 => Drill::Panic,
            2 => Drill::Hang,
            3 => Drill::LockUp,
            4 => Drill::StackOverflow,
            _ => return None,
        },
        waits_for_start: match word(head, 36) {
            0 => false,
            1 => true,
            _ => return None,
        },
    };
    let sound = header.ticks_per_second > 0
        && (1..=MAX_TICKS_PER_SAMPLE).contains(&header.ticks_per_sample)
        && header.full_scale_m_s2.is_finite()
        && header.full_scale_m_s2 > 0.0
        && (8..=16).contains(&header.converter_bits);
    sound.then_some(header)
}

fn offset_binary(sample: [u8; 2]) -> u32 {
    u32::from(u16::from_le_bytes(sample) ^ 0x8000)
}

/// Rounds a 16-bit value to the converter's resolution, saturating at its last code.
fn quantise(value: u32, bits: u8) -> u16 {
    let dropped = 16 - u32::from(bits);
    let rounded = (value + ((1 << dropped) >> 1)) >> dropped;
    (rounded.min((1 << bits) - 1) << dropped) as u16
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(|b| b.first_chunk()).map_or(0, |b| u32::from_le_bytes(*b))
}

fn put(bytes: &mut [u8], at: usize, value: u32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}
