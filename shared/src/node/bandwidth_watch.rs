//! Measured bandwidth against the law: rise times of engagement edges, timed now and then at a rate that resolves them.
//!
//! The law's own rate does not: at 2.56 times the bandwidth an edge has 0.9 samples. A measurement therefore takes
//! fewer half-band stages, so many that the law's edge has [`WANTED_SAMPLES`] (an edge half as long can then still be
//! timed), or
//! [`FEWEST_SAMPLES_PER_EDGE`] at least; where the ADC rate does not give these either (high speeds), nothing is
//! measured and nothing is claimed.
//!
//! Cost: 140 instructions per sample and some thousands per edge while it runs, ten tooth pitches every two seconds.

use crate::config::Configuration;
use crate::decimate::MAX_STAGES;
use crate::law::RISE_TIME_CONSTANT;
use crate::math;
use crate::message::MeasuredBandwidth;
use crate::rise_time::{FEWEST_SAMPLES_PER_EDGE, Polarity, RiseTime, RiseTimeConfig};

/// Samples within the rise time of an edge of the law's bandwidth, wanted.
pub const WANTED_SAMPLES: f32 = 10.0;
/// Tooth pitches timed per measurement.
const PITCHES: f32 = 10.0;
/// Edges lower than this share of the signal's RMS are not timed.
const HEIGHT_SHARE: f32 = 0.5;
/// Longest edge, samples.
const WINDOW: usize = 256;
/// Departure of the bandwidth's natural logarithm that counts, on top of twice the law's uncertainty: 30 %.
const DEPARTURE: f32 = 0.262;
/// Measurements in a row that must agree before the verdict changes.
const PERSISTENCE: u8 = 3;
/// Fewest teeth for a result.
const FEWEST_TEETH: u16 = 5;

/// Relative uncertainty of a rise time by noise over height, where the estimator gives a result: two crossings of an
/// edge whose slope is 0.85 heights per rise time scatter by 1.7, and the median is drawn by as much again.
const NOISE_TO_RISE: f32 = 3.4;

/// How the verdict changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The law no longer holds.
    Departs,
    /// The law holds again.
    Agrees,
}

/// Estimator and verdict.
#[derive(Clone, Debug)]
pub struct BandwidthWatch {
    estimator: RiseTime<WINDOW>,
    samples_left: u32,
    rate_hz: f32,
    law_hz: f32,
    departed: bool,
    streak: u8,
    /// Noise of the latest result over its height.
    noise: f32,
}

impl Default for BandwidthWatch {
    fn default() -> Self {
        Self {
            estimator: RiseTime::new(RiseTimeConfig { polarity: Polarity::Either, minimum_height: 0.0 }, 1.0),
            samples_left: 0,
            rate_hz: 0.0,
            law_hz: 0.0,
            departed: false,
            streak: 0,
            noise: 0.0,
        }
    }
}

impl BandwidthWatch {
    /// Stages after the ADC at which edges of the law's bandwidth can be timed; `None` where none does.
    pub fn stages(adc_hz: f32, law_hz: f32) -> Option<u8> {
        let samples = |stages: u8| RISE_TIME_CONSTANT * adc_hz / ((1u32 << stages) as f32 * law_hz);
        if !(law_hz > 0.0 && samples(0) >= FEWEST_SAMPLES_PER_EDGE) {
            return None;
        }
        Some(
            (0..=MAX_STAGES as u8).take_while(|&stages| stages == 0 || samples(stages) >= WANTED_SAMPLES).count() as u8
                - 1,
        )
    }

    /// Begins a measurement of samples at `rate_hz`; `signal_rms` is the signal's.
    pub fn begin(&mut self, rate_hz: f32, law_hz: f32, mesh_hz: f32, signal_rms: f32) {
        let pitch = rate_hz / mesh_hz;
        let config = RiseTimeConfig { polarity: Polarity::Either, minimum_height: HEIGHT_SHARE * signal_rms };
        self.estimator = RiseTime::new(config, pitch);
        self.estimator.expect(RISE_TIME_CONSTANT * rate_hz / law_hz);
        self.samples_left = ((PITCHES * pitch) as u32).saturating_add(1);
        (self.rate_hz, self.law_hz) = (rate_hz, law_hz);
    }

    /// Takes samples; true when the measurement is complete.
    pub fn push(&mut self, samples: &[f32]) -> bool {
        for &sample in samples {
            self.estimator.push(sample);
        }
        self.samples_left = self.samples_left.saturating_sub(samples.len() as u32);
        self.samples_left == 0
    }

    /// The measurement's result; `None` for too few teeth, edges too short for the rate, or too much noise.
    pub fn result(&mut self) -> Option<MeasuredBandwidth> {
        let result = self.estimator.result().ok().filter(|result| result.count >= FEWEST_TEETH)?;
        self.noise = result.noise;
        Some(MeasuredBandwidth {
            rise_s: result.seconds(self.rate_hz),
            deviation_s: result.deviation_samples / self.rate_hz,
            teeth: result.count,
            samples_per_edge: result.samples_per_edge,
            bandwidth_hz: result.bandwidth_hz(self.rate_hz),
            law_hz: self.law_hz,
        })
    }

    /// Judges a result against the law's uncertainty; a change of the verdict.
    pub fn judge(&mut self, measured: &MeasuredBandwidth, config: &Configuration) -> Option<Verdict> {
        let departure = math::ln(measured.bandwidth_hz / measured.law_hz).abs();
        let uncertainty = math::hypot(config.law.relative_uncertainty, NOISE_TO_RISE * self.noise);
        let departs = departure > DEPARTURE + 2.0 * uncertainty;
        self.streak = if departs == self.departed { 0 } else { self.streak + 1 };
        if self.streak < PERSISTENCE {
            return None;
        }
        self.streak = 0;
        self.departed = departs;
        Some(if departs { Verdict::Departs } else { Verdict::Agrees })
    }
}
