//! Streaming 10-90 % rise time of engagement edges.
//!
//! Mesh pulses have no top or base plateau and ride on the ring of earlier engagements, so extrema time the ring. The
//! project's definition needs the slope alone, and is the one the host applies to polynomials:
//!
//! > An edge is the stretch around a maximum of |slope| over which the slope keeps its sign and stays above one third
//! > of that maximum. Its levels are the values at its two ends; its rise time is the 10-90 % time between them.
//!
//! A linear ramp gives 0.8 of its width, whatever ring of less than a third of its slope it rides on; a raised cosine
//! 0.544. The timed edge is the steepest per tooth pitch; each pitch is a window centred where the last edge predicts
//! the next. Two steps: differences over a fifth of the rise time (at least one sample, so that noise does not cut
//! long edges short) find the lobes of the slope, and each lobe that may be the steepest is timed on the shape of its
//! slope between the samples (`edge_shape`), kinks included. The result is the median over teeth with its median
//! absolute deviation. Below 5 samples per edge it is refused, because two samples always look like 0.8 sample of
//! rise time.
//!
//! Limits: an edge must be shorter than about 0.4 `WINDOW`, and is known when 0.6 of its rise time have passed after
//! it. Noise makes a slope look steeper and its edge shorter: by up to 3 % at a noise of 0.5 % of the height (RMS) and
//! 10 samples per edge. Noise is measured on the same samples, by second differences in the quietest quarter of runs of
//! `RUN` ([`RiseTimeResult::noise`]); above [`MOST_NOISE`] of the height there is no result, because what is left
//! after the shortest have been refused is biased.
//!
//! 10-90 % convention: IEEE Std 181. Cost (Cortex-M4F in QEMU): about 140 instructions per sample, amortised O(1),
//! and some thousands per timed edge, of which a pitch has few: meant for snapshots, not for a continuous stream.
//! RAM: 4 bytes per `WINDOW` sample, 0.25 KiB for the teeth; 1.1 KiB of stack.

use crate::dsp::edge_shape::EdgeShape;
use crate::math;

/// Bandwidth times rise time of a well damped edge (0.26 for a ring with 5-10 % damping; see the law's documentation).
pub const BANDWIDTH_RISE_PRODUCT: f32 = 0.35;
/// Fewest samples within 10-90 % that give a result.
pub const FEWEST_SAMPLES_PER_EDGE: f32 = 5.0;
/// Share of the greatest slope at which an edge begins and ends.
pub const SLOPE_THRESHOLD: f32 = 1.0 / 3.0;
/// Edges remembered for the median.
const TEETH: usize = 64;
/// Teeth after which the span of the slope is adapted.
const ADAPT_EVERY: u32 = 8;
/// Windows hold this many of the longest spans.
const LONGEST_SPAN: usize = 12;
/// Cells into which the samples of a lobe are put: ten per rise time for shapes between a ramp and a raised cosine.
const CELLS_PER_LOBE: u32 = 13;
/// Borders of the cells of one edge at most: nineteen cells of one sample in the longest lobe, thirteen around it.
const MOST_BORDERS: usize = 35;
/// Cells looked at before and after the lobe.
const SIDE_CELLS: u32 = 6;
/// How much steeper a lobe may be than its coarse slope, which rounds kinks, says.
const MAX_STEEPNESS_RATIO: f32 = 1.2;
/// Lobes of fewer samples are not timed but taken as ramps.
const MIN_TIMED_SAMPLES: u32 = 4;
/// Shortest lobe of a resolved edge, spans.
const SHORTEST_LOBE: u32 = 5;

/// Samples whose second differences are taken together, and the share of such runs that are quieter than the noise
/// told.
const RUN: u32 = 32;
const QUIET_RUN_SHARE: f32 = 0.25;
/// How fast a quantile is found, relative per value.
const QUIET_STEP: f32 = 0.15;
/// Mean square of a second difference of white noise over its variance.
const SECOND_DIFFERENCE: f32 = 6.0;
/// Noise over the median height, as told, above which edges are cut short: at a true 1.2 % the median of ten samples
/// per edge is 10 % off (tests).
pub const MOST_NOISE: f32 = 0.0105;

/// Direction of the timed edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Polarity {
    /// Upward only.
    Rising,
    /// Downward only.
    Falling,
    /// The steepest of either direction.
    Either,
}

/// Settings of a [`RiseTime`] estimator.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RiseTimeConfig {
    /// Direction of the edges.
    pub polarity: Polarity,
    /// Edges of lower height are ignored, in the unit of the samples; several times the noise's RMS.
    pub minimum_height: f32,
}

/// One timed edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// 10-90 % duration in samples.
    pub rise_samples: f32,
    /// Height between the two levels, negative for a falling edge.
    pub height: f32,
    /// Greatest slope per sample that decided for this edge.
    steepness: f32,
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
    /// Noise of the samples over the median height, RMS.
    pub noise: f32,
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
    /// The noise would cut edges short.
    Noisy {
        /// Noise over the median height, RMS.
        noise: f32,
    },
}

/// A stretch of one slope sign.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lobe {
    /// 1 upwards, -1 downwards.
    sign: f32,
    /// Greatest slope over the span, and its age in samples.
    peak: f32,
    peak_age: u32,
    /// Samples since it began.
    length: u32,
}

/// Streaming estimator; an edge must be shorter than about 0.4 `WINDOW` samples.
#[derive(Debug, Clone)]
pub struct RiseTime<const WINDOW: usize> {
    config: RiseTimeConfig,
    pitch_samples: f32,
    samples: [f32; WINDOW],
    newest: usize,
    held: usize,
    /// Samples over which slopes are taken.
    span: u32,
    lobe: Lobe,
    best: Option<Edge>,
    pitch_left: f32,
    teeth: [f32; TEETH],
    /// Median height of the edges, followed by small steps; 0 before the first.
    height: f32,
    /// Mean square of the second differences in the quietest quarter of runs, 0 before the first; sum of the run under
    /// way.
    quiet: f32,
    run: (f32, u32),
    counted: u32,
    /// Pitches without an edge.
    empty: u32,
    /// Edges longer than the window, not timed.
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
            span: 1,
            lobe: Lobe { sign: 1.0, peak: 0.0, peak_age: 0, length: 0 },
            best: None,
            pitch_left: pitch_samples,
            teeth: [0.0; TEETH],
            height: 0.0,
            quiet: 0.0,
            run: (0.0, 0),
            counted: 0,
            empty: 0,
            too_long: 0,
        }
    }

    /// New speed or rate: tooth pitch in samples.
    pub fn set_pitch(&mut self, pitch_samples: f32) {
        self.pitch_samples = pitch_samples;
    }

    /// Tells the rise time to be expected (from the law, samples), so that slopes span a fifth of it from the start.
    /// Without it the span starts at one sample and finds its way, slowly if there is much noise.
    pub fn expect(&mut self, rise_samples: f32) {
        self.span = Self::span_for(rise_samples);
    }

    fn span_for(rise_samples: f32) -> u32 {
        ((rise_samples * 0.2) as u32).clamp(1, (WINDOW / LONGEST_SPAN).max(1) as u32)
    }

    /// Forgets samples and edges.
    pub fn reset(&mut self) {
        *self = Self::new(self.config, self.pitch_samples);
    }

    /// Takes one sample; the edge of the tooth when a pitch has just ended with one.
    #[inline]
    pub fn push(&mut self, sample: f32) -> Option<Edge> {
        self.newest = if self.newest + 1 >= WINDOW { 0 } else { self.newest + 1 };
        self.samples[self.newest] = sample;
        self.held = (self.held + 1).min(WINDOW);
        self.follow_noise();
        self.lobe.peak_age = self.lobe.peak_age.saturating_add(1);
        self.lobe.length = self.lobe.length.saturating_add(1);
        if let Some(best) = &mut self.best {
            best.age += 1;
        }
        if self.held > (self.lag() + self.span) as usize {
            self.follow();
        }
        self.pitch_left -= 1.0;
        if self.pitch_left > 0.0 { None } else { self.end_pitch() }
    }

    #[inline]
    fn follow_noise(&mut self) {
        if self.held < 3 {
            return;
        }
        let second = self.back(0) - 2.0 * self.back(1) + self.back(2);
        self.run = (self.run.0 + second * second, self.run.1 + 1);
        if self.run.1 == RUN {
            let square = self.run.0 / RUN as f32;
            self.run = (0.0, 0);
            self.quiet = quantile_step(self.quiet, square, QUIET_RUN_SHARE);
        }
    }

    fn follow(&mut self) {
        let slope = self.slope(self.lag());
        let along = slope * self.lobe.sign;
        if along > self.lobe.peak {
            self.lobe.peak = along;
            self.lobe.peak_age = 0;
        } else if along < SLOPE_THRESHOLD * self.lobe.peak || along <= 0.0 {
            self.end_lobe();
            let sign = if slope < 0.0 { -1.0 } else { 1.0 };
            self.lobe = Lobe { sign, peak: slope.abs(), peak_age: 0, length: 0 };
        }
    }

    #[inline(never)]
    fn end_lobe(&mut self) {
        let wanted = match self.config.polarity {
            Polarity::Rising => self.lobe.sign > 0.0,
            Polarity::Falling => self.lobe.sign < 0.0,
            Polarity::Either => true,
        };
        let steepness = self.lobe.peak / self.span as f32;
        // Lobes too short to be resolved are mostly noise: not worth a second look.
        let possible =
            if self.lobe.length >= SHORTEST_LOBE * self.span { MAX_STEEPNESS_RATIO * steepness } else { steepness };
        // Steepest slope times duration bounds the height: most ripples end here.
        let highest = steepness * (self.lobe.length + 2 * self.span + 2) as f32;
        if !wanted
            || highest < self.config.minimum_height
            || steepness <= 0.0
            || self.best.is_some_and(|best| best.steepness >= possible)
        {
            return;
        }
        let Some(edge) = self.time_edge() else {
            self.too_long = self.too_long.saturating_add(1);
            return;
        };
        if edge.height.abs() >= self.config.minimum_height
            && self.best.is_none_or(|best| edge.steepness > best.steepness)
        {
            self.best = Some(edge);
        }
    }

    #[inline(never)]
    fn end_pitch(&mut self) -> Option<Edge> {
        let edge = self.best.take();
        match edge {
            Some(edge) => {
                self.teeth[self.counted as usize % TEETH] = edge.rise_samples;
                self.height = quantile_step(self.height, edge.height.abs(), 0.5);
                self.counted = self.counted.wrapping_add(1);
                if self.counted.is_multiple_of(ADAPT_EVERY) {
                    self.adapt_span();
                }
                // The next window is centred one pitch after this edge.
                self.pitch_left = (1.5 * self.pitch_samples - edge.age as f32).max(0.5 * self.pitch_samples);
            }
            None => {
                self.pitch_left += self.pitch_samples.max(1.0);
                self.empty = self.empty.wrapping_add(1);
                if self.empty.is_multiple_of(ADAPT_EVERY) {
                    // Noise may cut every edge short: try coarser slopes, then start over.
                    let coarser = 2 * self.span;
                    self.span = if coarser as usize <= WINDOW / LONGEST_SPAN { coarser } else { 1 };
                }
            }
        }
        edge
    }

    fn adapt_span(&mut self) {
        let mut teeth = self.teeth;
        let count = (self.counted as usize).min(TEETH);
        if let Some(median) = math::median(teeth.get_mut(..count).unwrap_or_default()) {
            self.span = Self::span_for(median);
        }
    }

    /// Sample `age` ago.
    #[inline]
    fn back(&self, age: u32) -> f32 {
        let age = age as usize;
        let place = if age <= self.newest { self.newest - age } else { self.newest + WINDOW - age };
        self.samples.get(place).copied().unwrap_or_default()
    }

    /// Rise over the span ending `age` ago; it belongs to `age + span / 2`.
    #[inline]
    fn slope(&self, age: u32) -> f32 {
        self.back(age) - self.back(age + self.span)
    }

    /// Age of the slope that is looked at: the cells that follow an edge must have come before it is timed.
    fn lag(&self) -> u32 {
        3 * self.span + 3
    }

    /// Times the lobe whose slope has just fallen below the third; `None` when it does not fit into the window.
    fn time_edge(&self) -> Option<Edge> {
        let sign = self.lobe.sign;
        let threshold = SLOPE_THRESHOLD * self.lobe.peak;
        let oldest = (self.held as u32).checked_sub(self.span + 1)?;
        let end = self.lag();
        let peak = end.saturating_add(self.lobe.peak_age);
        let mut begin = peak;
        while begin <= oldest && sign * self.slope(begin) >= threshold {
            begin += 1;
        }
        if begin > oldest {
            return None;
        }
        let length = begin - end;
        if length < MIN_TIMED_SAMPLES {
            // Mostly noise, and refused in any case: not worth a shape.
            return Some(Edge {
                rise_samples: 0.8 * length as f32,
                height: self.back(end) - self.back(begin),
                steepness: self.lobe.peak / self.span.max(1) as f32,
                age: end,
            });
        }
        // Slopes belong to the middle of their span; about ten cells per rise time.
        let middle = self.span / 2;
        let cell = ((length + CELLS_PER_LOBE / 2) / CELLS_PER_LOBE).max(1);
        let half = cell / 5;
        let first = (end + middle).saturating_sub(SIDE_CELLS * cell).max(half);
        let held = oldest.saturating_sub(first + half);
        let cells = held.min(begin + middle - first + (SIDE_CELLS + 1) * cell).checked_div(cell)?;
        let scale = self.lobe.peak * cell as f32 / self.span.max(1) as f32;
        let shape = EdgeShape::<MOST_BORDERS>::new(cells as usize, scale, |border| {
            let newest = first + border * cell - half;
            let sum: f32 = (newest..=newest + 2 * half).map(|age| self.back(age)).sum();
            sign * sum / (2 * half + 1) as f32
        });
        let middle = shape.steepest_cell((peak + middle).saturating_sub(first) as f32 / cell as f32);
        // The steepest slope is known when both sides have been seen.
        let mut steepest = 0.0;
        shape.end(middle, true, SLOPE_THRESHOLD, &mut steepest)?;
        let end = shape.end(middle, false, SLOPE_THRESHOLD, &mut steepest)?;
        let begin = shape.end(middle, true, SLOPE_THRESHOLD, &mut steepest)?;
        let height = end.value - begin.value;
        let crossing = |share: f32| shape.crossing(begin, end, begin.value + share * height);
        Some(Edge {
            rise_samples: (crossing(0.1) - crossing(0.9)) * cell as f32,
            height: sign * height,
            steepness: steepest / cell as f32,
            age: first + (end.age * cell as f32) as u32,
        })
    }

    /// Median over the last teeth (at most 64).
    #[inline(never)]
    pub fn result(&self) -> Result<RiseTimeResult, RiseTimeRefusal> {
        let count = (self.counted as usize).min(TEETH);
        let mut teeth = self.teeth;
        let teeth = &mut teeth[..count];
        let Some(median) = math::median(teeth) else {
            return Err(RiseTimeRefusal::NoEdges);
        };
        let noise = if self.height > 0.0 { math::sqrt(self.quiet / SECOND_DIFFERENCE) / self.height } else { 0.0 };
        if median < FEWEST_SAMPLES_PER_EDGE {
            return Err(RiseTimeRefusal::TooCoarse { samples_per_edge: median });
        }
        if noise > MOST_NOISE {
            return Err(RiseTimeRefusal::Noisy { noise });
        }
        for rise in teeth.iter_mut() {
            *rise = (*rise - median).abs();
        }
        let deviation = math::median(teeth).unwrap_or(0.0);
        Ok(RiseTimeResult { samples_per_edge: median, deviation_samples: deviation, count: count as u16, noise })
    }
}

/// One more value for a quantile that is followed by small steps, 0 before the first value: it rests where the share
/// lies below it.
fn quantile_step(quantile: f32, value: f32, share: f32) -> f32 {
    if quantile == 0.0 {
        value
    } else if value < quantile {
        quantile * (1.0 - QUIET_STEP * (1.0 - share))
    } else {
        quantile * (1.0 + QUIET_STEP * share)
    }
}

/// Rise time of the edge behind an instrument: squares subtract (a cascade's rise times add in squares). `None` when
/// the instrument alone would explain the measured one.
pub fn without_instrument(measured: f32, instrument: f32) -> Option<f32> {
    (measured > instrument).then(|| math::sqrt(measured * measured - instrument * instrument))
}
