//! The strongest lines of a wideband record, each with the mesh harmonic that explains it.
//!
//! Cost (4096 points): a Blackman-Harris window, one real FFT and a search, about 0.7 M instructions; a few records per
//! second are analysed, not all. The three steps can be taken one by one, so that blocks are taken in between.

use crate::alias::{self, Origin};
use crate::frame::CRC32;
use crate::math;
use crate::message::{LineOrigin, MAX_PEAKS, SpectralLine};
use crate::spectrum::{highest_near, mean, read_line};
use crate::stream::WIDE_POINTS;
use crate::window::Window;
use heapless::Vec;

const WINDOW: Window = Window::BlackmanHarris;
/// Bins searched to each side of an expected line.
const REACH: usize = 3;
/// Highest harmonic tried as an explanation.
const HIGHEST_HARMONIC: u32 = 512;
/// Distance at which a harmonic explains a line, bins.
const TOLERANCE_BINS: f32 = 0.5;
/// Share of the rate above which half-band decimation lets nothing through.
const STOP_SHARE: f32 = 1.0 - 1.0 / 2.56;

/// Lines found, strongest first, and the digest of the spectrum.
pub type Found = (Vec<SpectralLine, MAX_PEAKS>, u32);

/// The strongest lines of a record and the digest of its spectrum; destroys the record.
pub fn strongest(record: &mut [f32; WIDE_POINTS], spacing_hz: f32) -> Found {
    window(record);
    transform(record);
    search(record, spacing_hz)
}

/// First step: the record without its mean, under the window.
pub fn window(record: &mut [f32; WIDE_POINTS]) {
    let offset = mean(&record[..]);
    WINDOW.apply(&mut record[..], offset);
}

/// Second step: the record's spectrum in its place, real and imaginary parts in turns, without the line at half the
/// rate.
pub fn transform(record: &mut [f32; WIDE_POINTS]) {
    microfft::real::rfft_4096(record)[0].im = 0.0;
}

/// Third step: the strongest lines of a spectrum and its digest.
pub fn search(spectrum: &[f32; WIDE_POINTS], spacing_hz: f32) -> Found {
    let digest = digest(spectrum);
    let (bins, _) = spectrum.as_chunks::<2>();
    let scale = 2.0 / (WIDE_POINTS as f32 * WINDOW.coherent_gain());
    let mut strongest: Vec<(f32, usize), MAX_PEAKS> = Vec::new();
    let power = |k: usize| bins.get(k).map_or(0.0, power_of);
    for k in 4..bins.len() - 1 {
        let here = power(k);
        if strongest.last().is_some_and(|&(least, _)| strongest.is_full() && here <= least) {
            continue;
        }
        let highest = (1..=4).all(|d| here > power(k - d) && here >= power(k + d));
        if !highest {
            continue;
        }
        let place = strongest.iter().position(|&(other, _)| here > other).unwrap_or(strongest.len());
        if strongest.is_full() && place < MAX_PEAKS {
            strongest.pop();
        }
        let _ = strongest.insert(place, (here, k));
    }
    let lines =
        strongest.iter().filter_map(|&(_, k)| line_near(bins, scale, spacing_hz, k as f32 * spacing_hz)).collect();
    (lines, digest)
}

/// What the mesh harmonics say about lines of a record at `rate_hz`. What reaches the record above half its rate ends
/// at `reach_hz`: the analogue filter's stop edge without decimation.
pub fn label(
    lines: &[SpectralLine],
    mesh_hz: f32,
    rate_hz: f32,
    spacing_hz: f32,
    reach_hz: f32,
) -> Vec<LineOrigin, MAX_PEAKS> {
    let highest = ((reach_hz / mesh_hz) as u32).min(HIGHEST_HARMONIC);
    let origin = |line: &SpectralLine| {
        let small = |harmonic: u32| harmonic.min(u32::from(u16::MAX)) as u16;
        match alias::explain(line.frequency_hz, mesh_hz, rate_hz, TOLERANCE_BINS * spacing_hz, highest) {
            Origin::Genuine(found) => LineOrigin::Mesh { harmonic: small(found.harmonic) },
            Origin::Folded(found) => LineOrigin::Folded { harmonic: small(found.harmonic) },
            Origin::Unexplained => LineOrigin::Unexplained,
        }
    };
    lines.iter().map(origin).collect()
}

/// Highest frequency that may have reached a record.
pub fn reach_hz(rate_hz: f32, stages: u8, analogue_stop_hz: f32) -> f32 {
    if stages == 0 { analogue_stop_hz } else { (rate_hz * STOP_SHARE).min(analogue_stop_hz) }
}

fn power_of([re, im]: &[f32; 2]) -> f32 {
    re * re + im * im
}

fn line_near(bins: &[[f32; 2]], scale: f32, spacing_hz: f32, expected_hz: f32) -> Option<SpectralLine> {
    let centre = (expected_hz / spacing_hz + 0.5) as usize;
    let first = centre.checked_sub(REACH + 1)?;
    let around = bins.get(first..=centre + REACH + 1)?;
    let mut amplitudes = [0.0f32; 2 * REACH + 3];
    for (amplitude, bin) in amplitudes.iter_mut().zip(around) {
        *amplitude = scale * math::sqrt(power_of(bin));
    }
    let peak = highest_near(&amplitudes, REACH + 1, REACH)?;
    let line = read_line(&amplitudes, peak, WINDOW)?;
    Some(SpectralLine { frequency_hz: (first as f32 + line.bin) * spacing_hz, amplitude: line.amplitude })
}

fn digest(spectrum: &[f32]) -> u32 {
    let mut sum = CRC32.digest();
    spectrum.iter().for_each(|part| sum.update(&part.to_bits().to_le_bytes()));
    sum.finalize()
}
