//! Errors in three stages on the fitted and on the held-out turns.
//!
//! *Waveform*: mesh lines and locked families, amplitudes and phases fitted on one part, predict the other; the
//! normalised RMS error is the root of the residual's share of the power, meaned over channels (a loud channel does
//! not decide). *Power*: a family that slips cannot predict a phase; it predicts the power at its lines. What it
//! predicted and found is subtracted from the unexplained share, never more than it predicted. Everything is below
//! the highest order that the record holds at every speed. The noise floor is that of the record itself on the fitted
//! turns, between its lines: no residual has a share in it.

use super::amplitudes::{self, Weighted};
use super::baseline::{Baseline, Grids, unknowns};
use super::basis::FittedLine;
use super::evidence::{Reading, Shares};
use super::explained_power_bound::NamedLines;
use super::nonsynchronous::{self, nonsynchronous_share, power};
use super::residual_spectra::Views;
use super::scene::{Scene, SceneRun};
use super::search::Adopted;
use super::spectra::Spectra;
use super::split::{Split, Stretch};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;

/// Most lines of a family fitted in a channel, and the trust below which one is not.
const MOST_LINES: usize = 150;
const LEAST_TRUST: f64 = 0.05;

/// One part in three stages; no numbers where no turn belongs to it (JSON: null).
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
    /// What nonsynchronous families with their spacings moved by 1 to 6 % would take in the same way: median and
    /// largest share of the power.
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

/// The corrected model: lines of the locked families by run and channel.
pub struct Corrected {
    /// What is left by run and channel.
    pub residual: Grids,
    /// Fitted lines by run and channel.
    pub lines: Vec<Vec<Vec<FittedLine>>>,
    /// Real unknowns of all families.
    pub unknowns: usize,
}

/// Fits the locked families' lines on the fitted turns, one family after the other; every amplitude is believed as
/// far as the family's evidence goes ([`Shares::trust`]).
pub fn correct(scene: &Scene, baseline: &Baseline, views: &Views, adopted: &[&Adopted]) -> Corrected {
    let mut corrected = Corrected::none(scene, baseline);
    for own in adopted {
        corrected.add(scene, baseline, views, own);
    }
    corrected
}

impl Corrected {
    /// The calibrated model, without a family.
    pub fn none(scene: &Scene, baseline: &Baseline) -> Self {
        let empty = scene.runs.iter().map(|_| vec![Vec::new(); scene.channels.len()]).collect();
        Self { residual: baseline.calibrated.clone(), lines: empty, unknowns: 0 }
    }

    /// Fits one more family; orders of its lines by run and channel. None where it is not locked.
    pub fn add(&mut self, scene: &Scene, baseline: &Baseline, views: &Views, own: &Adopted) -> Vec<Vec<Vec<f64>>> {
        if !own.candidate.locked {
            return Vec::new();
        }
        let shares = shares_of_places(own, views);
        let of_run = |(r, run): (usize, &SceneRun)| {
            let weighted = Weighted::new(run);
            let choice = Some(&baseline.choices[r]);
            let fit = |(c, samples): (usize, &mut Vec<f64>)| {
                let standing = standing(own, views, &shares, (r, c));
                let orders: Vec<f64> = standing.iter().map(|(_, order)| *order).collect();
                let carriers: Vec<Arc<FittedLine>> = baseline.lines[r][c].iter().cloned().map(Arc::new).collect();
                let mut lines = weighted.fit(samples, &orders, choice, &carriers);
                for (line, (trust, _)) in lines.iter_mut().zip(&standing) {
                    let mut doubted = line.clone();
                    doubted.coefficients.iter_mut().for_each(|c| *c *= trust - 1.0);
                    amplitudes::subtract(samples, run, &doubted);
                    line.coefficients.iter_mut().for_each(|c| *c *= *trust);
                }
                lines
            };
            let lines: Vec<Vec<FittedLine>> = self.residual[r].par_iter_mut().enumerate().map(fit).collect();
            self.unknowns += lines.iter().map(|lines| unknowns(lines)).sum::<usize>();
            let orders = lines.iter().map(|lines| lines.iter().map(|line| line.order).collect()).collect();
            self.lines[r].iter_mut().zip(lines).for_each(|(all, new)| all.extend(new));
            orders
        };
        scene.runs.iter().enumerate().map(of_run).collect()
    }
}

/// What all places of a locked family say of the share of them that carry a line.
fn shares_of_places(adopted: &Adopted, views: &Views) -> Shares {
    let levels = &views.orders.levels;
    let all = levels.iter().enumerate().flat_map(|(r, run)| (0..run.len()).map(move |c| (r, c)));
    let readings = all.flat_map(|(r, c)| {
        adopted.candidate.places.iter().filter_map(move |place| views.orders.reading(r, c, 0, place.order, 0))
    });
    Shares::of(&readings.map(Reading::ln_bayes).collect::<Vec<_>>())
}

/// Trust and order of a locked family's lines that are worth fitting in a run and channel, the surest of them.
fn standing(adopted: &Adopted, views: &Views, shares: &Shares, (run, channel): (usize, usize)) -> Vec<(f64, f64)> {
    let trust = |order: f64| {
        let reading = views.orders.reading(run, channel, 0, order, 0);
        (reading.map_or(0.0, |reading| shares.trust(reading)), order)
    };
    let mut orders: Vec<(f64, f64)> = adopted.candidate.places.iter().map(|p| trust(p.order)).collect();
    orders.retain(|(trust, _)| *trust > LEAST_TRUST);
    orders.sort_by(|a, b| b.0.total_cmp(&a.0));
    orders.truncate(MOST_LINES);
    orders
}

fn fitted(split: &Split) -> &[Stretch] {
    &split.fit
}

pub(super) fn held_out(split: &Split) -> &[Stretch] {
    &split.held_out
}

/// Residual's share of the power by run and channel.
pub(super) fn shares(scene: &Scene, residual: &Grids, stretches: fn(&Split) -> &[Stretch]) -> Vec<Vec<f64>> {
    let share = |r: usize, c: usize| {
        let run = &scene.runs[r];
        let (per_turn, stretches) = (run.angle.per_turn[0], stretches(&run.split));
        power(&residual[r][c], per_turn, stretches) / power(&run.samples[c], per_turn, stretches).max(f64::MIN_POSITIVE)
    };
    (0..scene.runs.len()).map(|r| (0..scene.channels.len()).map(|c| share(r, c)).collect()).collect()
}

/// Share of the held-out power that other signals have, one per channel of the record's first run, meaned over
/// channels: what an error would be that left just them.
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

pub(super) fn mean(shares: &[Vec<f64>], channels: std::ops::Range<usize>) -> f64 {
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
    let waveform = |stretches: fn(&Split) -> &[Stretch], channels: std::ops::Range<usize>| {
        let figure = |shares: Vec<Vec<f64>>| {
            let with_turns = shares.into_iter().zip(&scene.runs).filter(|(_, run)| !stretches(&run.split).is_empty());
            let with_turns: Vec<Vec<f64>> = with_turns.map(|(shares, _)| shares).collect();
            if with_turns.is_empty() { f64::NAN } else { mean(&with_turns, channels.clone()).sqrt() }
        };
        Stages {
            declared: figure(shares(scene, &baseline.declared, stretches)),
            calibrated: figure(shares(scene, &baseline.calibrated, stretches)),
            corrected: figure(shares(scene, &corrected.residual, stretches)),
            noise_floor: figure(floors(scene, own, stretches)),
        }
    };
    let less = |whole: f64, part: f64| if whole.is_nan() { whole } else { (whole - part).max(0.0) };
    let predicted = nonsynchronous_share(scene, views, adopted, 0.0);
    let controls = nonsynchronous::controls(scene, views, adopted);
    let held = waveform(held_out, all.clone());
    let square = |x: f64| x * x;
    let per_channel = all
        .clone()
        .map(|c| {
            let waveform = waveform(held_out, c..c + 1);
            ChannelError {
                channel: scene.channels[c].index,
                searched: c < scene.searched,
                unexplained_share: less(square(waveform.corrected), mean(&predicted, c..c + 1)),
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
            corrected: less(square(held.corrected), mean(&predicted, all)),
            noise_floor: square(held.noise_floor),
        },
        held_out: held,
        per_channel,
    }
}
