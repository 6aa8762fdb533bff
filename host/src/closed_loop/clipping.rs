//! A channel whose samples stop at a limit: found by how they pile up there, and mended so that the search goes on behind it.
//!
//! What was cut off is not known; the samples at the limit are filled with the prediction, which leaves no residual there. An effect found behind it is too weak by about the
//! share of samples that were cut.

use super::base_fit::Base;
use super::outcome::{Effect, Value};
use super::waveform::complete;
use crate::observation::input::{Record, Run};
use rayon::prelude::*;

/// Least size of a sample at the limit, as a share of it.
const AT_LIMIT: f64 = 0.998;

/// Limit at which a channel's samples pile up, m/s2, if they do.
fn limit(runs: &[Run], channel: usize) -> Option<f64> {
    let peak = runs.iter().flat_map(|r| &r.channels[channel]).fold(0.0_f64, |m, x| m.max(x.abs()));
    let near = |run: &Run, low: f64, high: f64| {
        run.channels[channel].iter().filter(|x| (low * peak..=high * peak).contains(&x.abs())).count()
    };
    // A free signal thins out towards its peak; a limited one piles up there.
    let (at, below) =
        runs.iter().fold((0, 0), |(a, b), run| (a + near(run, AT_LIMIT, 1.0), b + near(run, 0.99, AT_LIMIT)));
    // Noise-free peaks repeat, too, but are round: only a limit holds three samples in a row.
    let flat: usize = runs
        .iter()
        .map(|run| run.channels[channel].windows(3).filter(|w| w.iter().all(|x| x.abs() >= AT_LIMIT * peak)).count())
        .sum();
    // A signal that stands still is no limited one.
    let all: usize = runs.iter().map(|run| run.channels[channel].len()).sum();
    (at > 40 && at > 3 * below && flat > 10 && 2 * at < all).then_some(peak)
}

/// Limits of both channels, where their samples stop at one.
pub fn limits(record: &Record) -> [Option<f64>; 2] {
    [0, 1].map(|c| limit(&record.runs, c))
}

/// The verdict on clipped channels; none where no channel is.
pub fn verdict(limits: [Option<f64>; 2]) -> Option<Effect> {
    if limits == [None, None] {
        return None;
    }
    let mut found = Effect {
        verdict: "named".into(),
        name: "clipping".into(),
        family: "path".into(),
        shaft: "none".into(),
        ..Effect::default()
    };
    for (limit, who) in limits.iter().zip(["pinion", "gear"]) {
        if let Some(value) = *limit {
            let ci95 = [AT_LIMIT * value, value * (2.0 - AT_LIMIT)];
            found.parameters.insert(format!("limit_of_the_{who}_channel"), Value { value, ci95, unit: "m/s2".into() });
        }
    }
    Some(found)
}

/// The record with samples at the limits filled by the prediction of `base`, where that lies beyond them.
pub fn filled(record: &Record, base: &Base, limits: [Option<f64>; 2]) -> Record {
    let mut mended = record.clone();
    mended.runs.par_iter_mut().zip(&base.runs).for_each(|(run, state)| {
        let predicted = complete(&base.analyser, state);
        for ((samples, predicted), limit) in run.channels.iter_mut().zip(&predicted).zip(limits) {
            let Some(limit) = limit else { continue };
            for (x, p) in samples.iter_mut().zip(predicted) {
                if x.abs() >= AT_LIMIT * limit && p * x.signum() > limit {
                    *x = *p;
                }
            }
        }
    });
    mended
}
