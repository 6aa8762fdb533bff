//! The node's mesh bands: which rate, which record, and the table of lines that is sent.
//!
//! Computation is [`crate::order_chain`]'s, in the order domain: a record of [`record_turns`] turns (16 for all but
//! very small pinions) resolves f_shaft/16 at every speed, whatever the speed does meanwhile. Frequencies are orders
//! times the record's mean speed.
//!
//! Rate: the upper band, a third of a pitch above the highest harmonic, must stay below [`BAND_SHARE`] of the rate
//! until a fifth more speed makes the node plan anew. The decimator comes within a few per cent of that, so the grid of
//! the order domain can be as coarse as the bands allow ([`MeshPlan::samples_per_pitch`]). Where two and a half turns
//! at that rate do not fit into the buffer (above 69 teeth with five harmonics at worst), or where orders would fold
//! into the synchronous average, the rate is lower and the harmonics that still have four samples per period are
//! reported.

use crate::config::{Configuration, MAX_HARMONICS, TrainGear};
use crate::frame::CRC32;
use crate::math;
use crate::mesh_decimator::{BAND_SHARE, Decimation};
use crate::message::{MeshBand, SpectralLine};
use crate::node::REPLAN_NOW;
use crate::node::values::SHORTEST_S;
use crate::order_chain::OrderChain;
use crate::units::{Hertz, TicksPerSecond};
use crate::window::Window;
use crate::zoom::{self, Averaging, MeshZoom, SAMPLES_PER_PITCH, ZoomConfig};
use heapless::Vec;

/// Samples held for order tracking.
pub const CAPACITY: usize = 8192;
/// Complex values per harmonic and record.
pub const POINTS: usize = 256;
/// Longest synchronous average, samples per turn.
pub const AVERAGE: usize = 2048;

/// The node's order chain.
pub type Chain = OrderChain<CAPACITY, POINTS, MAX_HARMONICS, AVERAGE>;
/// Its mesh-band analyser.
pub type Zoom = MeshZoom<POINTS, MAX_HARMONICS>;

/// Reach of a band above its harmonic, pitches.
pub const REACH: f32 = 1.0 / 3.0;
/// Samples per period below which a harmonic is left out.
const MIN_SAMPLES_PER_PERIOD: f32 = 4.0;
/// Turns the buffer must hold: two, the block that arrives, and a speed that falls meanwhile.
const TURNS_HELD: f32 = 2.5;
/// Most turns of a synchronous average over the hunting period; longer periods are cut to [`BROKEN_TURNS`].
const LONGEST_HUNTING: u16 = 64;
/// Turns of an average whose hunting period is too long.
const BROKEN_TURNS: u32 = 32;
/// Fewest turns of an average.
const FEWEST_TURNS: u32 = 16;
/// Most teeth whose average of 1024 samples has no folded lines among its mesh harmonics.
const TEETH_FOR_SHORT_AVERAGE: u16 = 23;

/// The gear whose turns the order domain follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Followed {
    /// Its teeth.
    pub teeth: u16,
    /// Teeth of its mate.
    pub mate_teeth: u16,
    /// Its turns per turn of the pinion.
    pub per_pinion_turn: f32,
}

impl Followed {
    /// By its number: 0 the pinion, 1 the first of the train's further gears.
    pub fn of(config: &Configuration, gear: u8) -> Self {
        let further = usize::from(gear).checked_sub(1).and_then(|place| config.train.get(place));
        let of_train = |gear: &TrainGear| Self {
            teeth: gear.teeth,
            mate_teeth: gear.mate_teeth,
            per_pinion_turn: gear.per_pinion_turn(),
        };
        let gears = config.gears;
        let pinion = Self { teeth: gears.pinion_teeth, mate_teeth: gears.gear_teeth, per_pinion_turn: 1.0 };
        further.map_or(pinion, of_train)
    }

    /// Its rate at a rate of the pinion.
    pub fn rate(&self, pinion: Hertz) -> Hertz {
        Hertz(self.per_pinion_turn * pinion.0)
    }

    /// Turns of its mate per turn of it.
    pub fn mate_order(&self) -> f32 {
        f32::from(self.teeth) / f32::from(self.mate_teeth)
    }
}

/// Decimation from the ADC to the mesh bands, and what it carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshPlan {
    /// Decimation after the ADC.
    pub decimation: Decimation,
    /// Harmonics with enough samples per period.
    pub harmonics: u8,
    /// Grid of the order domain: fine enough that nothing of the stream folds into a band, until replanned.
    pub samples_per_pitch: u8,
}

impl MeshPlan {
    /// Nothing is carried: there is no speed.
    pub const NONE: Self =
        Self { decimation: Decimation::MAXIMUM, harmonics: 0, samples_per_pitch: SAMPLES_PER_PITCH as u8 };

    /// The plan for a gear at a rate of its own and an ADC rate; without a speed nothing is carried.
    pub fn new(followed: &Followed, harmonics: u8, gear: Hertz, adc: Hertz) -> Self {
        let mesh_hz = f32::from(followed.teeth) * gear.0;
        if !(mesh_hz > 0.0 && adc.0 > 0.0) {
            return Self::NONE;
        }
        let wanted = f32::from(harmonics);
        let lowest = (1.0 + REPLAN_NOW) * (wanted + REACH) / BAND_SHARE * mesh_hz;
        let mut ratio = adc.0 / lowest;
        let mut decimation = Decimation::up_to(ratio);
        let rate = |decimation: Decimation| adc.0 / decimation.ratio() as f32;
        // What the stream carries must fit half the average's points per turn, down to the speed that plans anew; no
        // harmonic is given up for it where all bands fit into the points, and never the last one.
        let held = CAPACITY as f32 / TURNS_HELD * gear.0;
        let points = average_points(followed.teeth) as f32 * (1.0 - REPLAN_NOW) * gear.0;
        loop {
            let now = rate(decimation);
            ratio = 1.1 * ratio.max(1.0);
            let coarser = Decimation::up_to(ratio);
            let last = if lowest > points { MIN_SAMPLES_PER_PERIOD * mesh_hz } else { lowest };
            let folds = now > points && rate(coarser) >= last;
            if !(now > held || folds) || decimation == Decimation::MAXIMUM {
                break;
            }
            decimation = coarser;
        }
        let per_pitch = rate(decimation) / mesh_hz;
        let harmonics = (per_pitch / MIN_SAMPLES_PER_PERIOD).min(wanted) as u8;
        // Half the rate is the highest order there is; a fifth less speed makes it a quarter more.
        let finest = 0.5 * per_pitch / (1.0 - REPLAN_NOW) + f32::from(harmonics) + REACH;
        let samples_per_pitch = ((0.5 * finest + 1.0) as u8).saturating_mul(2).clamp(16, SAMPLES_PER_PITCH as u8);
        Self { decimation, harmonics, samples_per_pitch }
    }
}

/// Turns of a mesh-band record: 16, or as many as small pinions need for a full record.
pub fn record_turns(teeth: u16) -> u16 {
    (POINTS as u16).div_ceil(teeth.max(1)).clamp(16, (POINTS / 9) as u16)
}

/// Turns of a synchronous average: whole hunting periods, at least 16 turns; true when the period had to be broken.
pub fn average_turns(pinion_teeth: u16, gear_teeth: u16) -> (u32, bool) {
    match zoom::common_turns(pinion_teeth, gear_teeth) {
        Some(period) if (1..=LONGEST_HUNTING).contains(&period) => {
            let period = u32::from(period);
            (FEWEST_TURNS.div_ceil(period) * period, false)
        }
        _ => (BROKEN_TURNS, true),
    }
}

/// Samples per turn of a synchronous average.
pub fn average_points(pinion_teeth: u16) -> usize {
    if pinion_teeth <= TEETH_FOR_SHORT_AVERAGE { AVERAGE / 2 } else { AVERAGE }
}

/// Prepares the chain for a gear. One that the chain refuses (validation lets none pass) leaves it idle.
pub fn configure(chain: &mut Chain, followed: &Followed, clock: TicksPerSecond) {
    let teeth = followed.teeth;
    let zoom = ZoomConfig {
        teeth,
        turns: record_turns(teeth),
        window: Window::Hann,
        averaging: Averaging::Linear { records: 1 },
    };
    let turns = average_turns(teeth, followed.mate_teeth).0;
    if chain.configure(zoom, average_points(teeth), turns).is_err() {
        *chain = Chain::IDLE;
    }
    chain.shafts().configure(teeth, followed.mate_teeth, SHORTEST_S * clock.0 as f32);
}

/// One amplitude for the sidebands of both shafts and all harmonics, m/s^2: the geometric mean over the harmonics of
/// what the sidebands of one have together (root of the sum of squares), so that no harmonic's resonance speaks for
/// all. Of two that are one to the record (`inseparable` of [`crate::message::Spectrum`]) the pinion's counts.
/// Harmonics without sidebands in their band are left out; 0 where none has any.
pub fn sideband_amplitude(bands: &[MeshBand], inseparable: [u8; 2]) -> f32 {
    let (mut logarithms, mut count) = (0.0, 0.0);
    for band in bands {
        let of_gear = band.gear_sidebands.iter().enumerate().filter(|(n, _)| inseparable[1] >> n & 1 == 0);
        let all = band.sidebands.iter().chain(of_gear.map(|(_, line)| line));
        let power: f32 = all.map(|line| line.amplitude * line.amplitude).sum();
        if power > 0.0 {
            logarithms += 0.5 * math::ln(power);
            count += 1.0;
        }
    }
    if count > 0.0 { math::exp(logarithms / count) } else { 0.0 }
}

/// Sidebands of pinion and gear that are one to the record, a bit for each in the order of their lists: a pair of teeth
/// near a ratio of small numbers puts an order of one shaft beside another order of the other.
pub fn inseparable(zoom: &Zoom, gear_order: f32, sidebands: u8) -> [u8; 2] {
    let pairs = i16::from(sidebands);
    let orders = || (-pairs..=pairs).filter(|&k| k != 0).enumerate();
    let mut bits = [0u8; 2];
    for (pinion, k) in orders() {
        for (gear, n) in orders() {
            if zoom.is_one(f32::from(k) - f32::from(n) * gear_order) {
                bits[0] |= 1 << pinion;
                bits[1] |= 1 << gear;
            }
        }
    }
    bits
}

/// Harmonics and sidebands of both shafts of the latest record, and the digest of its values. Sidebands outside the
/// band are zero.
pub fn bands(
    zoom: &Zoom,
    followed: &Followed,
    (harmonics, sidebands): (u8, u8),
    gear_hz: f32,
) -> (Vec<MeshBand, MAX_HARMONICS>, u32) {
    let (teeth, gear_order) = (f32::from(followed.teeth), followed.mate_order());
    let pairs = i16::from(sidebands);
    let mut digest = CRC32.digest();
    let mut found = Vec::new();
    for harmonic in 1..=harmonics.min(MAX_HARMONICS as u8) {
        let number = usize::from(harmonic);
        for power in zoom.powers(number).into_iter().flatten() {
            digest.update(&power.to_bits().to_le_bytes());
        }
        let line = |offset: f32| {
            let line = zoom.line(number, offset)?;
            let order = f32::from(harmonic) * teeth + line.bin * zoom.order_per_bin();
            Some(SpectralLine { frequency_hz: order * gear_hz, amplitude: line.amplitude })
        };
        let sidebands = |shaft: f32| {
            let orders = (-pairs..=pairs).filter(|&k| k != 0);
            orders.map(|k| line(f32::from(k) * shaft).unwrap_or_default()).collect()
        };
        let Some(centre) = line(0.0) else { break };
        let band =
            MeshBand { harmonic, line: centre, sidebands: sidebands(1.0), gear_sidebands: sidebands(gear_order) };
        if found.push(band).is_err() {
            break;
        }
    }
    (found, digest.finalize())
}
