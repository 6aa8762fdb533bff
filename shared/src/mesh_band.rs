//! Mesh bands from one real FFT at the lowest rate that carries the harmonics, and peaks of the wideband record.
//!
//! The rate lies between 2.56 and 5.12 times the highest sideband, so [`POINTS`] samples resolve f_shaft/8 up to
//! order 200 at worst and order 400 at best. Blackman-Harris windows keep neighbouring sidebands apart by 92 dB; lines
//! are read between bins with the window's known response.

use crate::config::{Configuration, MAX_HARMONICS};
use crate::decimate::MAX_STAGES;
use crate::frame::CRC32;
use crate::math;
use crate::message::{MAX_PEAKS, MeshBand, SpectralLine};
use crate::rate_plan::USABLE_SHARE;
use crate::spectrum::{highest_near, mean, read_line};
use crate::units::Hertz;
use crate::window::Window;
use heapless::Vec;
use microfft::Complex32;

/// Samples of a mesh-band record.
pub const POINTS: usize = 8192;

const WINDOW: Window = Window::BlackmanHarris;
/// Bins searched to each side of an expected line.
const REACH: usize = 3;

/// Second decimation, from the law's rate to the mesh bands'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshPlan {
    /// Half-band stages after the law's rate.
    pub stages: u8,
}

impl MeshPlan {
    /// Most stages that leave the highest sideband of the highest harmonic in the usable band.
    pub fn new(config: &Configuration, pinion: Hertz, rate: Hertz) -> Self {
        let orders = f32::from(config.mesh.harmonics) * f32::from(config.gears.pinion_teeth)
            + f32::from(config.mesh.sidebands)
            + 1.0;
        let highest = orders * pinion.0;
        let mut stages = 0;
        let mut rate = rate.0;
        while highest > 0.0 && stages < MAX_STAGES as u8 && 0.5 * rate * USABLE_SHARE >= highest {
            rate *= 0.5;
            stages += 1;
        }
        Self { stages }
    }
}

/// Reads harmonics and sidebands; destroys the record. Harmonics beyond half the rate are left out.
pub fn bands(
    record: &mut [f32; POINTS],
    spacing_hz: f32,
    config: &Configuration,
    pinion_hz: f32,
) -> (Vec<MeshBand, MAX_HARMONICS>, u32) {
    let offset = mean(&record[..]);
    WINDOW.apply(&mut record[..], offset);
    let bins = microfft::real::rfft_8192(record);
    bins[0].im = 0.0;
    let digest = digest(bins);
    let scale = 2.0 / (POINTS as f32 * WINDOW.coherent_gain());
    let mesh_hz = f32::from(config.gears.pinion_teeth) * pinion_hz;
    let mut found = Vec::new();
    for harmonic in 1..=config.mesh.harmonics {
        let centre = mesh_hz * f32::from(harmonic);
        let mut band = MeshBand { harmonic, ..MeshBand::default() };
        let Some(line) = line_near(bins, scale, spacing_hz, centre) else { break };
        band.line = line;
        let pairs = i16::from(config.mesh.sidebands);
        for sideband in (-pairs..=pairs).filter(|&order| order != 0) {
            let expected = centre + f32::from(sideband) * pinion_hz;
            let line = line_near(bins, scale, spacing_hz, expected).unwrap_or_default();
            // Capacity is MAX_SIDEBANDS pairs, which validation bounds.
            let _ = band.sidebands.push(line);
        }
        if found.push(band).is_err() {
            break;
        }
    }
    (found, digest)
}

/// The strongest lines of a record; destroys it.
pub fn peaks(record: &mut [f32; 4096], spacing_hz: f32) -> (Vec<SpectralLine, MAX_PEAKS>, u32) {
    let offset = mean(&record[..]);
    WINDOW.apply(&mut record[..], offset);
    let bins = microfft::real::rfft_4096(record);
    bins[0].im = 0.0;
    let digest = digest(bins);
    let scale = 2.0 / (4096.0 * WINDOW.coherent_gain());
    let mut strongest: Vec<(f32, usize), MAX_PEAKS> = Vec::new();
    let power = |k: usize| bins.get(k).map_or(0.0, |bin| bin.norm_sqr());
    for k in 4..bins.len() - 1 {
        let here = power(k);
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

fn line_near(bins: &[Complex32], scale: f32, spacing_hz: f32, expected_hz: f32) -> Option<SpectralLine> {
    let centre = (expected_hz / spacing_hz + 0.5) as usize;
    let first = centre.checked_sub(REACH + 1)?;
    let around = bins.get(first..=centre + REACH + 1)?;
    let mut amplitudes = [0.0f32; 2 * REACH + 3];
    for (amplitude, bin) in amplitudes.iter_mut().zip(around) {
        *amplitude = scale * math::sqrt(bin.norm_sqr());
    }
    let peak = highest_near(&amplitudes, REACH + 1, REACH)?;
    let line = read_line(&amplitudes, peak, WINDOW)?;
    Some(SpectralLine { frequency_hz: (first as f32 + line.bin) * spacing_hz, amplitude: line.amplitude })
}

fn digest(bins: &[Complex32]) -> u32 {
    let mut sum = CRC32.digest();
    for bin in bins {
        sum.update(&bin.re.to_bits().to_le_bytes());
        sum.update(&bin.im.to_bits().to_le_bytes());
    }
    sum.finalize()
}
