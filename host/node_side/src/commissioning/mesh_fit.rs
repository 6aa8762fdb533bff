//! Which mesh frequency a waveform has, against the one that tach wheel and teeth declare.
//!
//! The node's speed is edges over declared pulses, so a wrong wheel puts the mesh line at declared over true pulses
//! times its place, and interchanged teeth (or a tach on the gear's shaft) at the ratio of the teeth. Each candidate
//! is a comb. Its score is the share of the vibration's power in its lines, beyond what as many lines at random would
//! hold, times the share of its lines that are there, up to its last one: a comb too dense has gaps, one too wide
//! leaves power unexplained. The declared one is only given up for a comb that is half as good again.
//!
//! `meshband_analysis::check` asks the same of records: two channels of many turns, whose noise is known bin by bin.
//! A node's waveform has 4096 samples of one channel, too few for that measure.
//!
//! Limits: two errors that make up for each other; a ratio of the teeth that is a ratio of small whole numbers is
//! called by the pulses; modulation as strong as the mesh itself.

use super::ear::Waveform;
use crate::spectral::{Spectrum, Window, amplitude_spectrum};

/// Harmonics of a comb.
const HARMONICS: usize = 8;
/// Most pulses that are tried, times the declared ones; and at least so many.
const MAX_PULSES: (u16, u16) = (4, 64);
/// A line is there from this multiple of the local median on, and from this share of the comb's strongest on: a
/// window leaks beyond its lines.
const MIN_LINE_RATIOS: (f64, f64) = (4.0, 0.02);
/// Half a line's width: bins of the window, and share of its frequency that the speed is uncertain by.
const HALF_WIDTH: (f64, f64) = (2.0, 0.002);
/// Fewest bins between two lines of a comb.
const FEWEST_BINS: f64 = 10.0;
/// Least score that is a mesh line at all.
const MIN_SCORE: f64 = 0.15;
/// A comb has to be better than the declared one by this ratio.
const MIN_SCORE_RATIO: f64 = 1.5;
/// Two combs are the same within this ratio.
const SAME_COMB_SHARE: f64 = 0.004;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// The mesh line lies where it should.
    Declared {
        /// Its frequency at the first waveform, Hz.
        line_hz: f64,
        /// Share of the vibration's power in it and its harmonics.
        explained: f64,
    },
    /// No comb stands out.
    Nothing,
    /// Another number of pulses per turn fits.
    Pulses {
        /// That number.
        fits: u16,
        /// The line's frequency at the first waveform, Hz.
        line_hz: f64,
    },
    /// The other gear's teeth fit.
    Interchanged {
        /// The line's frequency at the first waveform, Hz.
        line_hz: f64,
    },
}

/// Looks for the comb that explains the waveforms.
pub fn fit(waveforms: &[Waveform], [pinion, gear]: [u16; 2], pulses: u16) -> Fit {
    let seen: Vec<(Spectrum, f64)> = waveforms
        .iter()
        .filter(|waveform| waveform.speed_hz > 0.0)
        .map(|waveform| {
            let spectrum = amplitude_spectrum(&waveform.samples, waveform.rate_hz, Window::Hann);
            (spectrum, f64::from(pinion) * waveform.speed_hz)
        })
        .collect();
    let Some(&(_, line_hz)) = seen.first() else { return Fit::Nothing };
    let score = |factor: f64| {
        let all: f64 = seen.iter().map(|(spectrum, mesh_hz)| comb(spectrum, factor * mesh_hz).0).sum();
        all / seen.len() as f64
    };
    let declared = score(1.0);
    let most = MAX_PULSES.1.max(MAX_PULSES.0.saturating_mul(pulses));
    let swap = f64::from(gear) / f64::from(pinion);
    let wheels = (1..=most).filter(|&fits| fits != pulses).map(|fits| {
        let factor = f64::from(pulses) / f64::from(fits);
        (factor, Fit::Pulses { fits, line_hz: factor * line_hz })
    });
    let interchanged = (swap, Fit::Interchanged { line_hz: swap * line_hz });
    let others =
        wheels.chain(std::iter::once(interchanged)).filter(|(factor, _)| (factor - 1.0).abs() > SAME_COMB_SHARE);
    let best = others.map(|(factor, what)| (score(factor), what)).max_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((other, what)) if other > MIN_SCORE && other > MIN_SCORE_RATIO * declared => what,
        _ if declared > MIN_SCORE => Fit::Declared { line_hz, explained: comb(&seen[0].0, line_hz).1 },
        _ => Fit::Nothing,
    }
}

/// Score of a comb with this spacing, and the share of the power that it explains.
fn comb(spectrum: &Spectrum, spacing_hz: f64) -> (f64, f64) {
    let bin = spectrum.bin;
    let end_hz = bin * (spectrum.values.len() as f64 - 1.0);
    let lines = ((end_hz / spacing_hz).floor() as usize).min(HARMONICS);
    if spacing_hz < FEWEST_BINS * bin || lines == 0 {
        return (0.0, 0.0);
    }
    let power = |from: usize, to: usize| spectrum.values[from..=to].iter().map(|a| a * a).sum::<f64>();
    let last = spectrum.values.len() - 1;
    // Below the first bins lies what the window makes of the mean.
    let all = power(3.min(last), last);
    let (mut held, mut bins, mut peaks) = (0.0, 0usize, Vec::new());
    for harmonic in 1..=lines {
        let at_hz = harmonic as f64 * spacing_hz;
        let half = HALF_WIDTH.0 * bin + HALF_WIDTH.1 * at_hz;
        let from = (((at_hz - half) / bin).round().max(0.0) as usize).min(last);
        let to = (((at_hz + half) / bin).round() as usize).min(last);
        let floor = spectrum.median_between(at_hz - spacing_hz / 2.0, at_hz + spacing_hz / 2.0);
        let peak = spectrum.values[from..=to].iter().copied().fold(0.0, f64::max);
        peaks.push((peak, floor));
        held += power(from, to);
        bins += to - from + 1;
    }
    if all <= 0.0 {
        return (0.0, 0.0);
    }
    let strongest = peaks.iter().map(|(peak, _)| *peak).fold(0.0, f64::max);
    let is_there =
        |&(peak, floor): &(f64, f64)| peak > MIN_LINE_RATIOS.0 * floor && peak > MIN_LINE_RATIOS.1 * strongest;
    let there: Vec<bool> = peaks.iter().map(is_there).collect();
    // Harmonics end somewhere; a comb that is too dense has gaps before its last line.
    let reach = there.iter().rposition(|&is| is).map_or(0, |last| last + 1);
    let unbroken = there.iter().filter(|&&is| is).count() as f64 / reach.max(1) as f64;
    let (explained, by_chance) = (held / all, bins as f64 / (last + 1) as f64);
    let beyond = ((explained - by_chance) / (1.0 - by_chance)).max(0.0);
    (beyond * unbroken, explained)
}
