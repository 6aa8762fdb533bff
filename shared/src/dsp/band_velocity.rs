//! Vibration velocity in a fixed band (10 Hz to 1000 Hz by default, as ISO 20816 asks), from ADC codes at any rate.
//!
//! A comb of three moving sums brings the codes to about [`OUTPUT_HZ`]; there the acceleration passes a Butterworth
//! high-pass of fourth order at the lower edge, one integrator of which is the integration itself, and a Butterworth
//! low-pass of fourth order at the upper: nothing is integrated that the band does not hold, so nothing drifts.
//! Filters are state variables with the trapezoidal rule (Zavalishin 2012): their states are the physical ones, so a
//! change of the ADC rate only changes coefficients, and a run-up with its many rates gives one record.
//!
//! The comb's droop and the trapezoid's are undone by five symmetric taps, exact at zero and at the two
//! `EXACT_SHARES` of the upper edge: gain of the whole within 0.1 % of the analogue filters' up to 1.8 of the upper
//! edge, so that a strong line beside the band adds what it would add there. Where the rate is too low for the second
//! of them three taps hold up to 0.9 of the edge. Aliases into the band: -70 dB at worst.
//!
//! Cost (Cortex-M4F): 7 instructions per code and about 95 per output, [`OUTPUT_HZ`] of them per second.

use crate::math;

/// Output rate aimed at, Hz; reached within the comb's whole ratio.
pub const OUTPUT_HZ: f32 = 20_000.0;
/// Highest ratio whose sums fit 32 bits: the cube of it times the largest code.
const HIGHEST_RATIO: u32 = 32;
/// Share of the output rate that the upper edge may have.
const HIGHEST_SHARE: f32 = 0.2;
/// Where the droop is undone exactly, shares of the upper edge.
const EXACT_SHARES: [f32; 2] = [0.8, 1.7];
/// Highest share of the output rate at which it is undone: beyond, the taps would lift the noise.
const MAX_RATE_SHARE: f32 = 0.12;
/// Damping of the two sections of a fourth-order Butterworth filter, 1/Q.
const BUTTERWORTH: [f32; 2] = [1.847_759, 0.765_366_9];

/// The band, Hz: -3 dB at both edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edges {
    /// Lower.
    pub from_hz: f32,
    /// Upper.
    pub to_hz: f32,
}

/// Two integrators in a loop.
#[derive(Clone, Copy, Debug, Default)]
struct Section {
    states: [f32; 2],
}

/// What a section needs to know of its edge.
#[derive(Clone, Copy, Debug, Default)]
struct Coefficients {
    damping: f32,
    factors: [f32; 3],
}

impl Coefficients {
    /// `gain` is tan(pi edge / rate).
    fn new(gain: f32, damping: f32) -> Self {
        let first = 1.0 / (1.0 + gain * (gain + damping));
        Self { damping, factors: [first, gain * first, gain * gain * first] }
    }
}

/// High, band and low part of a sample.
struct Parts {
    high: f32,
    band: f32,
    low: f32,
}

impl Section {
    #[inline(always)]
    fn pass(&mut self, sample: f32, of: &Coefficients) -> Parts {
        let [a, b, c] = of.factors;
        let rest = sample - self.states[1];
        let band = a * self.states[0] + b * rest;
        let low = self.states[1] + b * self.states[0] + c * rest;
        self.states = [2.0 * band - self.states[0], 2.0 * low - self.states[1]];
        Parts { high: sample - of.damping * band - low, band, low }
    }
}

/// The band at a rate: what all sensors that are sampled together share.
#[derive(Clone, Debug)]
pub struct VelocityBand {
    edges: Edges,
    upper_hz: f32,
    ratio: u32,
    scale: f32,
    /// Second and fourth difference that undo the droop.
    taps: [f32; 2],
    /// From the first section's band part to velocity, s.
    integration: f32,
    coefficients: [Coefficients; 4],
}

impl VelocityBand {
    /// For codes at a rate of [`VelocityBand::set_rate`].
    pub fn new(edges: Edges) -> Self {
        Self {
            edges,
            upper_hz: edges.to_hz,
            ratio: 1,
            scale: 1.0,
            taps: [0.0; 2],
            integration: 0.0,
            coefficients: [Coefficients::default(); 4],
        }
    }

    /// The codes come at another rate from now on; each sensor's comb begins anew ([`BandVelocity::begin_comb`]), its
    /// filters' states stay.
    pub fn set_rate(&mut self, adc_hz: f32) {
        let ratio = ((adc_hz / OUTPUT_HZ) as u32).clamp(1, HIGHEST_RATIO);
        let rate = adc_hz / ratio as f32;
        self.upper_hz = self.edges.to_hz.min(HIGHEST_SHARE * rate);
        self.ratio = ratio;
        self.scale = 1.0 / (ratio * ratio * ratio) as f32;
        let angle = |hz: f32| core::f32::consts::PI * hz / rate;
        let tangent = |hz: f32| math::sin(angle(hz)) / math::cos(angle(hz));
        let (low, high) = (tangent(self.edges.from_hz.min(0.5 * self.upper_hz)), tangent(self.upper_hz));
        self.integration = 0.5 / (rate * low);
        let [wide, narrow] = BUTTERWORTH;
        self.coefficients = [(low, wide), (low, narrow), (high, wide), (high, narrow)]
            .map(|(gain, damping)| Coefficients::new(gain, damping));
        // With u = 2 (1 - cos), the taps' gain is 1 - a u + b u^2.
        let missing = |share: f32| {
            let hz = share * self.upper_hz;
            let low_pass = low_pass_gain(tangent(hz) / high) / low_pass_gain(share);
            let gain = comb_gain(ratio, hz / rate) * angle(hz) / tangent(hz) * low_pass;
            let u = 2.0 * (1.0 - math::cos(2.0 * angle(hz)));
            (u, (1.0 / gain - 1.0) / u)
        };
        let [near, far] = EXACT_SHARES;
        let (u, first) = missing(near);
        let bend = if far * self.upper_hz <= MAX_RATE_SHARE * rate {
            let (v, second) = missing(far);
            (second - first) / (v - u)
        } else {
            0.0
        };
        self.taps = [bend * u - first, bend];
    }

    /// Upper edge in force: the band's, or what the rate carries.
    pub fn upper_hz(&self) -> f32 {
        self.upper_hz
    }

    /// Codes that an output stands for.
    pub fn codes_per_output(&self) -> u32 {
        self.ratio
    }
}

/// One sensor's comb and filters.
#[derive(Clone, Debug, Default)]
pub struct BandVelocity {
    filled: u32,
    sums: [i32; 3],
    earlier: [i32; 3],
    /// Outputs of the comb that do not count yet: those that still see what lay before it began.
    skipped: u32,
    held: [f32; 4],
    sections: [Section; 4],
}

impl BandVelocity {
    /// The codes come at another rate: the comb begins anew, the filters' states stay.
    pub fn begin_comb(&mut self) {
        (self.sums, self.earlier, self.filled, self.skipped) = ([0; 3], [0; 3], 0, 2);
    }

    /// Forgets the signal.
    pub fn restart(&mut self) {
        self.sections = [Section::default(); 4];
        self.held = [0.0; 4];
        self.begin_comb();
    }

    /// Takes codes above `zero`; returns the sum of the squared velocities (codes times seconds, squared) and their
    /// number.
    pub fn push(&mut self, band: &VelocityBand, codes: &[u16], zero: u16) -> (f32, u32) {
        let zero = i32::from(zero);
        let (mut squares, mut outputs) = (0.0f32, 0);
        let mut rest = codes;
        while !rest.is_empty() {
            let wanted = band.ratio.saturating_sub(self.filled).max(1) as usize;
            let (now, later) = rest.split_at(wanted.min(rest.len()));
            let [mut first, mut second, mut third] = self.sums;
            for &code in now {
                first = first.wrapping_add(i32::from(code) - zero);
                second = second.wrapping_add(first);
                third = third.wrapping_add(second);
            }
            self.sums = [first, second, third];
            self.filled += now.len() as u32;
            rest = later;
            if self.filled >= band.ratio {
                self.filled = 0;
                if let Some(velocity) = self.output(band) {
                    squares += velocity * velocity;
                    outputs += 1;
                }
            }
        }
        (squares, outputs)
    }

    /// One output of the comb through the filters.
    fn output(&mut self, band: &VelocityBand) -> Option<f32> {
        let once = self.sums[2].wrapping_sub(self.earlier[0]);
        let twice = once.wrapping_sub(self.earlier[1]);
        let thrice = twice.wrapping_sub(self.earlier[2]);
        self.earlier = [self.sums[2], once, twice];
        if self.skipped > 0 {
            self.skipped -= 1;
            return None;
        }
        let sample = thrice as f32 * band.scale;
        let [oldest, older, middle, newer] = self.held;
        self.held = [older, middle, newer, sample];
        let (inner, outer) = (older + newer, oldest + sample);
        let [second, fourth] = band.taps;
        let flat = middle + second * (inner - 2.0 * middle) + fourth * (outer - 4.0 * inner + 6.0 * middle);
        let [first, second, third, fourth] = &mut self.sections;
        let [a, b, c, d] = &band.coefficients;
        let integrated = first.pass(flat, a).band;
        let high = second.pass(integrated, b).high;
        let low = third.pass(high, c).low;
        Some(fourth.pass(low, d).low * band.integration)
    }
}

/// Gain of a fourth-order Butterworth low-pass at a frequency over its edge.
fn low_pass_gain(share: f32) -> f32 {
    let squared = share * share;
    let eighth = squared * squared * squared * squared;
    1.0 / math::sqrt(1.0 + eighth)
}

/// Gain of three moving means of `ratio` samples at a frequency in turns per output.
fn comb_gain(ratio: u32, turns: f32) -> f32 {
    let x = turns / ratio as f32;
    let mean = math::sinc(turns) / math::sinc(x);
    mean * mean * mean
}
