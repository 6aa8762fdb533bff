//! The way from the bearings to the sensors: modes of the housing, shared poles with residues of every channel.
//!
//! Acceleration of channel c: `sum over modes m and forces s of R[c][m][s] H_m(f) F_s(f)`,
//! `H = -f^2 / (f_m^2 - f^2 + 2 i zeta f f_m)`: the accelerance of a mode, which passes nothing at rest. Forces are
//! those of the bearings on the housing, so that what the bodies do in their bearings is in them; the housing does
//! not act back on the gears (the `casing` model has one that does). Applied in the frequency domain over the whole
//! run; the run begins early enough for the wrap-around to decay before the first sample kept.

use super::declaration::{Field, Mode};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64;
use serde::Serialize;
use std::f64::consts::TAU;

/// Time constants of the slowest mode that pass before the first sample, and the bounds of that time, s.
const LEAD_TIME_CONSTANTS: f64 = 8.0;
const LEAD_S: [f64; 2] = [0.2, 2.0];

/// Modes and residues of a housing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Paths {
    /// Frequency, Hz, and damping ratio of every mode.
    pub poles: Vec<[f64; 2]>,
    /// Per channel and mode, 1/kg: along pinion and gear, across pinion and gear.
    pub residues_per_kg: Vec<Vec<[f64; 4]>>,
}

impl Paths {
    /// Given or drawn ones.
    pub fn drawn(field: &Field, random: &mut ChaCha12Rng) -> Self {
        let modes = if field.mode.is_empty() { drawn_modes(field, random) } else { field.mode.clone() };
        let mut residue = || {
            let normal: f64 = StandardNormal.sample(random);
            normal / field.housing.mass_kg
        };
        let mut residues = || modes.iter().map(|_| std::array::from_fn(|_| residue())).collect();
        // Drawn for every channel, so that giving those of one leaves the others as they were.
        let drawn: Vec<Vec<[f64; 4]>> = field.channel.iter().map(|_| residues()).collect();
        let own = field.channel.iter().zip(drawn).map(|(c, drawn)| c.residues_per_kg.clone().unwrap_or(drawn));
        let residues_per_kg = own.collect();
        Self { poles: modes.iter().map(|m| [m.frequency_hz, m.damping]).collect(), residues_per_kg }
    }

    /// Time before the first sample that is simulated and thrown away, s.
    pub fn lead_s(&self) -> f64 {
        let slowest = self.poles.iter().map(|[hz, damping]| TAU * hz * damping).fold(f64::INFINITY, f64::min);
        (LEAD_TIME_CONSTANTS / slowest).clamp(LEAD_S[0], LEAD_S[1])
    }

    /// Accelerations, m/s2, of all channels under `forces`, N, in the order of the residues.
    pub fn accelerations(&self, mut forces: Vec<Vec<f64>>, rate_hz: f64) -> Vec<Vec<f64>> {
        let total = forces[0].len();
        let mut planner = RealFftPlanner::<f64>::new();
        let (forward, inverse) = (planner.plan_fft_forward(total), planner.plan_fft_inverse(total));
        let spectra: Vec<Vec<Complex64>> = forces
            .iter_mut()
            .map(|force| {
                let mean = force.iter().sum::<f64>() / total as f64;
                force.iter_mut().for_each(|x| *x -= mean);
                let mut spectrum = forward.make_output_vec();
                forward.process(force, &mut spectrum).expect("matching lengths");
                spectrum
            })
            .collect();
        drop(forces);
        let channel = |residues: &Vec<[f64; 4]>| {
            let bin_hz = rate_hz / total as f64;
            let mut spectrum: Vec<Complex64> =
                (0..spectra[0].len()).map(|i| self.response(residues, &spectra, i, bin_hz) / total as f64).collect();
            // A real signal has real ends of its spectrum.
            spectrum[0].im = 0.0;
            if let Some(last) = spectrum.last_mut() {
                last.im = 0.0;
            }
            let mut signal = inverse.make_output_vec();
            inverse.process(&mut spectrum, &mut signal).expect("matching lengths");
            signal
        };
        self.residues_per_kg.iter().map(channel).collect()
    }

    /// Response of one channel at bin `i`.
    fn response(&self, residues: &[[f64; 4]], spectra: &[Vec<Complex64>], i: usize, bin_hz: f64) -> Complex64 {
        let hz = i as f64 * bin_hz;
        let of_mode = |(residue, [own_hz, damping]): (&[f64; 4], &[f64; 2])| {
            let drive: Complex64 = residue.iter().zip(spectra).map(|(r, force)| *r * force[i]).sum();
            drive * (-hz * hz) / Complex64::new(own_hz * own_hz - hz * hz, 2.0 * damping * hz * own_hz)
        };
        residues.iter().zip(&self.poles).map(of_mode).sum()
    }
}

fn drawn_modes(field: &Field, random: &mut ChaCha12Rng) -> Vec<Mode> {
    let mut evenly = |[low, high]: [f64; 2]| low * (high / low).powf(rand::RngExt::random::<f64>(random));
    let mut modes: Vec<Mode> = (0..field.housing.modes)
        .map(|_| Mode { frequency_hz: evenly(field.housing.band_hz), damping: evenly(field.housing.damping) })
        .collect();
    modes.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    modes
}
