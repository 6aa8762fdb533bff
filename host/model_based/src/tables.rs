//! Error tables in three stages (declared, calibrated, corrected), and the assembly of the outcome.

use super::accept::Adopted;
use super::base_fit::{Base, TOLERANCES, WHOLE_SLACK};
use super::candidate::Candidate;
use super::detect;
use super::judge::{Split, corrected, joint};
use super::least_squares::Data;
use super::outcome::{Effect, ErrorTable, HeldOut, Outcome, StagedError, Stages, Term, Unexplained};
use crate::check::Findings;
use crate::observation::input::Record;
use crate::observation::spectrum::Bins;
use crate::spectral::noise_power;
use nalgebra::DMatrix;

/// Standard errors at which a run's angle and speed, and what is open of the parameters, count in its floor. Each is
/// one draw for all lines of the run, no mean over bins as noise is: at twice, an error of two floors that it alone
/// makes is one of four standard errors.
const STANDARD_ERRORS: f64 = 2.0;

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

/// Residual with the declared parameters and `terms` as fitted over `runs`; phases and speeds of the runs from the
/// tachometer alone, as in any prediction.
pub fn predicted(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate]) -> Vec<[Bins; 2]> {
    let mut x = joint(base, data, runs, terms).x;
    x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
    corrected(base, data, &x, terms).residual
}

/// Errors of `runs` at the three stages, given by their residuals.
fn errors(stages: [&[[Bins; 2]]; 3], base: &Base, runs: &[usize]) -> StagedError {
    let mut sync = [0.0; 5];
    let mut whole = [[0.0; 5]; 2];
    for &r in runs {
        let mask = synchronous(base, r);
        for c in 0..2 {
            let noise = noise_power(&stages[2][r][c]);
            let lowest = (3.0 * base.analyser.duration_s()) as usize;
            for b in lowest..mask.len() {
                let [declared, calibrated, corrected] = stages.map(|residual| residual[r][c][b].norm_sqr());
                let all = [declared, calibrated, corrected, noise[b], base.runs[r].measured[c][b].norm_sqr()];
                for i in 0..5 {
                    whole[c][i] += all[i];
                    if mask[b] {
                        sync[i] += all[i];
                    }
                }
            }
        }
    }
    let share = |x: &[f64; 5]| {
        let [declared, calibrated, corrected, noise_floor] = [0, 1, 2, 3].map(|i| (x[i] / x[4].max(1e-300)).sqrt());
        Stages { declared, calibrated, corrected, noise_floor }
    };
    let pooled: [f64; 5] = std::array::from_fn(|i| whole[0][i] + whole[1][i]);
    StagedError {
        shaft_synchronous: share(&sync),
        whole_signal: share(&pooled),
        per_channel: [share(&whole[0]), share(&whole[1])],
    }
}

/// Held-out runs one by one. The floor is a run's own local noise, but no more than what the runs seen have at the
/// same frequency: a run that fails altogether lifts its own. What the declared jitter of the tachometer's edges does
/// to a prediction, which has no other source for a run's angle and speed, belongs to it, and so does what the fit
/// leaves open of the declared parameters: at [`STANDARD_ERRORS`] of them. The error of the equations themselves
/// ([`WHOLE_SLACK`]) belongs to it, too: with little noise it is all that is left.
fn held_out(after: &[[Bins; 2]], base: &Base, split: &Split, covariance: &DMatrix<f64>) -> Vec<HeldOut> {
    let noise = |r: usize| [0, 1].map(|c| noise_power(&after[r][c]));
    let seen: Vec<[Vec<f64>; 2]> = split.seen().into_iter().map(noise).collect();
    let lowest = (8.0 * base.analyser.duration_s()) as usize;
    split
        .held_out
        .iter()
        .map(|&run| {
            let (own, mask) = (noise(run), synchronous(base, run));
            let (timing, parameters) = (base.timing_power(run), base.parameter_power(run, covariance));
            let mut sums = [[0.0; 3]; 2];
            for c in 0..2 {
                for b in lowest..mask.len() {
                    let others = seen.iter().map(|s| s[c][b]).fold(0.0, f64::max);
                    let (rest, whole) = (after[run][c][b].norm_sqr(), base.runs[run].measured[c][b].norm_sqr());
                    for (sum, counts) in sums.iter_mut().zip([mask[b], true]) {
                        if counts {
                            let open = STANDARD_ERRORS * STANDARD_ERRORS * (timing[c][b] + parameters[c][b]);
                            let floor = own[c][b].min(others) + open + WHOLE_SLACK * WHOLE_SLACK * whole;
                            *sum = [sum[0] + rest, sum[1] + floor, sum[2] + whole];
                        }
                    }
                }
            }
            let share = |i: usize| sums.map(|s| (s[i] / s[2].max(1e-300)).sqrt());
            HeldOut { run, corrected: share(0), floor: share(1) }
        })
        .collect()
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
                let bins = candidate.templates.iter().flat_map(|t| &t.runs).flat_map(|run| run[c].iter());
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
                torque_exponent: candidate.exponents[1],
                start: candidate.start.clone(),
            }
        })
        .collect()
}

/// Assembles the outcome with the errors on fit and held-out runs. `calibrated`: residual of the fitted parameters
/// without any effect; none where no effect was adopted, and the corrected machine is that very one.
#[allow(clippy::too_many_arguments, reason = "assembly of the final report from the parts of one function")]
pub fn report(
    record: &Record,
    declared: &Data,
    calibrated: Option<Vec<[Bins; 2]>>,
    base: &Base,
    data: &Data,
    split: &Split,
    accepted: &Adopted,
    mut effects: Vec<Effect>,
) -> Outcome {
    let seen = &split.seen();
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let solution = joint(base, data, seen, &terms);
    let (covariance, solution) = (solution.covariance, solution.x);
    let moved = |i: usize| (1.0 + base.change[i]) * (1.0 + solution[i]) - 1.0;
    let after = predicted(base, data, seen, &terms);
    let calibrated = calibrated.unwrap_or_else(|| after.clone());
    let errors_of = |last: &[[Bins; 2]], runs: &[usize]| errors([&declared.residual, &calibrated, last], base, runs);
    let held = errors_of(&after, &split.held_out);
    let alone = effects.len() == 1;
    for (i, effect) in effects.iter_mut().enumerate() {
        let part =
            |e: &StagedError| if effect.family == "fixed-frequency" { e.whole_signal } else { e.shaft_synchronous };
        let without = if alone {
            part(&held).calibrated
        } else {
            let others: Vec<&Candidate> =
                accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
            part(&errors_of(&predicted(base, data, seen, &others), &split.held_out)).corrected
        };
        effect.evidence.held_out_gain = without - part(&held).corrected;
    }
    let pooled = &held.whole_signal;
    let mut unexplained = Vec::new();
    let rest = pooled.corrected.powi(2) - pooled.noise_floor.powi(2);
    if rest > 0.0 {
        let remaining = Data { residual: after.clone(), weight: data.weight.clone() };
        let orders = detect::orders(base, &remaining, seen, 1);
        let hint = orders.first().map_or(String::new(), |o| format!("; strongest line at order {:.3}", o.at));
        let description = format!("remainder above the local noise floor{hint}");
        unexplained.push(Unexplained { description, variance_share: rest });
    }
    let noise = Unexplained { description: "noise floor".into(), variance_share: pooled.noise_floor.powi(2) };
    unexplained.push(noise);
    let clipped = record.runs.iter().map(|r| r.clipped_share).fold(0.0, f64::max);
    if clipped > 1e-4 {
        let description = format!("up to {:.2} % of a run's samples at the end of the code range", 100.0 * clipped);
        unexplained.push(Unexplained { description, variance_share: 0.0 });
    }
    Outcome {
        headline: String::new(),
        findings: Findings::default(),
        record: record.title.clone(),
        error: ErrorTable {
            metric: "nrmse of the shaft-synchronous part, and of the whole signal, per channel and pooled; machine \
                as declared, with its parameters \
                     fitted, and with effects"
                .into(),
            fit_runs: errors_of(&after, seen),
            held_out_runs: held,
        },
        held_out: held_out(&after, base, split, &covariance),
        effects,
        limits: Vec::new(),
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
        runs_used: (0..base.runs.len()).collect(),
        split: [split.fit.clone(), split.select.clone(), split.held_out.clone()],
        candidates_tried: 0,
        null_records: None,
        refused: accepted.refusals.list(accepted),
        residual: [declared.residual.clone(), after],
    }
}
