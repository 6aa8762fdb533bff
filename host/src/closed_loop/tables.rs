//! Error tables before and after, and the assembly of the outcome.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::Candidate;
use super::detect;
use super::input::Record;
use super::judge::{Split, corrected, joint};
use super::least_squares::Data;
use super::outcome::{Effect, ErrorPair, ErrorTable, Outcome, Term, Unexplained};
use std::collections::BTreeMap;

/// Bins within one bin of an order of pinion or gear.
fn synchronous(base: &Base, run: usize) -> Vec<bool> {
    let duration = base.analyser.duration_s();
    let mut mask = vec![false; base.analyser.bins];
    let f = base.runs[run].angle.shaft_hz;
    let ratio = f64::from(base.machine.teeth[0]) / f64::from(base.machine.teeth[1]);
    for step in [f, f * ratio] {
        let mut k = 1.0;
        while (k * step * duration + 1.0) < mask.len() as f64 {
            let b = (k * step * duration).round() as usize;
            mask[b.saturating_sub(1)..=(b + 1).min(base.analyser.bins - 1)].fill(true);
            k += 1.0;
        }
    }
    mask
}

fn errors(declared: &Data, after: &Data, base: &Base, runs: &[usize]) -> ErrorPair {
    let mut sync = [0.0; 4];
    let mut whole = [[0.0; 4]; 2];
    for &r in runs {
        let mask = synchronous(base, r);
        for c in 0..2 {
            let noise = super::spectrum::noise_power(&after.residual[r][c]);
            let lowest = (3.0 * base.analyser.duration_s()) as usize;
            for b in lowest..mask.len() {
                let four = [
                    declared.residual[r][c][b].norm_sqr(),
                    after.residual[r][c][b].norm_sqr(),
                    noise[b],
                    base.runs[r].measured[c][b].norm_sqr(),
                ];
                for i in 0..4 {
                    whole[c][i] += four[i];
                    if mask[b] {
                        sync[i] += four[i];
                    }
                }
            }
        }
    }
    let share = |x: &[f64; 4]| [0, 1, 2].map(|i| (x[i] / x[3].max(1e-300)).sqrt());
    let pooled: [f64; 4] = [0, 1, 2, 3].map(|i| whole[0][i] + whole[1][i]);
    let [before, after, noise_floor] = share(&sync);
    ErrorPair {
        before,
        after,
        noise_floor,
        whole_signal: share(&pooled),
        per_channel: [share(&whole[0]), share(&whole[1])],
    }
}

/// Accepted terms with their unknowns, which follow the nuisances in `x`.
fn fitted(base: &Base, accepted: &[Candidate], x: &[f64]) -> Vec<Term> {
    let mut at = base.nuisances.len();
    accepted
        .iter()
        .map(|candidate| {
            let own = at..at + candidate.templates.len();
            at = own.end;
            let size = |c: usize| {
                let bins = candidate.templates.iter().flat_map(|t| &t.runs).flat_map(|run| &run[c]);
                bins.map(|(_, value)| value.norm_sqr()).sum::<f64>().sqrt()
            };
            let sizes = [size(0), size(1)];
            let larger = sizes[0].max(sizes[1]).max(f64::MIN_POSITIVE);
            Term {
                name: candidate.name.clone(),
                parameters: candidate.parameters.clone(),
                unknowns: x[own].to_vec(),
                channel_share: sizes.map(|s| s / larger),
                phase_free: candidate.phase_free,
                tuning: candidate.tuning,
                start: candidate.start.clone(),
            }
        })
        .collect()
}

/// Assembles the outcome with the errors on fit and held-out runs.
#[allow(clippy::too_many_arguments, reason = "assembly of the final report from the parts of one function")]
pub fn report(
    record: &Record,
    declared: &Data,
    base: &Base,
    data: &Data,
    split: &Split,
    accepted: &[Candidate],
    mut effects: Vec<Effect>,
    refused: BTreeMap<String, f64>,
) -> Outcome {
    let seen = &split.seen();
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let solution = joint(base, data, seen, &terms).x;
    let moved = |i: usize| (1.0 + base.change[i]) * (1.0 + solution[i]) - 1.0;
    let after_of = |terms: &[&Candidate]| {
        let mut x = joint(base, data, seen, terms).x;
        // Angle offsets of runs come from the tachometer alone in any prediction.
        x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
        corrected(base, data, &x, terms)
    };
    let after = after_of(&terms);
    let held = errors(declared, &after, base, &split.held_out);
    for (i, effect) in effects.iter_mut().enumerate() {
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        let without = errors(declared, &after_of(&others), base, &split.held_out);
        effect.evidence.held_out_gain = if effect.family == "fixed-frequency" {
            without.whole_signal[1] - held.whole_signal[1]
        } else {
            without.after - held.after
        };
    }
    let pooled = &held.whole_signal;
    let mut unexplained = Vec::new();
    let rest = pooled[1].powi(2) - pooled[2].powi(2);
    if rest > 0.0 {
        let orders = detect::orders(base, &after, seen, 1);
        let hint = orders.first().map_or(String::new(), |o| format!("; strongest line at order {:.3}", o.at));
        let description = format!("remainder above the local noise floor{hint}");
        unexplained.push(Unexplained { description, variance_share: rest });
    }
    let noise = Unexplained { description: "noise floor".into(), variance_share: pooled[2].powi(2) };
    unexplained.push(noise);
    let clipped = record.runs.iter().map(|r| r.clipped_share).fold(0.0, f64::max);
    if clipped > 1e-4 {
        let description = format!("up to {:.2} % of a run's samples at the end of the code range", 100.0 * clipped);
        unexplained.push(Unexplained { description, variance_share: 0.0 });
    }
    Outcome {
        record: record.title.clone(),
        error: ErrorTable {
            metric: "nrmse of the shaft-synchronous part, and of the whole signal, per channel and pooled".into(),
            fit_runs: errors(declared, &after, base, seen),
            held_out_runs: held,
        },
        effects,
        unexplained,
        declared_parameter_changes: TOLERANCES
            .iter()
            .zip(&base.change)
            .map(|((name, _), change)| ((*name).to_string(), *change))
            .collect(),
        corrected_parameter_changes: TOLERANCES
            .iter()
            .enumerate()
            .map(|(i, (name, _))| ((*name).to_string(), moved(i)))
            .collect(),
        terms: fitted(base, accepted, &solution),
        split: [split.fit.clone(), split.select.clone(), split.held_out.clone()],
        refused: refused.into_iter().collect(),
        residual: [declared.residual.clone(), after.residual],
    }
}
