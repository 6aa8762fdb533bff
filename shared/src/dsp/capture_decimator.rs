//! From the ADC rate to a waveform's: a comb to a few times the wanted rate, then a linear-phase filter to the rate
//! itself.
//!
//! A waveform must be free of aliases in a band that is named: up to [`FLAT_SHARE`] of its rate it is flat, what
//! would fold into that lies 53 dB down at least. The [`crate::mesh_decimator`] keeps 0.27 of its rate clean and
//! knows few ratios; a [`Comb`] of any ratio, ended at three times the wanted rate or more (-70 dB; at twice, -53 dB,
//! where nothing else hits the rate), and a windowed sinc (Blackman, 20 lobes of the wanted rate) behind it reach
//! every product of their two ratios. The comb's droop is undone by three taps that are part of the sinc's.
//!
//! Cost: 7 to 20 instructions per code for the comb and 4 per tap and output. RAM: 1.2 KiB.

use crate::comb::{Comb, HIGHEST_RATIO, MOST_CODES};
use crate::math;

/// Upper edge of the flat band over the output rate.
pub const FLAT_SHARE: f32 = 0.35;
/// Most codes per call.
pub const BATCH: usize = MOST_CODES;
/// Highest ratio of the filter behind the comb.
const MAX_RATIO: usize = 7;
/// Taps on each side, per unit of ratio.
const REACH: usize = 10;
/// Edge at half gain, turns per output sample.
const EDGE: f32 = 0.46;
const TAPS: usize = length(MAX_RATIO);

/// Taps of the filter with those that undo the droop.
const fn length(ratio: usize) -> usize {
    2 * centre(ratio) + 1
}

/// Its middle.
const fn centre(ratio: usize) -> usize {
    REACH * ratio + 1
}

/// Decimator with its memory.
#[derive(Clone, Debug)]
pub struct CaptureDecimator {
    comb: Comb,
    ratio: usize,
    taps: [f32; TAPS],
    held: [f32; TAPS],
    next: usize,
    due: usize,
}

impl CaptureDecimator {
    /// To the rate of the codes itself.
    pub fn new() -> Self {
        let (taps, held) = ([0.0; TAPS], [0.0; TAPS]);
        Self { comb: Comb::new(1), ratio: 1, taps, held, next: 0, due: 1 }
    }

    /// Begins with empty filters towards a rate: the largest ratio that keeps it. `over` is the ADC rate over the
    /// wanted one.
    // Inline: an image compiles it for size then, as it does its own code; it is seldom called.
    #[inline]
    pub fn restart(&mut self, over: f32) {
        let (comb, ratio) = split(over);
        self.comb = Comb::new(comb);
        (self.ratio, self.next, self.due) = (ratio, 0, ratio);
        self.held = [0.0; TAPS];
        let (middle, last) = (centre(ratio), length(ratio) - 1);
        let droop = droop(comb, ratio);
        let (mut before, mut here) = (0.0, 0.0);
        for n in 0..=middle {
            let after = tap_of((middle - n).abs_diff(1) as f32 / ratio as f32);
            let tap = here + droop * (2.0 * here - before - after);
            (before, here) = (here, after);
            for place in [n, last - n] {
                if let Some(place) = self.taps.get_mut(place) {
                    *place = tap;
                }
            }
        }
        let used = self.taps.get_mut(..=last).unwrap_or_default();
        let sum: f32 = used.iter().sum();
        used.iter_mut().for_each(|tap| *tap /= sum);
    }

    /// ADC samples per output.
    pub fn ratio(&self) -> u32 {
        self.comb.ratio() * self.ratio as u32
    }

    /// ADC samples between the instant an output describes and the newest one it needed.
    pub fn delay_samples(&self) -> u32 {
        let filter = if self.ratio == 1 { 0 } else { centre(self.ratio) as u32 };
        self.comb.delay_samples() + self.comb.ratio() * filter
    }

    /// Outputs after the start that still see the zeros before it.
    pub fn settling_outputs(&self) -> u32 {
        (2 * self.delay_samples()).checked_div(self.ratio()).unwrap_or(0) + 2
    }

    /// Filters codes, [`BATCH`] at most; each output, in codes about zero, is handed on.
    pub fn process(&mut self, codes: &[u16], zero: u16, mut output: impl FnMut(f32)) {
        let mut sums = [0.0; BATCH];
        let count = if self.comb.ratio() == 1 {
            for (sum, &code) in sums.iter_mut().zip(codes) {
                *sum = f32::from(code) - f32::from(zero);
            }
            codes.len()
        } else {
            self.comb.process(codes, 1.0, zero, &mut sums)
        };
        let length = length(self.ratio);
        for &sample in sums.iter().take(count) {
            if self.ratio == 1 {
                output(sample);
                continue;
            }
            if let Some(place) = self.held.get_mut(self.next) {
                *place = sample;
            }
            self.next = if self.next + 1 < length { self.next + 1 } else { 0 };
            self.due -= 1;
            if self.due == 0 {
                self.due = self.ratio;
                output(filtered(&self.held, &self.taps, self.next, length));
            }
        }
    }
}

impl Default for CaptureDecimator {
    fn default() -> Self {
        Self::new()
    }
}

/// Ratios of comb and filter that decimate most; of several the shortest filter, but half the rate only where nothing
/// else will do: the comb's aliases lie lower before it.
#[inline]
fn split(over: f32) -> (u32, usize) {
    let mut best = (1, 1);
    let whole = |(comb, ratio): (u32, usize)| comb * ratio as u32;
    for ratio in (3..=MAX_RATIO).chain([2]) {
        let next = (((over / ratio as f32) as u32).min(HIGHEST_RATIO), ratio);
        if whole(next) > whole(best) {
            best = next;
        }
    }
    best
}

/// The filter over a ring of `length` samples whose oldest lies at `oldest`.
#[inline(never)]
fn filtered(held: &[f32], taps: &[f32], oldest: usize, length: usize) -> f32 {
    let parts = held.split_at_checked(length).and_then(|(held, _)| held.split_at_checked(oldest));
    let Some((newer, older)) = parts else { return 0.0 };
    let Some((first, last)) = taps.split_at_checked(older.len()) else { return 0.0 };
    let product = |(sample, tap): (&f32, &f32)| sample * tap;
    let sum: f32 = older.iter().zip(first).map(product).sum();
    sum + newer.iter().zip(last).map(product).sum::<f32>()
}

/// The windowed sinc at a distance from its centre in output samples, unscaled.
#[inline]
fn tap_of(distance: f32) -> f32 {
    use core::f32::consts::PI;
    if distance > REACH as f32 {
        return 0.0;
    }
    let x = 2.0 * PI * EDGE * distance;
    let sinc = if distance == 0.0 { 1.0 } else { math::sin(x) / x };
    let place = PI * distance / REACH as f32;
    sinc * (0.42 + 0.5 * math::cos(place) + 0.08 * math::cos(2.0 * place))
}

/// Weight of the second difference that undoes the comb's droop, exact at the upper edge of the flat band.
#[inline]
fn droop(comb: u32, ratio: usize) -> f32 {
    use core::f32::consts::PI;
    if comb < 2 {
        return 0.0;
    }
    let edge = PI * FLAT_SHARE / ratio as f32;
    let mean = math::sin(edge) / (comb as f32 * math::sin(edge / comb as f32));
    let gain = mean * mean * mean * mean;
    (1.0 / gain - 1.0) / (2.0 - 2.0 * math::cos(2.0 * edge))
}
