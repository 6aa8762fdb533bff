//! Channels against each other: two clocks in one run.
//!
//! What two channels share has in every frame and at every frequency the phase of its paths, which stays; a clock
//! that is faster by a share d turns it by 2 pi f d t. The share is the one that makes the cross-spectra of all
//! frames agree best, each line with a phase of its own. The speed may wander. Limit: channels that share nothing
//! say nothing. Cost: a transform per frame and channel.

use super::thresholds::{
    CLOCK_COHERENCE, COMPARED_LINES, FRAME_S, LEAST_DRIFT, LEAST_FRAMES, MAX_CLOCK_OFFSET_SHARE, MIN_COHERENCE_GAIN,
};
use super::{Kind, Remark};
use crate::spectral::{self, Window};
use crate::text;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Steps per cycle of drift of the highest line.
const STEPS: f64 = 4.0;
/// Most frames: longer runs have longer ones.
const MOST_FRAMES: usize = 200;

/// Spectra of one channel, frame by frame.
struct Frames {
    spectra: Vec<Vec<C>>,
    hop_s: f64,
    bin_hz: f64,
}

/// A remark for every channel whose clock differs from the first one's.
pub fn remarks(names: &[String], channels: &[Vec<f64>], rate_hz: f64) -> Vec<Remark> {
    let Some((reference, others)) = channels.split_first().filter(|(_, others)| !others.is_empty()) else {
        return Vec::new();
    };
    let Some(reference) = Frames::of(reference, rate_hz) else { return Vec::new() };
    let one = |(c, channel): (usize, &Vec<f64>)| {
        let share = clock(&reference, &Frames::of(channel, rate_hz)?)?;
        let text = format!(
            "channel {} ({}) runs {:+.1} ppm against channel 1 ({}): two clocks, so pulses and angle of one do not \
              hold for the other; import each with its own tach",
            c + 2,
            text::name(&names[c + 1]),
            1e6 * share,
            text::name(&names[0])
        );
        Some(Remark::new(Kind::Clock, Some(c + 1), text))
    };
    others.iter().enumerate().filter_map(one).collect()
}

impl Frames {
    fn of(signal: &[f64], rate_hz: f64) -> Option<Self> {
        let length = (FRAME_S * rate_hz).max(2.0 * signal.len() as f64 / MOST_FRAMES as f64).max(64.0);
        let length = (length as usize).next_power_of_two();
        let hop = length / 2;
        let count = (signal.len().checked_sub(length)?) / hop + 1;
        if count < LEAST_FRAMES {
            return None;
        }
        let weights = Window::Hann.weights(length);
        let fft = spectral::forward(length);
        let mean = signal.iter().sum::<f64>() / signal.len() as f64;
        let spectrum = |m: usize| {
            let frame = &signal[m * hop..m * hop + length];
            let mut input: Vec<f64> = frame.iter().zip(&weights).map(|(x, w)| (x - mean) * w).collect();
            let mut output = fft.make_output_vec();
            fft.process(&mut input, &mut output).ok().map(|()| output)
        };
        let spectra = (0..count).map(spectrum).collect::<Option<Vec<_>>>()?;
        Some(Self { spectra, hop_s: hop as f64 / rate_hz, bin_hz: rate_hz / length as f64 })
    }
}

/// By how much the second channel's clock is faster, as a share; `None` where they agree or share too little.
fn clock(a: &Frames, b: &Frames) -> Option<f64> {
    let frames = a.spectra.len().min(b.spectra.len());
    let cross = |bin: usize| (0..frames).map(move |m| b.spectra[m][bin] * a.spectra[m][bin].conj());
    let mut bins: Vec<(f64, usize)> = (2..a.spectra[0].len() - 1)
        .map(|bin| (cross(bin).map(|c| c.norm()).sum::<f64>(), bin))
        .filter(|(sum, _)| *sum > 0.0)
        .collect();
    bins.sort_by(|x, y| y.0.total_cmp(&x.0));
    bins.truncate(COMPARED_LINES);
    let highest_hz = bins.iter().map(|(_, bin)| *bin as f64 * a.bin_hz).fold(0.0, f64::max);
    let lines: Vec<(f64, f64, Vec<C>)> = bins
        .iter()
        // Every line counts by the root of its power: one strong low line does not decide.
        .map(|&(sum, bin)| (sum.sqrt() / sum, bin as f64 * a.bin_hz, cross(bin).collect()))
        .collect();
    let whole: f64 = bins.iter().map(|(sum, _)| sum.sqrt()).sum();
    let coherence = |share: f64| {
        let of = |(weight, hz, values): &(f64, f64, Vec<C>)| {
            let turn = C::cis(-TAU * hz * share * a.hop_s);
            let (mut phasor, mut sum) = (C::ONE, C::ZERO);
            for value in values {
                sum += value * phasor;
                phasor *= turn;
            }
            weight * sum.norm()
        };
        lines.iter().map(of).sum::<f64>() / whole
    };
    let length_s = frames as f64 * a.hop_s;
    let step = 1.0 / (STEPS * highest_hz * length_s);
    let count = (MAX_CLOCK_OFFSET_SHARE / step).ceil() as i64;
    let (at, best) = (-count..=count).map(|i| (i, coherence(i as f64 * step))).max_by(|x, y| x.1.total_cmp(&y.1))?;
    let (before, behind) = (coherence((at - 1) as f64 * step), coherence((at + 1) as f64 * step));
    let curve = before - 2.0 * best + behind;
    let fine = if curve < 0.0 { (0.5 * (before - behind) / curve).clamp(-0.5, 0.5) } else { 0.0 };
    let share = (at as f64 + fine) * step;
    let clear = best >= CLOCK_COHERENCE && best >= coherence(0.0) + MIN_COHERENCE_GAIN;
    // A later sample of the same event lies behind: the phase falls where the other clock is fast.
    (clear && (share * length_s * highest_hz).abs() >= LEAST_DRIFT).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        }
    }

    /// A mesh with harmonics at a wandering speed, as a clock that is faster by `share` reads it; 8 s at 4 kHz.
    fn channel(share: f64, phase: f64, seed: u64) -> Vec<f64> {
        let mut draw = noise(seed);
        (0..32_000)
            .map(|i| {
                let t = f64::from(i) / 4000.0 * (1.0 + share);
                let turns = 25.0 * t + 0.04 * (1.0 - (3.0 * t).cos());
                let mesh = |h: f64| (TAU * 20.0 * h * turns + phase * h * h).cos() / h;
                mesh(1.0) + mesh(2.0) + mesh(3.0) + draw()
            })
            .collect()
    }

    #[test]
    fn theory_two_clocks_are_told_to_a_few_ppm_and_one_is_not() {
        let names = ["a".to_string(), "b".to_string()];
        for ppm in [200.0, -60.0, 120.0] {
            let channels = [channel(0.0, 0.3, 1), channel(1e-6 * ppm, 1.1, 2)];
            let frames = channels.each_ref().map(|c| Frames::of(c, 4000.0).expect("frames"));
            let found = clock(&frames[0], &frames[1]).expect("a clock");
            assert!((1e6 * found - ppm).abs() < 8.0, "{} for {ppm}", 1e6 * found);
            assert_eq!(remarks(&names, &channels, 4000.0).len(), 1);
        }
        assert!(remarks(&names, &[channel(0.0, 0.3, 1), channel(0.0, 1.1, 2)], 4000.0).is_empty());
        let mut draw = noise(7);
        let alone: Vec<f64> = (0..32_000).map(|_| draw()).collect();
        assert!(remarks(&names, &[channel(0.0, 0.3, 1), alone], 4000.0).is_empty());
    }
}
