//! Mesh bands in the order domain: the neighbourhoods of mesh harmonics 1..H, fine enough to separate shaft sidebands.
//!
//! Input is vibration resampled to 16 to [`SAMPLES_PER_PITCH`] samples per tooth pitch of the pinion
//! ([`crate::order`]), so a mesh harmonic stays where it is at any speed and during a run-up, and orders replace
//! hertz. Three stages:
//!
//! 1. *Filter bank.* Once per pitch the last 6 pitches are weighted with a Blackman-Harris window, folded to one pitch
//!    and transformed, the wanted bins only, by definition. Bin h is the complex amplitude of mesh harmonic h for
//!    that engagement, for all harmonics at the price of one mixer. A neighbouring harmonic (1 - b of the spacing
//!    away, b <= 1/3) meets the side lobes, below -92 dB.
//! 2. *Decimation by any ratio.* The engagement values (z per turn) are gathered under the same window, 6 output
//!    spacings long, into `POINTS` values per record of n turns. Aliases fall below -92 dB for |order offset| at most a
//!    third of the output rate.
//! 3. *Spectrum.* Window, complex FFT of `POINTS`, division by the two known window responses (the droop is exact, not
//!    fitted), power average.
//!
//! Resolution is 1/n order per bin: n = 16 gives f_shaft/16 at every speed. Records of a whole number of turns of
//! *both* shafts ([`common_turns`]) put the sidebands of both on bins, so a rectangular window reads them without
//! leakage.
//!
//! A line of fixed frequency (mains, another machine) sweeps through orders when the speed changes; [`orders_swept`]
//! gives the orders it touched so that lines there can be flagged instead of believed.
//!
//! Cost: see `tests/snapshots/instructions.txt` and `cargo xtask bench-node`, which sets it against a full-band FFT.
//! RAM: 12 bytes per point and harmonic, 1.7 KiB for the pitches and their window; flash 3 KiB of window table.

use crate::math;
use crate::spectrum::{self, Line};
use crate::window::Window;
use microfft::Complex32;

/// Most input samples per tooth pitch, S: anything above mesh harmonic S - H must be filtered away before resampling.
pub const SAMPLES_PER_PITCH: usize = 42;
/// Fewest input samples per tooth pitch.
const COARSEST_GRID: usize = 16;
/// Length of the filter bank's window, in pitches, and of the decimator's, in output spacings.
const WINDOW_SPACINGS: usize = 6;
const HISTORY: usize = SAMPLES_PER_PITCH * WINDOW_SPACINGS;
const TABLE: usize = 4 * HISTORY;

/// Blackman-Harris window over [`TABLE`] intervals, one guard value for interpolation.
static WINDOW: [f32; TABLE + 1] = window_table();

const fn window_table() -> [f32; TABLE + 1] {
    let a = [0.358_75, 0.488_29, 0.141_28, 0.011_68];
    let mut table = [0.0; TABLE + 1];
    let mut i = 0;
    while i <= TABLE {
        let turns = i as f64 / TABLE as f64;
        let value = a[0] - a[1] * math::sin_turns_const(turns + 0.25)
            + a[2] * math::sin_turns_const(2.0 * turns + 0.25)
            - a[3] * math::sin_turns_const(3.0 * turns + 0.25);
        table[i] = value as f32;
        i += 1;
    }
    table
}

/// Mean of the table's window.
const WINDOW_MEAN: f32 = 0.358_75;

/// How spectra of successive records are combined; always in power.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Averaging {
    /// Mean of this many records, then start anew with the next.
    Linear {
        /// Records per average, at least 1.
        records: u16,
    },
    /// New record weighted by this much (0 to 1) against the past; the first record counts fully.
    Exponential {
        /// Weight of the newest record.
        weight: f32,
    },
}

/// What a [`MeshZoom`] looks at.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ZoomConfig {
    /// Teeth of the pinion (the shaft whose turns are the order base).
    pub teeth: u16,
    /// Turns of the pinion per record; the resolution is 1/turns order per bin.
    pub turns: u16,
    /// Window of the record.
    pub window: Window,
    /// Averaging of successive records.
    pub averaging: Averaging,
}

/// Why a [`ZoomConfig`] was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ZoomError {
    /// Fewer than 12 teeth: the bands of neighbouring harmonics would touch.
    Teeth,
    /// Fewer than 8 turns per record, or fewer than 9 points per turn, or more points than engagements.
    Turns,
    /// `POINTS` is not a power of two from 32 to 2048, or the harmonics exceed 8.
    Shape,
    /// No records to average, or a weight outside (0, 1].
    Averaging,
}

/// Mesh-band analyser for harmonics 1..=`HARMONICS` with records of `POINTS` complex values.
#[derive(Debug, Clone)]
pub struct MeshZoom<const POINTS: usize, const HARMONICS: usize> {
    config: ZoomConfig,
    /// Output spacings per pitch.
    outputs_per_pitch: f32,
    /// Samples per pitch; the window at each sample, from the oldest pitch to the newest and once more, so that a
    /// ring of pitches finds its weights in one piece; cosine and sine of each harmonic on this grid.
    grid: usize,
    weights: [[f32; 2 * WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
    circles: [[(f32, f32); SAMPLES_PER_PITCH / 2]; HARMONICS],
    state: State<POINTS, HARMONICS>,
}

#[derive(Debug, Clone)]
struct State<const POINTS: usize, const HARMONICS: usize> {
    /// Last six pitches by sample, `newest` is being filled.
    pitches: [[f32; WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
    newest: usize,
    fill: usize,
    /// Pitches seen since the start, up to a full history.
    primed: usize,
    /// Engagement number inside the record.
    engagement: u32,
    record: [[Complex32; POINTS]; HARMONICS],
    power: [[f32; POINTS]; HARMONICS],
    records: u32,
}

impl<const POINTS: usize, const HARMONICS: usize> MeshZoom<POINTS, HARMONICS> {
    /// Without a configuration, all zero bytes so that a static needs no image in flash; takes samples and never
    /// completes a record.
    pub const IDLE: Self = Self {
        config: ZoomConfig {
            teeth: 0,
            turns: 0,
            window: Window::Rectangular,
            averaging: Averaging::Linear { records: 0 },
        },
        outputs_per_pitch: 0.0,
        grid: 0,
        weights: [[0.0; 2 * WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
        circles: [[(0.0, 0.0); SAMPLES_PER_PITCH / 2]; HARMONICS],
        state: State {
            pitches: [[0.0; WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
            newest: 0,
            fill: 0,
            primed: 0,
            engagement: 0,
            record: [[Complex32::new(0.0, 0.0); POINTS]; HARMONICS],
            power: [[0.0; POINTS]; HARMONICS],
            records: 0,
        },
    };

    /// Checks the configuration and starts with empty averages.
    pub fn new(config: ZoomConfig) -> Result<Self, ZoomError> {
        let mut zoom = Self::IDLE;
        zoom.configure(config)?;
        Ok(zoom)
    }

    /// Checks the configuration, then starts anew with it; after an error the old one stays.
    pub fn configure(&mut self, config: ZoomConfig) -> Result<(), ZoomError> {
        if !(POINTS.is_power_of_two() && (32..=2048).contains(&POINTS) && (1..=8).contains(&HARMONICS)) {
            return Err(ZoomError::Shape);
        }
        if config.teeth < 12 {
            return Err(ZoomError::Teeth);
        }
        let engagements = u32::from(config.teeth) * u32::from(config.turns);
        if config.turns < 8 || POINTS < 9 * usize::from(config.turns) || engagements < POINTS as u32 {
            return Err(ZoomError::Turns);
        }
        let averaging_valid = match config.averaging {
            Averaging::Linear { records } => records >= 1,
            Averaging::Exponential { weight } => weight > 0.0 && weight <= 1.0,
        };
        if !averaging_valid {
            return Err(ZoomError::Averaging);
        }
        self.config = config;
        self.outputs_per_pitch = POINTS as f32 / engagements as f32;
        self.reset();
        self.set_samples_per_pitch(SAMPLES_PER_PITCH);
        Ok(())
    }

    /// Changes the grid of the input (16 to [`SAMPLES_PER_PITCH`], made even) and forgets the record in progress.
    pub fn set_samples_per_pitch(&mut self, samples: usize) {
        self.interrupt();
        self.grid = samples.clamp(COARSEST_GRID, SAMPLES_PER_PITCH) & !1;
        let length = 1.0 / (self.grid * WINDOW_SPACINGS) as f32;
        for (n, weights) in self.weights.iter_mut().take(self.grid).enumerate() {
            for (pitch, weight) in weights.iter_mut().enumerate() {
                *weight = window_at((pitch % WINDOW_SPACINGS * self.grid + n) as f32 * length);
            }
        }
        let step = crate::window::phase_step(self.grid);
        for (order, circle) in (1u32..).zip(&mut self.circles) {
            for (n, unit) in (1u32..).zip(circle) {
                *unit = math::cossin(step.wrapping_mul(order * n));
            }
        }
    }

    /// Input samples per tooth pitch.
    pub fn samples_per_pitch(&self) -> usize {
        self.grid
    }

    /// The configuration in force.
    pub fn config(&self) -> &ZoomConfig {
        &self.config
    }

    /// Samples per turn of the pinion this analyser wants.
    pub fn samples_per_turn(&self) -> u32 {
        u32::from(self.config.teeth) * self.grid as u32
    }

    /// Forgets the record in progress (lost samples, lost tach); the averages stay.
    pub fn interrupt(&mut self) {
        self.state.fill = 0;
        self.state.primed = 0;
        self.restart_record();
    }

    /// Empties the averages as well.
    pub fn reset(&mut self) {
        self.interrupt();
        self.state.records = 0;
    }

    fn restart_record(&mut self) {
        self.state.engagement = 0;
        for record in &mut self.state.record {
            record.fill(Complex32::new(0.0, 0.0));
        }
    }

    /// Takes angle-resampled vibration and returns the number of records completed within it.
    pub fn push(&mut self, samples: &[f32]) -> u32 {
        self.push_with(samples, |_| ())
    }

    /// As [`MeshZoom::push`]; `low` gets the mean over the window of each engagement, the filter bank's bin 0, which
    /// describes the middle of the last six pitches.
    pub fn push_with(&mut self, samples: &[f32], mut low: impl FnMut(f32)) -> u32 {
        let mut completed = 0;
        let mut rest = samples;
        while !rest.is_empty() && self.grid != 0 {
            let state = &mut self.state;
            let count = rest.len().min(self.grid.saturating_sub(state.fill));
            let (now, later) = rest.split_at(count);
            store(state.pitches.get_mut(state.fill..).unwrap_or_default(), state.newest, now);
            state.fill += count;
            rest = later;
            if state.fill == self.grid {
                state.fill = 0;
                state.newest = (state.newest + 1) % WINDOW_SPACINGS;
                state.primed = (state.primed + 1).min(WINDOW_SPACINGS);
                if state.primed == WINDOW_SPACINGS && self.config.turns != 0 {
                    let (mean, complete) = self.engage();
                    low(mean);
                    completed += u32::from(complete);
                }
            }
        }
        completed
    }

    /// One engagement: filter bank, then decimation. The window's mean, and whether the record is complete.
    fn engage(&mut self) -> (f32, bool) {
        // Peak amplitude of the harmonic, times the decimator's normalisation.
        let history = (self.grid * WINDOW_SPACINGS) as f32;
        let scale = 2.0 / (history * WINDOW_MEAN) * self.outputs_per_pitch / (WINDOW_SPACINGS as f32 * WINDOW_MEAN);
        let (sum, mut values) = self.harmonics();
        let mean = sum / (history * WINDOW_MEAN);
        for value in &mut values {
            *value *= scale;
        }
        let state = &mut self.state;
        let position = state.engagement as f32 * self.outputs_per_pitch;
        // Outputs whose windows hold this engagement: six, fewer at the ends of the record.
        let first = (position as usize).saturating_sub(WINDOW_SPACINGS - 1);
        let weights =
            core::array::from_fn(|n| window_at((position - (first + n) as f32) * (1.0 / WINDOW_SPACINGS as f32)));
        gather(state.record.as_flattened_mut(), POINTS, &values, &weights, first);
        state.engagement += 1;
        if position < (POINTS - 1 + WINDOW_SPACINGS) as f32 {
            return (mean, false);
        }
        self.finish_record();
        self.restart_record();
        (mean, true)
    }

    /// The windowed pitches folded to one: its sum, and bins 1..=`HARMONICS` of its transform.
    fn harmonics(&self) -> (f32, [Complex32; HARMONICS]) {
        let mut values = [Complex32::new(0.0, 0.0); HARMONICS];
        let mut folded = [0.0f32; SAMPLES_PER_PITCH];
        fold(&self.state.pitches, &self.weights, self.state.newest, folded.get_mut(..self.grid).unwrap_or_default());
        transform(&folded, self.grid, &self.circles, &mut values);
        (folded.iter().take(self.grid).sum(), values)
    }

    fn finish_record(&mut self) {
        let share = match self.config.averaging {
            Averaging::Linear { records } => 1.0 / (self.state.records % u32::from(records).max(1) + 1) as f32,
            Averaging::Exponential { .. } if self.state.records == 0 => 1.0,
            Averaging::Exponential { weight } => weight,
        };
        let step = crate::window::phase_step(POINTS);
        for record in &mut self.state.record {
            for (n, value) in record.iter_mut().enumerate() {
                *value *= self.config.window.at_phase(step.wrapping_mul(n as u32));
            }
            if spectrum::complex_fft(record).is_err() {
                return;
            }
        }
        for offset in 0..=self.reach_bins() {
            let gain = 1.0 / (POINTS as f32 * self.config.window.coherent_gain() * self.droop(offset as f32));
            let places = [(offset, POINTS / 2 + offset), ((POINTS - offset) % POINTS, POINTS / 2 - offset)];
            let sides = if offset == 0 { 1 } else { 2 };
            for (record, power) in self.state.record.iter().zip(&mut self.state.power) {
                for &(bin, place) in &places[..sides] {
                    let (Some(line), Some(power)) = (record.get(bin), power.get_mut(place)) else { continue };
                    let new = line.norm_sqr() * gain * gain;
                    let old = *power;
                    *power = if share == 1.0 { new } else { old + share * (new - old) };
                }
            }
        }
        self.state.records += 1;
    }

    /// Response of filter bank and decimator to a line this many bins from the harmonic.
    fn droop(&self, offset_bins: f32) -> f32 {
        let pitches_per_record = f32::from(self.config.teeth) * f32::from(self.config.turns);
        let length = WINDOW_SPACINGS as f32 * offset_bins;
        Window::BlackmanHarris.response(length / pitches_per_record)
            * Window::BlackmanHarris.response(length / POINTS as f32)
    }

    /// Records averaged so far (linear averages start anew each `records`).
    pub fn records(&self) -> u32 {
        self.state.records
    }

    /// Bins on each side of a harmonic that are free of aliases and corrected for droop: a third of the output rate or
    /// of the tooth count, whichever is less.
    pub fn reach_bins(&self) -> usize {
        let by_teeth = usize::from(self.config.teeth) * usize::from(self.config.turns) / 3;
        (POINTS / 3).min(by_teeth)
    }

    /// Width of a bin in orders of the pinion.
    pub fn order_per_bin(&self) -> f32 {
        1.0 / f32::from(self.config.turns)
    }

    /// Squared amplitudes around a harmonic, `POINTS / 2` is the harmonic itself; places beyond the reach are not
    /// defined.
    pub fn powers(&self, harmonic: usize) -> Option<&[f32; POINTS]> {
        self.state.power.get(harmonic.checked_sub(1)?)
    }

    /// Amplitude (peak, input unit) `offset_bins` from mesh harmonic `harmonic` (1..); `None` outside the band.
    pub fn amplitude(&self, harmonic: usize, offset_bins: i32) -> Option<f32> {
        if offset_bins.unsigned_abs() as usize > self.reach_bins() {
            return None;
        }
        let band = self.state.power.get(harmonic.checked_sub(1)?)?;
        band.get((POINTS as i32 / 2 + offset_bins) as usize).map(|&power| math::sqrt(power))
    }

    /// The line at an order offset from a harmonic, read where it must lie: the nearest bin, and what the window shows
    /// there of a line at the place. Places are known in the order domain; a search would climb the skirt of a stronger
    /// neighbour.
    ///
    /// `bin` of the result is the offset in bins from the harmonic. `None` outside the band. Two lines nearer than the
    /// window's main lobe cannot be told apart ([`MeshZoom::is_one`]).
    pub fn line(&self, harmonic: usize, order_offset: f32) -> Option<Line> {
        let place = order_offset * f32::from(self.config.turns);
        let bin = math::round(place);
        let amplitude = self.amplitude(harmonic, bin as i32)?;
        // The bin carries the droop of the line's place, and was corrected for its own.
        let seen = self.config.window.response(place - bin) * self.droop(place) / self.droop(bin);
        Some(Line { bin: place, amplitude: amplitude / seen })
    }

    /// Whether lines so many orders apart are one to a record: nearer than two bins.
    pub fn is_one(&self, orders_apart: f32) -> bool {
        orders_apart.abs() * f32::from(self.config.turns) < 2.0 - 1e-3
    }

    /// Sidebands +-1..=`COUNT` of one shaft around a harmonic, -`COUNT` first; `shaft_order` is 1 for the pinion and
    /// z1/z2 for the wheel. Places outside the band are `None`.
    pub fn sidebands<const COUNT: usize>(&self, harmonic: usize, shaft_order: f32) -> SidebandPair<COUNT> {
        let line = |k: i32| self.line(harmonic, k as f32 * shaft_order);
        SidebandPair {
            lower: core::array::from_fn(|k| line(-(k as i32) - 1)),
            upper: core::array::from_fn(|k| line(k as i32 + 1)),
        }
    }

    /// Sum of the amplitudes of the sidebands +-1..=3 of a shaft over the amplitude of the harmonic.
    ///
    /// Sideband energy ratio as used for wind-turbine gearboxes (Hanna, Hatch, Kalb, Weiss, Luo: GE/Bently Nevada,
    /// 2011); variants square the amplitudes. `None` without a harmonic line or when a sideband leaves the band.
    pub fn sideband_energy_ratio(&self, harmonic: usize, shaft_order: f32) -> Option<f32> {
        let carrier = self.line(harmonic, 0.0)?.amplitude;
        let sidebands = self.sidebands::<3>(harmonic, shaft_order);
        let mut sum = 0.0;
        for line in sidebands.lower.iter().chain(&sidebands.upper) {
            sum += line.as_ref()?.amplitude;
        }
        (carrier > 0.0).then(|| sum / carrier)
    }
}

/// Samples into one pitch of the ring.
fn store(pitches: &mut [[f32; WINDOW_SPACINGS]], newest: usize, samples: &[f32]) {
    let Some(places) = pitches.as_flattened_mut().get_mut(newest..) else { return };
    for (place, x) in places.iter_mut().step_by(WINDOW_SPACINGS).zip(samples) {
        *place = *x;
    }
}

/// Windowed sum of six pitches of a ring whose oldest is `oldest`. This and its neighbours have no type parameters so
/// that they are compiled here, for speed, and not in the binary that picks the sizes.
fn fold(
    pitches: &[[f32; WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
    weights: &[[f32; 2 * WINDOW_SPACINGS]; SAMPLES_PER_PITCH],
    oldest: usize,
    folded: &mut [f32],
) {
    let start = WINDOW_SPACINGS - oldest.min(WINDOW_SPACINGS);
    for ((sum, [a, b, c, d, e, f]), weights) in folded.iter_mut().zip(pitches).zip(weights) {
        if let Some([p, q, r, s, t, u]) = weights.get(start..).and_then(|rest| rest.first_chunk()) {
            *sum = a * p + b * q + c * r + d * s + e * t + f * u;
        }
    }
}

/// Bins 1, 2, ... of the transform of one folded pitch: samples n and S - n meet the same cosine and opposite sines.
fn transform(
    folded: &[f32; SAMPLES_PER_PITCH],
    grid: usize,
    circles: &[[(f32, f32); SAMPLES_PER_PITCH / 2]],
    values: &mut [Complex32],
) {
    let half = grid / 2;
    let mut pairs = [(0.0f32, 0.0f32); SAMPLES_PER_PITCH / 2];
    let (Some(rising), Some(falling)) = (folded.get(1..half), folded.get(half + 1..grid)) else { return };
    for ((pair, &x), &y) in pairs.iter_mut().zip(rising).zip(falling.iter().rev()) {
        *pair = (x + y, x - y);
    }
    let pairs = pairs.get(..rising.len()).unwrap_or_default();
    let (first, middle) = (folded[0], folded.get(half).copied().unwrap_or_default());
    let mut even_order = false;
    for (circle, value) in circles.iter().zip(values) {
        let (mut re, mut im) = (if even_order { first + middle } else { first - middle }, 0.0);
        even_order = !even_order;
        for (&(even, odd), &(cosine, sine)) in pairs.iter().zip(circle) {
            re += even * cosine;
            im -= odd * sine;
        }
        *value = Complex32::new(re, im);
    }
}

/// Adds a value under its window weight to one point of every record; `values` and points lie in steps of `stride`.
fn gather(
    records: &mut [Complex32],
    stride: usize,
    values: &[Complex32],
    weights: &[f32; WINDOW_SPACINGS],
    first: usize,
) {
    for (record, value) in records.chunks_exact_mut(stride.max(1)).zip(values) {
        for (point, weight) in record.iter_mut().skip(first).zip(weights) {
            *point += value * *weight;
        }
    }
}

/// Lower and upper sidebands of one shaft, nearest first; bins count from the harmonic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SidebandPair<const COUNT: usize> {
    /// Sidebands -1, -2, ...
    pub lower: [Option<Line>; COUNT],
    /// Sidebands +1, +2, ...
    pub upper: [Option<Line>; COUNT],
}

/// The decimator's window at `u` of its length, zero outside 0..1.
fn window_at(u: f32) -> f32 {
    let place = u * TABLE as f32;
    if !(place >= 0.0 && place < TABLE as f32) {
        return 0.0;
    }
    let index = place as usize;
    let fraction = place - index as f32;
    let (Some(&below), Some(&above)) = (WINDOW.get(index), WINDOW.get(index + 1)) else { return 0.0 };
    below + fraction * (above - below)
}

/// Turns of the pinion after which both shafts have made whole turns: z2 / gcd(z1, z2). This is also the hunting
/// period of the pair. `None` when a tooth count is 0.
pub fn common_turns(pinion_teeth: u16, wheel_teeth: u16) -> Option<u16> {
    if pinion_teeth == 0 || wheel_teeth == 0 {
        return None;
    }
    let (mut a, mut b) = (pinion_teeth, wheel_teeth);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    Some(wheel_teeth / a)
}

/// Orders (low, high) a line of fixed frequency passes while the shaft turns between two speeds (Hz), widened by
/// `margin_orders`: whatever lies there in the averaged spectrum may be that line. `None` unless all are positive.
pub fn orders_swept(fixed_hz: f32, slowest_hz: f32, fastest_hz: f32, margin_orders: f32) -> Option<(f32, f32)> {
    let valid = fixed_hz > 0.0 && slowest_hz > 0.0 && fastest_hz >= slowest_hz && margin_orders >= 0.0;
    valid.then(|| (fixed_hz / fastest_hz - margin_orders, fixed_hz / slowest_hz + margin_orders))
}
