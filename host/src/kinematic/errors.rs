//! Errors in three stages on the fitted and on the held-out turns, and what every family is worth on the latter.
//!
//! *Waveform*: mesh lines and locked families, amplitudes and phases fitted on one part, predict the other; the normalised RMS error is the root of the
//! residual's share of the power, meaned over channels (a loud channel does not decide). *Power*: a family that slips cannot predict a phase; it
//! predicts the power at its lines. What it predicted and found is subtracted from the unexplained share, never more than it predicted.
//! Everything is below the highest order that the record holds at every speed. The noise floor is that of the record itself on the fitted turns, between
//! its lines: no residual has a share in it.

use super::amplitudes::{FittedLine, Weighted};
use super::baseline::{Baseline, Grids, unknowns};
use super::candidate::{TakenOf, score};
use super::evidence::Reading;
use super::named_lines::NamedLines;
use super::residual::Views;
use super::scene::Scene;
use super::search::Adopted;
use super::slipping::{self, power, slipping_share};
use super::spectra::Spectra;
use super::split::{Split, Stretch};
use rayon::prelude::*;
use serde::Serialize;

/// Most lines of a family fitted in a channel.
const MOST_LINES: usize = 150;

/// One part in three stages.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Stages {
    /// Constant amplitudes of the mesh lines.
    pub declared: f64,
    /// Amplitudes that move with the speed.
    pub calibrated: f64,
    /// With the families found.
    pub corrected: f64,
    /// Share that the floor between lines leaves.
    pub noise_floor: f64,
}

/// Of one channel.
#[derive(Debug, Clone, Serialize)]
pub struct ChannelError {
    /// Index in the record.
    pub channel: usize,
    /// Whether families were searched on it.
    pub searched: bool,
    /// Waveform, held-out turns.
    pub waveform: Stages,
    /// Unexplained share of the power, held-out turns, with what slips predicted as power.
    pub unexplained_share: f64,
    /// What the named lines hold at most.
    pub named_lines: NamedLines,
    /// What slipping families with their spacings moved by 1 to 6 % would take in the same way: median and largest share of the power.
    pub control: [f64; 2],
}

/// All errors.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Errors {
    /// Waveform on the fitted turns.
    pub fit: Stages,
    /// Waveform on the held-out turns.
    pub held_out: Stages,
    /// Unexplained share of the power on the held-out turns, with what slips predicted as power.
    pub held_out_power: Stages,
    /// Channel by channel.
    pub per_channel: Vec<ChannelError>,
}

/// What a family is worth on the turns not used.
#[derive(Debug, Clone, Copy, Default)]
pub struct Worth {
    /// Fall of the unexplained share of power: waveform where it is locked, power where it slips.
    pub gain: f64,
    /// Logarithm of the Bayes factor of its lines there.
    pub ln_bayes: f64,
}

/// The corrected model: lines of the locked families by run and channel.
pub struct Corrected {
    /// What is left by run and channel.
    pub residual: Grids,
    /// Fitted lines by run and channel.
    pub lines: Vec<Vec<Vec<FittedLine>>>,
    /// Real unknowns of all families.
    pub unknowns: usize,
}

/// Fits the locked families' lines on the fitted turns, one family after the other; a line takes part in a channel where its own evidence is
/// positive. With the result comes the unexplained share of the held-out power after each family.
pub fn correct(scene: &Scene, baseline: &Baseline, views: &Views, adopted: &[&Adopted]) -> (Corrected, Vec<f64>) {
    let empty = scene.runs.iter().map(|_| vec![Vec::new(); scene.channels.len()]).collect();
    let mut corrected = Corrected { residual: baseline.calibrated.clone(), lines: empty, unknowns: 0 };
    let all = 0..scene.channels.len();
    let weighted: Vec<Weighted> = scene.runs.iter().map(Weighted::new).collect();
    let mut after = Vec::new();
    for own in adopted {
        if own.candidate.locked {
            for (r, weighted) in weighted.iter().enumerate() {
                let choice = Some(&baseline.choices[r]);
                let fit =
                    |(c, samples): (usize, &mut Vec<f64>)| weighted.fit(samples, &standing(own, views, r, c), choice);
                let lines: Vec<Vec<FittedLine>> = corrected.residual[r].par_iter_mut().enumerate().map(fit).collect();
                corrected.unknowns += lines.iter().map(|lines| unknowns(lines)).sum::<usize>();
                corrected.lines[r].iter_mut().zip(lines).for_each(|(all, new)| all.extend(new));
            }
        }
        after.push(mean(&shares(scene, &corrected.residual, held_out), all.clone()));
    }
    (corrected, after)
}

/// Orders of a locked family's lines that stand in a channel, the strongest of them.
fn standing(adopted: &Adopted, views: &Views, run: usize, channel: usize) -> Vec<f64> {
    let strength = |order: f64| {
        let reading = views.orders.reading(run, channel, 0, order, 0);
        (reading.map_or(f64::NEG_INFINITY, Reading::ln_bayes), order)
    };
    let mut orders: Vec<(f64, f64)> = adopted.candidate.places.iter().map(|p| strength(p.order)).collect();
    orders.retain(|(ln, _)| *ln > 0.0);
    orders.sort_by(|a, b| b.0.total_cmp(&a.0));
    orders.into_iter().take(MOST_LINES).map(|(_, order)| order).collect()
}

fn fitted(split: &Split) -> &[Stretch] {
    &split.fit
}

fn held_out(split: &Split) -> &[Stretch] {
    &split.held_out
}

/// Residual's share of the power by run and channel.
fn shares(scene: &Scene, residual: &Grids, stretches: fn(&Split) -> &[Stretch]) -> Vec<Vec<f64>> {
    let share = |r: usize, c: usize| {
        let run = &scene.runs[r];
        let (per_turn, stretches) = (run.angle.per_turn[0], stretches(&run.split));
        power(&residual[r][c], per_turn, stretches) / power(&run.samples[c], per_turn, stretches).max(f64::MIN_POSITIVE)
    };
    (0..scene.runs.len()).map(|r| (0..scene.channels.len()).map(|c| share(r, c)).collect()).collect()
}

/// Share of the held-out power that other signals have, one per channel of the record's first run, meaned over channels: what an error would be that left just them.
pub fn share_of(scene: &Scene, signals: &[Vec<f64>]) -> f64 {
    let Some(run) = scene.runs.first() else { return 0.0 };
    let per_turn = run.angle.per_turn[0];
    let share = |c: usize| {
        let own = run.on_grid(&signals[scene.channels[c].index], scene.highest_order);
        power(&own, per_turn, &run.split.held_out) / power(&run.samples[c], per_turn, &run.split.held_out)
    };
    (0..scene.channels.len()).map(share).sum::<f64>() / scene.channels.len().max(1) as f64
}

fn floors(scene: &Scene, own: &Spectra, stretches: fn(&Split) -> &[Stretch]) -> Vec<Vec<f64>> {
    let floor = |r: usize, c: usize| {
        let run = &scene.runs[r];
        let total = power(&run.samples[c], run.angle.per_turn[0], stretches(&run.split));
        own.floor_power(r, c) / total.max(f64::MIN_POSITIVE)
    };
    (0..scene.runs.len()).map(|r| (0..scene.channels.len()).map(|c| floor(r, c)).collect()).collect()
}

fn mean(shares: &[Vec<f64>], channels: std::ops::Range<usize>) -> f64 {
    let all: Vec<f64> = shares.iter().flat_map(|run| run[channels.clone()].iter().copied()).collect();
    all.iter().sum::<f64>() / all.len().max(1) as f64
}

/// All errors with the families adopted.
pub fn errors(
    scene: &Scene,
    baseline: &Baseline,
    corrected: &Corrected,
    (views, own): ([&Views; 2], &Spectra),
    adopted: &[&Adopted],
) -> Errors {
    let all = 0..scene.channels.len();
    let waveform = |stretches: fn(&Split) -> &[Stretch], channels: std::ops::Range<usize>| Stages {
        declared: mean(&shares(scene, &baseline.declared, stretches), channels.clone()).sqrt(),
        calibrated: mean(&shares(scene, &baseline.calibrated, stretches), channels.clone()).sqrt(),
        corrected: mean(&shares(scene, &corrected.residual, stretches), channels.clone()).sqrt(),
        noise_floor: mean(&floors(scene, own, stretches), channels).sqrt(),
    };
    let predicted = slipping_share(scene, views, adopted, 0.0);
    let controls = slipping::controls(scene, views, adopted);
    let held = waveform(held_out, all.clone());
    let square = |x: f64| x * x;
    let per_channel = all
        .clone()
        .map(|c| {
            let waveform = waveform(held_out, c..c + 1);
            ChannelError {
                channel: scene.channels[c].index,
                searched: c < scene.searched,
                unexplained_share: (square(waveform.corrected) - mean(&predicted, c..c + 1)).max(0.0),
                control: controls[c],
                named_lines: NamedLines::default(),
                waveform,
            }
        })
        .collect();
    Errors {
        fit: waveform(fitted, all.clone()),
        held_out_power: Stages {
            declared: square(held.declared),
            calibrated: square(held.calibrated),
            corrected: (square(held.corrected) - mean(&predicted, all)).max(0.0),
            noise_floor: square(held.noise_floor),
        },
        held_out: held,
        per_channel,
    }
}

/// What each family is worth on the held-out turns, in the order of adoption; families share no lines, so the order hardly matters.
pub fn worths(scene: &Scene, baseline: &Baseline, views: [&Views; 2], adopted: &[&Adopted]) -> Vec<Worth> {
    let all = 0..scene.channels.len();
    let before = mean(&shares(scene, &baseline.calibrated, held_out), all.clone());
    let after = correct(scene, baseline, views[0], adopted).1;
    let nothing: TakenOf = Default::default();
    let worth = |i: usize| {
        let own = adopted[i];
        let field = views[1].field(&nothing, own.candidate.domain, 0..scene.searched);
        let ln_bayes = score(&own.candidate, &field, 0.0).ln_bayes;
        if !own.candidate.locked {
            return Worth { gain: mean(&slipping_share(scene, views, &[own], 0.0), all.clone()), ln_bayes };
        }
        Worth { gain: if i == 0 { before } else { after[i - 1] } - after[i], ln_bayes }
    };
    (0..adopted.len()).map(worth).collect()
}

/// The veto: whether a family holds on the turns not used. What is seen in an envelope predicts no share of the signal itself.
pub fn holds(adopted: &Adopted, worth: &Worth) -> bool {
    let predicts = worth.gain > 0.0 || adopted.candidate.domain.is_envelope();
    predicts && worth.ln_bayes > 0.0
}
