//! Streaming 10-90 % rise time of engagement edges.
//!
//! Mesh pulses have no top or base plateau, so the levels are local: the level before the edge, and the extremum that
//! ends it (`IEEE Std 181` reference levels applied to one upstroke). The definition is part of every figure:
//!
//! * The timed edge is the highest upstroke per tooth pitch; each pitch is a window centred where the last edge predicts
//!   the next.
//! * An upstroke ends when the signal has turned by the hysteresis, or has made no new extremum for three samples plus
//!   twice the upstroke's length (a plateau).
//! * 10 and 90 % crossings by linear interpolation between samples; extrema refined by a parabola where the neighbouring
//!   curvatures confirm a smooth top.
//! * The result is the median over teeth with its median absolute deviation; below 5 samples per edge it is refused,
//!   because two samples always look like 0.8 sample of rise time.
//!
//! Cost (estimate): 15 instructions per sample, plus 12 per sample of a timed edge; amortised O(1).
//! RAM: 4 bytes per `WINDOW` sample and 0.25 KiB for the teeth.

use crate::math;

/// Bandwidth times rise time of a well damped edge (0.26 for a ring with 5-10 % damping; see the law's documentation).
pub const BANDWIDTH_RISE_PRODUCT: f32 = 0.35;
/// Fewest samples within 10-90 % that give a result.
pub const FEWEST_SAMPLES_PER_EDGE: f32 = 5.0;
/// Edges remembered for the median.
const TEETH: usize = 64;
/// Samples taken for the median level before the edge.
const LEVEL_SAMPLES: usize = 9;

/// What counts as the level before the edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum PreEdge {
    /// The minimum from which the upstroke starts: right for a ringing signal.
    LocalExtremum,
    /// Median of nine samples ahead of the edge, half a rise time before its 10 % crossing: right for a noisy rest.
    Median,
}

/// Direction of the timed edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Polarity {
    /// Upward.
    Rising,
    /// Downward.
    Falling,
}

/// Settings of a [`RiseTime`] estimator.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RiseTimeConfig {
    /// Level before the edge.
    pub pre_edge: PreEdge,
    /// Direction of the edges.
    pub polarity: Polarity,
    /// Turning back by more than this ends an upstroke; a few times the noise's RMS, in the unit of the samples.
    pub hysteresis: f32,
    /// Upstrokes below this height are ignored, in the unit of the samples.
    pub minimum_height: f32,
}

/// One timed edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// 10-90 % duration in samples.
    pub rise_samples: f32,
    /// Height between the two levels.
    pub height: f32,
    /// Samples since the end of the edge.
    age: u32,
}

/// Median rise time over the remembered teeth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RiseTimeResult {
    /// Median 10-90 % duration, which is also the number of samples per edge.
    pub samples_per_edge: f32,
    /// Median absolute deviation, samples.
    pub deviation_samples: f32,
    /// Teeth in the median.
    pub count: u16,
}

impl RiseTimeResult {
    /// Rise time in seconds at the granted rate.
    pub fn seconds(&self, rate_hz: f32) -> f32 {
        self.samples_per_edge / rate_hz
    }

    /// Bandwidth 0.35 / rise time at the granted rate, Hz.
    pub fn bandwidth_hz(&self, rate_hz: f32) -> f32 {
        BANDWIDTH_RISE_PRODUCT * rate_hz / self.samples_per_edge
    }
}

/// Why there is no rise time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RiseTimeRefusal {
    /// No edge of the required height yet.
    NoEdges,
    /// Sampled too coarsely: the median edge has this many samples.
    TooCoarse {
        /// Samples between 10 and 90 %.
        samples_per_edge: f32,
    },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stroke {
    /// Going down: the lowest value so far and its age.
    Down,
    /// Going up from the minimum.
    Up,
}

/// Streaming estimator that looks back over at most `WINDOW` samples per edge.
#[derive(Debug, Clone)]
pub struct RiseTime<const WINDOW: usize> {
    config: RiseTimeConfig,
    pitch_samples: f32,
    samples: [f32; WINDOW],
    newest: usize,
    held: usize,
    stroke: Stroke,
    /// Extremum of the present stroke and its age; the minimum an upstroke started from.
    extremum: (f32, u32),
    start: (f32, u32),
    best: Option<Edge>,
    pitch_left: f32,
    teeth: [f32; TEETH],
    counted: u32,
    /// Upstrokes longer than the window, not timed.
    pub too_long: u32,
}

impl<const WINDOW: usize> RiseTime<WINDOW> {
    /// Starts without edges; `pitch_samples` is the duration of a tooth pitch in samples.
    pub fn new(config: RiseTimeConfig, pitch_samples: f32) -> Self {
        Self {
            config,
            pitch_samples,
            samples: [0.0; WINDOW],
            newest: 0,
            held: 0,
            stroke: Stroke::Down,
            extremum: (f32::INFINITY, 0),
            start: (0.0, 0),
            best: None,
            pitch_left: pitch_samples,
            teeth: [0.0; TEETH],
            counted: 0,
            too_long: 0,
        }
    }

    /// New speed or rate: tooth pitch in samples.
    pub fn set_pitch(&mut self, pitch_samples: f32) {
        self.pitch_samples = pitch_samples;
    }

    /// Forgets samples and edges.
    pub fn reset(&mut self) {
        *self = Self::new(self.config, self.pitch_samples);
    }

    /// Takes one sample; the edge of the tooth when a pitch has just ended with one.
    #[inline]
    pub fn push(&mut self, sample: f32) -> Option<Edge> {
        let x = if self.config.polarity == Polarity::Falling { -sample } else { sample };
        self.newest = if self.newest + 1 >= WINDOW { 0 } else { self.newest + 1 };
        self.samples[self.newest] = x;
        self.held = (self.held + 1).min(WINDOW);
        self.extremum.1 += 1;
        self.start.1 = self.start.1.saturating_add(1);
        if let Some(best) = &mut self.best {
            best.age += 1;
        }
        self.follow(x);
        self.pitch_left -= 1.0;
        if self.pitch_left > 0.0 { None } else { self.end_pitch() }
    }

    fn follow(&mut self, x: f32) {
        match self.stroke {
            Stroke::Down => {
                if x <= self.extremum.0 {
                    self.extremum = (x, 0);
                } else if x > self.extremum.0 + self.config.hysteresis {
                    self.start = self.extremum;
                    self.extremum = (x, 0);
                    self.stroke = Stroke::Up;
                }
            }
            Stroke::Up => {
                if x > self.extremum.0 {
                    self.extremum = (x, 0);
                    return;
                }
                let length = self.start.1 - self.extremum.1;
                let turned = x < self.extremum.0 - self.config.hysteresis && self.extremum.1 >= 2;
                if turned || self.extremum.1 > 3 + 2 * length {
                    self.end_stroke();
                    self.stroke = Stroke::Down;
                    self.extremum = (x, 0);
                }
            }
        }
    }

    fn end_stroke(&mut self) {
        let height = self.extremum.0 - self.start.0;
        if height < self.config.minimum_height || self.best.is_some_and(|best| best.height > height) {
            return;
        }
        if let Some(edge) = self.time_edge() {
            self.best = Some(edge);
        } else {
            self.too_long = self.too_long.saturating_add(1);
        }
    }

    fn end_pitch(&mut self) -> Option<Edge> {
        let edge = self.best.take();
        match edge {
            Some(edge) => {
                self.teeth[self.counted as usize % TEETH] = edge.rise_samples;
                self.counted = self.counted.wrapping_add(1);
                // The next window is centred one pitch after this edge.
                self.pitch_left = (1.5 * self.pitch_samples - edge.age as f32).max(0.5 * self.pitch_samples);
            }
            None => self.pitch_left += self.pitch_samples,
        }
        edge
    }

    /// Sample `age` ago; the oldest one beyond the window.
    fn back(&self, age: u32) -> f32 {
        let age = (age as usize).min(self.held.saturating_sub(1));
        self.samples[(self.newest + WINDOW - age) % WINDOW]
    }

    /// Smooth extremum near a sample: parabola, trusted as far as the curvatures next to it agree.
    fn refined(&self, age: u32) -> f32 {
        let centre = self.back(age);
        if age < 2 || age as usize + 2 >= self.held {
            return centre;
        }
        let y: [f32; 5] = core::array::from_fn(|i| self.back(age + 2 - i as u32));
        let curvature = [y[0] - 2.0 * y[1] + y[2], y[1] - 2.0 * y[2] + y[3], y[2] - 2.0 * y[3] + y[4]];
        if curvature[1] == 0.0 {
            return centre;
        }
        let agreement = (curvature[0] / curvature[1]).min(curvature[2] / curvature[1]);
        let trust = (2.0 * agreement).clamp(0.0, 1.0);
        let slope = y[3] - y[1];
        centre - trust * slope * slope / (8.0 * curvature[1])
    }

    /// Times the upstroke between `start` and `extremum`; `None` when its start has left the window.
    fn time_edge(&self) -> Option<Edge> {
        let (top_age, start_age) = (self.extremum.1, self.start.1);
        if start_age as usize + 1 >= self.held {
            return None;
        }
        let top = self.refined(top_age);
        let base = self.refined(start_age);
        let (early, late) = self.crossings(base, top, top_age, start_age);
        let (early, late, base) = match self.config.pre_edge {
            PreEdge::LocalExtremum => (early, late, base),
            PreEdge::Median => {
                let ahead = early + 0.5 * (early - late);
                let first = ahead as u32 + 1;
                if first as usize + LEVEL_SAMPLES >= self.held {
                    return None;
                }
                let mut level: [f32; LEVEL_SAMPLES] = core::array::from_fn(|i| self.back(first + i as u32));
                let base = math::median(&mut level)?;
                let (early, late) = self.crossings(base, top, top_age, self.held as u32 - 2);
                (early, late, base)
            }
        };
        Some(Edge { rise_samples: early - late, height: top - base, age: top_age })
    }

    /// Ages at which the signal last crosses 10 and 90 % on its way to the top.
    fn crossings(&self, base: f32, top: f32, top_age: u32, limit_age: u32) -> (f32, f32) {
        let levels = [base + 0.9 * (top - base), base + 0.1 * (top - base)];
        let mut ages = [top_age as f32; 2];
        let mut age = top_age;
        for (level, found) in levels.into_iter().zip(&mut ages) {
            let mut above = self.back(age);
            while age < limit_age {
                let below = self.back(age + 1);
                if below < level {
                    *found = age as f32 + ((above - level) / (above - below)).clamp(0.0, 1.0);
                    break;
                }
                above = below;
                age += 1;
                *found = age as f32;
            }
        }
        (ages[1], ages[0])
    }

    /// Median over the last teeth (at most 64).
    pub fn result(&self) -> Result<RiseTimeResult, RiseTimeRefusal> {
        let count = (self.counted as usize).min(TEETH);
        let mut teeth = self.teeth;
        let teeth = &mut teeth[..count];
        let Some(median) = math::median(teeth) else {
            return Err(RiseTimeRefusal::NoEdges);
        };
        if median < FEWEST_SAMPLES_PER_EDGE {
            return Err(RiseTimeRefusal::TooCoarse { samples_per_edge: median });
        }
        for rise in teeth.iter_mut() {
            *rise = (*rise - median).abs();
        }
        let deviation = math::median(teeth).unwrap_or(0.0);
        Ok(RiseTimeResult { samples_per_edge: median, deviation_samples: deviation, count: count as u16 })
    }
}

/// Rise time of the edge behind an instrument: squares subtract (a cascade's rise times add in squares). `None` when the
/// instrument alone would explain the measured one.
pub fn without_instrument(measured: f32, instrument: f32) -> Option<f32> {
    (measured > instrument).then(|| math::sqrt(measured * measured - instrument * instrument))
}
