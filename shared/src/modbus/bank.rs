//! The latest result of each kind, with its age and its number, taken from the messages that would otherwise leave
//! over the link.
//!
//! A register's value is therefore the message's own. A group is replaced as a whole between two requests, never
//! within one: values read by one request belong together.

use crate::config::{MAX_HARMONICS, MAX_TRAIN_GEARS};
use crate::message::{
    GearCondition, GearIndicators, GearSpectrum, Indicators, MeasuredBandwidth, MeshBand, Message, Peaks, SpectralLine,
    Spectrum, Status,
};
use crate::shaft_lines::ShaftOrders;
use crate::tach::Validity;

/// What a register of an age shows where there is no result, or one older than it can say.
pub const NO_RESULT_AGE_S: u16 = u16::MAX;

/// A result with the instant at which it was complete, and how many of its kind there were.
#[derive(Clone, Copy, Debug)]
pub struct Kept<T> {
    /// The result.
    pub latest: Option<T>,
    tick: u64,
    /// Results since the start, beginning again at 0 behind 65535.
    pub number: u16,
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self { latest: None, tick: 0, number: 0 }
    }
}

impl<T: Copy> Kept<T> {
    fn keep(&mut self, value: T, tick: u64) {
        *self = Self { latest: Some(value), tick, number: self.number.wrapping_add(1) };
    }

    /// Whole seconds since it was complete.
    pub fn age_s(&self, now: u64, ticks_per_second: u32) -> u16 {
        let seconds = now.saturating_sub(self.tick) / u64::from(ticks_per_second.max(1));
        if self.latest.is_some() { seconds.min(u64::from(NO_RESULT_AGE_S)) as u16 } else { NO_RESULT_AGE_S }
    }

    /// A value of it; not a number where there is no result.
    pub fn float(&self, of: impl FnOnce(&T) -> f32) -> f32 {
        self.latest.as_ref().map_or(f32::NAN, of)
    }

    /// A number of it; 0 where there is no result.
    pub fn word(&self, of: impl FnOnce(&T) -> u16) -> u16 {
        self.latest.as_ref().map_or(0, of)
    }
}

/// One mesh harmonic: itself and the first pair of sidebands of either shaft; not a number where there is none.
#[derive(Clone, Copy, Debug)]
pub struct Harmonic {
    /// The harmonic.
    pub mesh: f32,
    /// Below it by the pinion's rate, above it.
    pub pinion: [f32; 2],
    /// Below it by the gear's rate, above it.
    pub gear: [f32; 2],
}

impl Harmonic {
    /// There is none.
    pub const NONE: Self = Self { mesh: f32::NAN, pinion: [f32::NAN; 2], gear: [f32::NAN; 2] };

    fn of(band: &MeshBand) -> Self {
        Self { mesh: band.line.amplitude, pinion: nearest(&band.sidebands), gear: nearest(&band.gear_sidebands) }
    }
}

/// The pair next to the harmonic, of sidebands in ascending order.
fn nearest(sidebands: &[SpectralLine]) -> [f32; 2] {
    let (below, above) = sidebands.split_at(sidebands.len() / 2);
    [below.last(), above.first()].map(|line| line.map_or(f32::NAN, |line| line.amplitude))
}

/// A mesh-band record.
#[derive(Clone, Copy, Debug)]
pub struct Mesh {
    /// Mean rate of the pinion, Hz.
    pub speed_hz: f32,
    /// Turns of the pinion.
    pub turns: u16,
    /// The first harmonics, as many as there are.
    pub harmonics: [Harmonic; MAX_HARMONICS],
    /// How many.
    pub count: u16,
}

impl Mesh {
    fn of(spectrum: &Spectrum) -> Self {
        let mut harmonics = [Harmonic::NONE; MAX_HARMONICS];
        for (place, band) in harmonics.iter_mut().zip(&spectrum.bands) {
            *place = Harmonic::of(band);
        }
        Self { speed_hz: spectrum.tag.speed_hz, turns: spectrum.turns, harmonics, count: spectrum.bands.len() as u16 }
    }

    /// A harmonic, from 0.
    pub fn harmonic(&self, index: usize) -> Harmonic {
        self.harmonics.get(index).copied().unwrap_or(Harmonic::NONE)
    }
}

/// Lines kept.
pub const LINES: usize = 10;

/// The strongest lines of a block of samples.
#[derive(Clone, Copy, Debug)]
pub struct Lines {
    /// Quality of the speed.
    pub validity: Validity,
    /// Root mean square of the block without its mean, m/s^2.
    pub rms: f32,
    lines: [SpectralLine; LINES],
    /// How many there were, at most as many as are kept.
    pub count: u16,
}

impl Lines {
    /// Its line where there is none.
    const NONE: SpectralLine = SpectralLine { frequency_hz: f32::NAN, amplitude: f32::NAN };

    fn of(peaks: &Peaks) -> Self {
        let mut lines = [Self::NONE; LINES];
        for (place, line) in lines.iter_mut().zip(&peaks.lines) {
            *place = *line;
        }
        let count = peaks.lines.len().min(LINES) as u16;
        Self { validity: peaks.tag.validity, rms: peaks.rms, lines, count }
    }

    /// A line, from 0, the strongest first.
    pub fn line(&self, index: usize) -> SpectralLine {
        self.lines.get(index).copied().unwrap_or(Self::NONE)
    }
}

/// A further gear of a train.
#[derive(Clone, Copy, Debug)]
pub struct FurtherGear {
    /// Its rate, Hz.
    pub speed_hz: f32,
    /// First harmonic of its mesh, m/s^2.
    pub mesh: f32,
    /// First sidebands of that by its own rate, below and above, m/s^2.
    pub sidebands: [f32; 2],
    /// Of its average; not a number before one is complete.
    pub residual_rms: f32,
    /// FM0 of its average.
    pub fm0: f32,
    /// FM4 of its average.
    pub fm4: f32,
}

impl FurtherGear {
    /// Nothing is known.
    pub const NONE: Self = Self {
        speed_hz: f32::NAN,
        mesh: f32::NAN,
        sidebands: [f32::NAN; 2],
        residual_rms: f32::NAN,
        fm0: f32::NAN,
        fm4: f32::NAN,
    };
}

/// All that is kept.
#[derive(Clone, Debug, Default)]
pub struct Bank {
    /// Speed, rates, state.
    pub status: Kept<Status>,
    /// Overall values with their quality.
    pub values: Kept<Indicators>,
    /// Orders of the pinion.
    pub pinion: Kept<ShaftOrders>,
    /// Orders of the gear.
    pub wheel: Kept<ShaftOrders>,
    /// Condition of the synchronous average.
    pub gear: Kept<GearIndicators>,
    /// Bandwidth by rise times.
    pub bandwidth: Kept<MeasuredBandwidth>,
    /// Mesh bands.
    pub mesh: Kept<Mesh>,
    /// Strongest lines.
    pub lines: Kept<Lines>,
    /// Further gears of a train, in their order.
    pub train: [Kept<FurtherGear>; MAX_TRAIN_GEARS],
}

impl Bank {
    /// Keeps what a message says, at an instant.
    pub fn take(&mut self, message: &Message, tick: u64) {
        match message {
            Message::Status(status) => self.status.keep(*status, tick),
            Message::Spectrum(spectrum) => self.mesh.keep(Mesh::of(spectrum), tick),
            Message::Indicators(indicators) => self.take_indicators(indicators, tick),
            Message::Peaks(peaks) => self.lines.keep(Lines::of(peaks), tick),
            Message::GearSpectrum(GearSpectrum { gear, spectrum }) => self.further(*gear, tick, |kept| {
                let first = spectrum.bands.first().map_or(Harmonic::NONE, Harmonic::of);
                FurtherGear { speed_hz: spectrum.tag.speed_hz, mesh: first.mesh, sidebands: first.pinion, ..kept }
            }),
            Message::GearCondition(GearCondition { gear, indicators }) => self.further(*gear, tick, |kept| {
                let GearIndicators { speed_hz, residual_rms, fm0, fm4, .. } = *indicators;
                FurtherGear { speed_hz, residual_rms, fm0, fm4, ..kept }
            }),
            // Alarms, counters and the waveform are read from the node itself; events are not for a PLC.
            Message::Snapshot(_) | Message::Event(_) | Message::Statistics(_) | Message::SelfTest(_) => {}
        }
    }

    /// Adds to what is known of a further gear, by its number from 1.
    fn further(&mut self, gear: u8, tick: u64, add: impl FnOnce(FurtherGear) -> FurtherGear) {
        let place = usize::from(gear).checked_sub(1).and_then(|place| self.train.get_mut(place));
        if let Some(kept) = place {
            kept.keep(add(kept.latest.unwrap_or(FurtherGear::NONE)), tick);
        }
    }

    fn take_indicators(&mut self, indicators: &Indicators, tick: u64) {
        self.values.keep(*indicators, tick);
        if let Some(orders) = indicators.pinion {
            self.pinion.keep(orders, tick);
        }
        if let Some(orders) = indicators.wheel {
            self.wheel.keep(orders, tick);
        }
        if let Some(gear) = indicators.gear {
            self.gear.keep(gear, tick);
        }
        if let Some(bandwidth) = indicators.bandwidth {
            self.bandwidth.keep(bandwidth, tick);
        }
    }
}
