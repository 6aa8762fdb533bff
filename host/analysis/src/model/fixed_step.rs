//! The declared machine with the workbench's effects, integrated in fixed steps: many short simulations of a
//! table-driven mesh.
//!
//! The Taylor solver stops at every row of a stiffness table, 1300 times per mesh period with 800 rows: 10 s for a
//! run of 2 s with an eccentricity. Here classical Runge-Kutta steps have their nodes filled block by block
//! (`stepped_mesh`), and up to four runs are stepped side by side (`stepped_bodies`). The equations are the harmonic
//! balance's (rotations of four bodies, two translations along the line of action); what acts across that line is
//! left out, as nothing of it reaches the channels. Decimation by a linear-phase Kaiser filter flat to 15 kHz, delay
//! removed. Cost: about 0.1 s per run of 2 s, half of it the effects' own. Limits: linear contact, constant nominal
//! speed; a jump of an effect lies within half a step (2.5 us) of its place: 2 % of the response to friction, 0.8 %
//! of an eccentricity's, whose contacts begin at other moments; others agree with the Taylor solver to 0.3 %.

use super::harmonic_balance::Machine;
use super::poles::Poles;
use super::stepped_bodies::Bodies;
pub use super::stepped_mesh::Point;
use super::stepped_mesh::SteppedMesh;
use crate::dynamics::excitation::Effect;
use crate::dynamics::series::Series;
use crate::lanes::{LANES, Lane, Several};
use crate::spectral::bessel_i0;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Least rate of the integration, Hz.
const LEAST_STEP_RATE_HZ: f64 = 200_000.0;

/// How finely a machine is stepped, and how long its transient is given to decay.
#[derive(Debug, Clone, Copy)]
struct Care {
    /// Steps per period of the fastest mode.
    steps_per_period: f64,
    /// Time before the first sample, in time constants of the slowest decay.
    run_in_time_constants: f64,
    /// Bounds of that time, s: a machine with hardly any damping is not waited for.
    run_in_s: [f64; 2],
}

/// A record of its own: the transient is 6e-6 of itself, and the classical method puts the fastest mode 2e-6 of its
/// frequency too low, a thousandth of its width at 0.1 % of critical damping.
const RECORD: Care = Care { steps_per_period: 50.0, run_in_time_constants: 12.0, run_in_s: [0.35, 3.0] };
/// What an effect changes, the difference of two of these: start and step err alike in both, and what is left is 2e-3
/// and 3e-5 of the effect's own response. A third of the cost.
const DIFFERENCE: Care = Care { steps_per_period: 25.0, run_in_time_constants: 6.0, run_in_s: [0.2, 1.0] };

/// Fine samples that are kept before they are decimated.
const KEPT: usize = 4096;

/// What is known of one run: the effects in it and where it is taken.
pub struct Run<'a> {
    /// The simulator's effects.
    pub effects: &'a [Box<dyn Effect>],
    /// Where and how.
    pub at: Point,
}

/// Noise-free accelerations of both bodies, m/s2, with what `effects` do to the machine; the measuring chain's part
/// is the caller's.
pub fn accelerations(
    machine: &Machine,
    effects: &[Box<dyn Effect>],
    at: Point,
    samples: usize,
    rate_hz: f64,
) -> [Vec<f64>; 2] {
    side_by_side(machine, &[Run { effects, at }], samples, rate_hz, RECORD).remove(0)
}

/// Accelerations of several runs of one length, for what differs between two such calls; a run's are the same, bit
/// for bit, whoever stands beside it.
pub fn of_runs(machine: &Machine, runs: &[Run<'_>], samples: usize, rate_hz: f64) -> Vec<[Vec<f64>; 2]> {
    // Groups of equal size, and as many as there are processors if they are not full.
    let groups = runs.len().div_ceil(LANES).max(rayon::current_num_threads().min(runs.len())).max(1);
    let size = runs.len().div_ceil(groups).max(1);
    runs.par_chunks(size).flat_map_iter(|runs| side_by_side(machine, runs, samples, rate_hz, DIFFERENCE)).collect()
}

fn side_by_side(machine: &Machine, runs: &[Run<'_>], samples: usize, rate_hz: f64, care: Care) -> Vec<[Vec<f64>; 2]> {
    let poles = Poles::of(machine);
    let step_rate_hz = LEAST_STEP_RATE_HZ.max(care.steps_per_period * poles.fastest_hz);
    let over = (step_rate_hz / rate_hz).ceil().max(1.0) as usize;
    let h = 1.0 / (rate_hz * over as f64);
    let taps = kaiser_low_pass(rate_hz, over);
    let half = taps.len() / 2;
    let run_in_s = (care.run_in_time_constants / poles.slowest_decay_per_s).clamp(care.run_in_s[0], care.run_in_s[1]);
    let settle = (run_in_s / h) as usize;
    let points: Vec<Point> = runs.iter().map(|run| run.at).collect();
    let start_s = -(settle as f64) * h;
    let meshes = runs.iter().map(|run| SteppedMesh::new(machine, run.effects, run.at, h, start_s)).collect();
    let mut bodies = Bodies::new(machine, meshes, &points, h);
    let folded: Vec<f64> = runs.iter().map(|run| run.effects.iter().map(|e| e.unfiltered()).sum()).collect();
    let mut channels: Vec<[Vec<f64>; 2]> = runs.iter().map(|_| [0, 1].map(|_| Vec::with_capacity(samples))).collect();
    // Fine samples from half a filter before the first sample on.
    let mut fine = [0, 1].map(|_| Vec::with_capacity(KEPT + 64));
    let mut ahead = settle.saturating_sub(half);
    let mut done = 0;
    while done < samples {
        bodies.advance(&mut fine);
        if ahead > 0 {
            let early = ahead.min(fine[0].len());
            fine.iter_mut().for_each(|fine| drop(fine.drain(..early)));
            ahead -= early;
        }
        let ready = (fine[0].len() + over).saturating_sub(taps.len()) / over;
        if fine[0].len() < KEPT && done + ready < samples {
            continue;
        }
        let ready = ready.min(samples - done);
        for (which, fine) in fine.iter_mut().enumerate() {
            for n in 0..ready {
                let window = &fine[n * over..];
                let filtered =
                    taps.iter().zip(window).fold(Several::of(0.0), |sum, (tap, x)| sum + Several::of(*tap) * *x);
                for (lane, channels) in channels.iter_mut().enumerate() {
                    let (filtered, raw) = (filtered.0[lane], window[half].0[lane]);
                    channels[which].push(filtered + folded[lane] * (raw - filtered));
                }
            }
            drop(fine.drain(..ready * over));
        }
        done += ready;
    }
    channels
}

/// Angle of the pinion at `t`, turns, as the effects have it.
pub fn turns(effects: &[Box<dyn Effect>], at: Point, t: f64) -> f64 {
    let mut turns = Series::linear(at.start_rad / TAU + at.speed_hz * t, at.speed_hz * 1e-6);
    effects.iter().for_each(|e| e.turns(t, 1e-6, &mut turns));
    turns.coefficient(0)
}

/// Low-pass at `over` times the output rate: flat to 15 kHz, 90 dB down from 36 kHz (at 51.2 kHz); odd length, unit
/// gain.
fn kaiser_low_pass(rate_hz: f64, over: usize) -> Vec<f64> {
    let fine_hz = rate_hz * over as f64;
    let (half, beta) = ((fine_hz * 1.465e-4) as i32, 9.0);
    let cut = (25_000.0_f64).min(0.49 * rate_hz) / fine_hz;
    let mut taps: Vec<f64> = (-half..=half)
        .map(|n| {
            let x = f64::from(n);
            let sinc = if n == 0 { 2.0 * cut } else { (TAU * cut * x).sin() / (PI * x) };
            sinc * bessel_i0(beta * (1.0 - (x / f64::from(half)).powi(2)).max(0.0).sqrt()) / bessel_i0(beta)
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}
