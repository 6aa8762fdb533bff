//! A held waveform on the link: what is told of it, and its bytes in parts that may be asked for again.
//!
//! The host pulls. Every part is an answer to a command that names the waveform and the byte, so a lost part is asked
//! for again without any state on the node, and a slow reader costs the node nothing but its memory. The checksum
//! covers all bytes, and the facts come with it in one frame that has its own: what a host accepts is what the node
//! sealed.
//!
//! Bytes: the marks (4 bytes each, little-endian, ticks from the first sample to each turn of the pinion), then the
//! samples in blocks of [`crate::sample_ring::BLOCK`] with their exponent ([`crate::sample_ring`]), oldest first.

use crate::tach::Validity;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most bytes of one part.
pub const PART_BYTES: usize = 512;

/// What began a waveform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trigger {
    /// A host asked for it.
    #[default]
    Request,
    /// An alarm was raised.
    Alarm {
        /// Its index in the configuration.
        index: u8,
    },
}

/// What a node does about waveforms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CapturePhase {
    /// Nothing: not configured. Left by a configuration.
    #[default]
    Off,
    /// Keeps the latest samples. Left by a trigger.
    Watching,
    /// Takes what follows the trigger. Left when the memory is full, or by an end of the sample grid.
    Collecting,
    /// Computes the checksum, a part with each block. Left when it is complete.
    Sealing,
    /// Holds a waveform. Left when a host releases it.
    Held,
}

/// Why a waveform ends where it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CaptureEnd {
    /// The memory is full.
    #[default]
    Full,
    /// The sampling rate changed.
    RateChanged,
    /// Blocks were lost, overrun, or jumped in time.
    SamplesLost,
    /// Another gain, another configuration, or a stop.
    Commanded,
}

/// What is known of a waveform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CaptureFacts {
    /// Counts the node's waveforms since its start, from 1.
    pub number: u32,
    /// What began it.
    pub trigger: Trigger,
    /// Instant at which it began, ticks since start.
    pub trigger_tick: u64,
    /// Tick of the first sample (group delay removed), since start.
    pub first_tick: u64,
    /// Ticks from sample to sample.
    pub period_ticks: u32,
    /// Time base, Hz.
    pub ticks_per_second: u32,
    /// Samples.
    pub samples: u32,
    /// Turns of the pinion that began within it, one mark each.
    pub marks: u16,
    /// No mark is missing within it.
    pub marks_whole: bool,
    /// m/s^2 per unit of the samples.
    pub scale: f32,
    /// Pinion rate at its end, Hz.
    pub speed_hz: f32,
    /// Quality of that speed.
    pub validity: Validity,
    /// Why it ends.
    pub end: CaptureEnd,
    /// Codes at the converter's rails, latest in the span or in the filters before it: clipped.
    pub overload: bool,
    /// Teeth of pinion and gear as configured.
    pub teeth: [u16; 2],
    /// CRC-32 of the configuration in force, as the node stores it.
    pub configuration: u32,
}

impl CaptureFacts {
    /// Of no waveform.
    pub const NONE: Self = Self {
        number: 0,
        trigger: Trigger::Request,
        trigger_tick: 0,
        first_tick: 0,
        period_ticks: 0,
        ticks_per_second: 0,
        samples: 0,
        marks: 0,
        marks_whole: false,
        scale: 0.0,
        speed_hz: 0.0,
        validity: Validity::None,
        end: CaptureEnd::Full,
        overload: false,
        teeth: [0; 2],
        configuration: 0,
    };
}

/// A waveform's facts and what proves it whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CaptureHead {
    /// What is known of it.
    pub facts: CaptureFacts,
    /// Bytes to read.
    pub bytes: u32,
    /// CRC-32 of all bytes.
    pub checksum: u32,
}

/// What the node does about waveforms, and the one it holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CaptureReport {
    /// What it does.
    pub phase: CapturePhase,
    /// Triggers that found another waveform begun or held, since start.
    pub missed: u32,
    /// The one held.
    pub head: Option<CaptureHead>,
}

/// Part of a waveform's bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CapturePart {
    /// [`CaptureFacts::number`].
    pub number: u32,
    /// Place of the first byte.
    pub offset: u32,
    /// The bytes; none where that waveform is not held, or behind its end.
    pub bytes: Vec<u8, PART_BYTES>,
}
