//! Rules on how the mesh's phase runs against the tach within each run: a jump says samples (or tach time) are
//! missing, a steady drift that the two clocks differ.
//!
//! Every run is cut into whole turns of the pinion, so that orders of the pinion do not leak into each other; the
//! delay from one turn to the next is where the harmonics of the mesh, both channels, agree best. Limit: delays are
//! known up to a whole mesh period, a jump of exactly that is not seen; a drift is measured to about 1e-6 in a
//! second.

use super::Checked;
use super::finding::{Finding, Kind, Severity};
use crate::observation::angle::Angle;
use crate::observation::input::{Record, Run};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Harmonics that carry the delay.
const HARMONICS: usize = 12;
/// Least jump, in samples.
const LEAST_JUMP_SAMPLES: f64 = 2.0;
/// A jump over the usual change from turn to turn: an effect's swing moves all turns.
const MIN_JUMP_RATIO: f64 = 8.0;
/// Smallest drift that is said.
const LEAST_DRIFT: f64 = 3e-5;
/// Spread of the drift over the runs, as a share of it.
const DRIFT_SPREAD: f64 = 0.3;

/// Applies the rules; a drift that all runs share is undone, runs with a jump are set aside.
pub fn check(checked: &mut Checked) {
    let record = &checked.record;
    let changes: Vec<Vec<f64>> = record.runs.par_iter().map(|run| delays(record, run)).collect();
    let jumps: Vec<Option<(usize, f64)>> =
        changes.iter().map(|own| jump(own, LEAST_JUMP_SAMPLES / record.sample_rate_hz)).collect();
    let places: Vec<usize> = (0..jumps.len()).filter(|&r| jumps[r].is_some()).collect();
    if let Some((&first, Some((turn, size)))) = places.first().map(|r| (r, jumps[*r])) {
        let speed = Angle::fit(&record.runs[first], record.pulses_per_rev, record.jitter_s).shaft_hz;
        let worst = places.iter().filter_map(|&r| jumps[r]).map(|j| j.1.abs()).fold(0.0, f64::max);
        let text = format!(
            "the mesh's phase jumps against the tach by {:.1} samples (or that and whole mesh periods) {}, first in \
             run {} near {:.2} s: samples are missing there, or time of the tach",
            size * record.sample_rate_hz,
            checked.in_runs(&places),
            checked.runs[first],
            (turn as f64 + 1.0) / speed
        );
        let limit = LEAST_JUMP_SAMPLES / record.sample_rate_hz;
        let finding = Finding::new(Severity::SetAside, Kind::Jump, worst, limit, "s", text);
        checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding);
    } else {
        drift(checked, &changes);
    }
}

/// Delay of the vibration against the tach from each turn of the pinion to the next, s.
fn delays(record: &Record, run: &Run) -> Vec<f64> {
    let angle = Angle::fit(run, record.pulses_per_rev, record.jitter_s);
    let z = f64::from(record.pair.teeth[0]);
    let mesh_hz = z * angle.shaft_hz;
    let turns = turns(record, run, &angle);
    let grid = 400;
    turns
        .windows(2)
        .map(|pair| {
            let cross: Vec<C> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a.conj() * b).collect();
            let agreement = |tau: f64| -> f64 {
                cross
                    .iter()
                    .enumerate()
                    .map(|(i, x)| {
                        let h = (i % HARMONICS + 1) as f64;
                        (x * C::cis(TAU * h * mesh_hz * tau)).re
                    })
                    .sum()
            };
            let step = 1.0 / (mesh_hz * f64::from(grid));
            let best = (-grid / 2..=grid / 2)
                .map(|i| (agreement(f64::from(i) * step), i))
                .fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
                .1;
            let at = f64::from(best) * step;
            let (low, mid, high) = (agreement(at - step), agreement(at), agreement(at + step));
            let bend = low - 2.0 * mid + high;
            if bend < 0.0 { at + 0.5 * step * (low - high) / bend } else { at }
        })
        .collect()
}

/// Complex amplitudes of the mesh harmonics, both channels, turn by turn, at the tach's own angle.
fn turns(record: &Record, run: &Run, angle: &Angle) -> Vec<Vec<C>> {
    let z = f64::from(record.pair.teeth[0]);
    let rate = record.sample_rate_hz;
    let samples = run.channels[0].len();
    let per_turn = rate / angle.shaft_hz;
    let count = (samples as f64 / per_turn) as usize;
    let top = (0.4 * rate / (z * angle.shaft_hz)) as usize;
    (0..count)
        .map(|k| {
            let from = (k as f64 * per_turn).round() as usize;
            let to = (((k + 1) as f64 * per_turn).round() as usize).min(samples);
            let mut sums = vec![C::ZERO; 2 * HARMONICS];
            for n in from..to {
                let turn = C::cis(-z * (angle.offset_rad + TAU * angle.shaft_hz * n as f64 / rate));
                let mut phasor = C::ONE;
                for h in 0..HARMONICS.min(top) {
                    phasor *= turn;
                    for c in 0..2 {
                        sums[c * HARMONICS + h] += run.channels[c][n] * phasor;
                    }
                }
            }
            sums
        })
        .collect()
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// The turn and size of one jump among steady changes; a jump within a turn shows in two neighbouring changes.
fn jump(changes: &[f64], least_s: f64) -> Option<(usize, f64)> {
    if changes.len() < 5 {
        return None;
    }
    let middle = median(changes);
    let off: Vec<f64> = changes.iter().map(|c| c - middle).collect();
    let (at, _) = off.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    let next = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter(|&i| i < off.len());
    let beside = next.max_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs()))?;
    let others: Vec<f64> = (0..off.len()).filter(|&i| i != at && i != beside).map(|i| off[i].abs()).collect();
    let usual = others.iter().copied().fold(0.0, f64::max);
    let size = if off[beside].signum() == off[at].signum() { off[at] + off[beside] } else { off[at] };
    // The rest must be steady: a swing that all turns share is an effect.
    (off[at].abs() > least_s && off[at].abs() > MIN_JUMP_RATIO * median(&others) && off[at].abs() > 2.0 * usual)
        .then_some((at, size))
}

fn drift(checked: &mut Checked, changes: &[Vec<f64>]) {
    let record = &checked.record;
    let drifts: Vec<f64> = record
        .runs
        .iter()
        .zip(changes)
        .filter(|(_, own)| own.len() >= 3)
        .map(|(run, own)| {
            let hz = Angle::fit(run, record.pulses_per_rev, record.jitter_s).shaft_hz;
            own.iter().sum::<f64>() / own.len() as f64 * hz
        })
        .collect();
    let middle = median(&drifts);
    let spread = median(&drifts.iter().map(|d| (d - middle).abs()).collect::<Vec<_>>());
    if drifts.len() < 3 || middle.abs() < LEAST_DRIFT || spread > DRIFT_SPREAD * middle.abs() {
        return;
    }
    // Later and later: the vibration's mesh is slower than the tach says.
    let factor = 1.0 / (1.0 + middle);
    super::mesh::scale_tach(checked, factor);
    let text = format!(
        "tach and vibration disagree by {:+.4} %: the mesh's phase drifts against the tach alike in all runs; the \
         tach is scaled to the vibration",
        100.0 * (factor - 1.0)
    );
    checked.findings.add(Finding::new(Severity::Say, Kind::Clock, factor - 1.0, LEAST_DRIFT, "relative", text));
}
