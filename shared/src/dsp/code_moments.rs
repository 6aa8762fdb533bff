//! Moments of the converter's codes over a stretch of time: mean, RMS, peak, kurtosis of everything the converter saw.
//!
//! At the ADC's own rate, because only that band does not depend on the speed: a value that is compared over weeks
//! must not change because the law asked for another rate. Codes are weighted with their period, so a record goes on
//! over a change of the rate. Sums of powers are taken about a fixed code near the mean (the former record's mean),
//! in single precision over runs of 64 and in double precision over the record: relative error below 1e-6 for the
//! RMS, 1e-5 for the kurtosis.
//!
//! Cost (Cortex-M4F): about 24 instructions per code taken.

use crate::config::CodeRange;
use crate::math;

/// Codes summed in single precision.
const RUN: usize = 64;
/// Sums under way.
#[derive(Clone, Copy, Debug)]
pub struct CodeMoments {
    /// Code about which the powers are summed.
    centre: u16,
    /// Duration, ticks.
    duration: f64,
    /// Duration that the sums stand for, ticks.
    weight: f64,
    /// Weighted sums of the first four powers.
    sums: [f64; 4],
    lowest: u16,
    highest: u16,
    codes: u32,
    railed: u32,
    /// What is not clipped, in force.
    range: CodeRange,
    /// Draws places within a step.
    draw: u32,
}

/// What a record of codes comes to, in codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CodeValues {
    /// Arithmetic mean.
    pub mean: f32,
    /// Root mean square about the mean.
    pub rms: f32,
    /// Largest distance from the mean.
    pub peak: f32,
    /// m4 / m2^2; 0 for a constant.
    pub kurtosis: f32,
    /// Codes clipped.
    pub railed: u32,
    /// Codes in all.
    pub codes: u32,
}

impl CodeValues {
    /// Peak over RMS; 0 for a constant.
    pub fn crest(&self) -> f32 {
        if self.rms > 0.0 { self.peak / self.rms } else { 0.0 }
    }
}

impl CodeMoments {
    /// Nothing yet; `centre` is the code that the mean is expected at, `range` what is not clipped, in force.
    pub const fn about(centre: u16, range: CodeRange) -> Self {
        let (duration, weight, sums) = (0.0, 0.0, [0.0; 4]);
        Self { centre, duration, weight, sums, lowest: u16::MAX, highest: 0, codes: 0, railed: 0, range, draw: 1 }
    }

    /// Duration of what was added, ticks.
    pub fn ticks(&self) -> f64 {
        self.duration
    }

    /// Adds codes that were taken with a period, of each `step` of them (at least 1) one: which one is drawn, because
    /// every `step`-th would be a strobe on what repeats with it.
    pub fn add(&mut self, codes: &[u16], period_ticks: u32, step: usize) {
        let step = step.max(1);
        let mut sums = [0.0f64; 4];
        for run in codes.chunks(RUN.saturating_mul(step).max(1)) {
            let powers = self.powers(run, step);
            for (sum, power) in sums.iter_mut().zip(powers) {
                *sum += f64::from(power);
            }
        }
        let taken = codes.len().div_ceil(step);
        let period = f64::from(period_ticks);
        // Each that enters stands for a whole step, so that a record goes on over a change of the step.
        let each = period * step as f64;
        for (sum, part) in self.sums.iter_mut().zip(sums) {
            *sum += each * part;
        }
        self.duration += period * codes.len() as f64;
        self.weight += each * taken as f64;
        self.codes = self.codes.saturating_add(taken as u32);
    }

    /// Sums of the powers of one run; notes extremes and rails.
    fn powers(&mut self, run: &[u16], step: usize) -> [f32; 4] {
        let (centre, range) = (i32::from(self.centre), self.range);
        let (mut lowest, mut highest) = (self.lowest, self.highest);
        let (mut first, mut railed) = (0i32, 0u32);
        let mut powers = [0.0f32; 3];
        let mut take = |code: u16| {
            // Comparisons, not min and max: those are library calls on the node.
            if code < lowest {
                lowest = code;
            }
            if code > highest {
                highest = code;
            }
            railed += u32::from(range.is_beyond(code));
            let offset = i32::from(code) - centre;
            first += offset;
            let x = offset as f32;
            let square = x * x;
            powers[0] += square;
            powers[1] += square * x;
            powers[2] += square * square;
        };
        let mut draw = self.draw;
        if step == 1 {
            run.iter().for_each(|&code| take(code));
        } else {
            for group in run.chunks(step) {
                // Numerical Recipes' generator; its upper bits.
                draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                if let Some(&code) = group.get(((draw >> 16) as usize * group.len()) >> 16) {
                    take(code);
                }
            }
        }
        (self.lowest, self.highest, self.draw) = (lowest, highest, draw);
        self.railed = self.railed.saturating_add(railed);
        [first as f32, powers[0], powers[1], powers[2]]
    }

    /// Values of what was added; `None` while there is nothing.
    pub fn values(&self) -> Option<CodeValues> {
        if self.weight <= 0.0 {
            return None;
        }
        let [a, b, c, d] = self.sums.map(|sum| sum / self.weight);
        let m2 = (b - a * a).max(0.0);
        let m4 = d - 4.0 * a * c + 6.0 * a * a * b - 3.0 * a * a * a * a;
        let mean = f64::from(self.centre) + a;
        let peak = (f64::from(self.highest) - mean).max(mean - f64::from(self.lowest));
        Some(CodeValues {
            mean: mean as f32,
            rms: math::sqrt(m2 as f32),
            peak: peak as f32,
            kurtosis: if m2 > 0.0 { (m4 / (m2 * m2)) as f32 } else { 0.0 },
            railed: self.railed,
            codes: self.codes,
        })
    }

    /// The next record, about this one's mean.
    pub fn next(&self) -> Self {
        let centre = self.values().map_or(self.centre, |values| (values.mean + 0.5) as u16);
        Self { draw: self.draw, ..Self::about(centre, self.range) }
    }
}
