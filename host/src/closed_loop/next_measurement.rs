//! The measurement that would decide between a term and what the record cannot tell from it, computed from the model.
//!
//! The rival is fitted to the term's own prediction on this record, as it would be if the term were true; both are then predicted at speeds and torques beside those of the record,
//! and the run where they differ most in units of the record's noise is the one to make: half the squared difference is the evidence, in nats, that such a run is expected
//! to give. Cost: the library's responses at eight further points. Limits: first-order responses; sensors other than the two channels are not in the model; effects of the measuring
//! path, which follow the signal and not the machine, are not compared.

use super::base_fit::Base;
use super::candidate::{Candidate, Template};
use super::least_squares::{Column, Data, normal, solve, subtract};
use super::library::{Bench, order};
use crate::observation::input::{Record, Run};
use rustfft::num_complex::Complex64 as C;

/// Speeds looked at, over the record's lowest and highest.
const SPEEDS: [(usize, f64); 4] = [(0, 0.6), (0, 1.0), (1, 1.0), (1, 1.5)];
/// Torques looked at, over the record's least and largest.
const TORQUES: [(usize, f64); 2] = [(0, 0.5), (1, 1.5)];
/// Length of the runs that are predicted, s; their evidence is given for the length of the record's.
const PLANNED_S: f64 = 0.5;
/// Expected evidence, nats, from which a run decides: beyond it the rival is a hundred times less likely.
const DECIDES: f64 = 4.6;

/// What to measure, in words; none where no model of both is at hand.
pub fn deciding(
    record: &Record,
    base: &Base,
    data: &Data,
    seen: &[usize],
    (term, x): (&Candidate, &[f64]),
    rivals: &[&Candidate],
) -> Option<String> {
    let planned = planned(record, base);
    let there = Base::new(&planned);
    let bench = Bench::new(&there);
    let own = there_as(&bench, term)?;
    let mut best: Option<(f64, usize, usize)> = None;
    for rival in rivals {
        let Some(other) = there_as(&bench, rival) else { continue };
        let y = fitted_to(data, seen, (term, x), rival);
        for run in 0..there.runs.len() {
            let nats = evidence(base, &there, run, (&own, x), (&other, &y));
            let channel = usize::from(nats[1] > nats[0]);
            let whole = nats[0] + nats[1];
            if best.is_none_or(|(most, ..)| whole > most) {
                best = Some((whole, run, channel));
            }
        }
    }
    let (nats, run, channel) = best?;
    let (hz, torque) = (there.runs[run].angle.shaft_hz, there.runs[run].torque_n_m);
    let who = ["pinion", "gear"][channel];
    let seconds = base.analyser.duration_s();
    Some(if nats >= DECIDES {
        format!(
            "a run of {seconds:.1} s at {hz:.1} Hz and {torque:.3} N m: {nats:.0} nats expected, most by the {who}'s channel"
        )
    } else {
        let longer = seconds * DECIDES / nats.max(1e-3);
        format!(
            "no run at 0.6 to 1.5 times these speeds and torques decides within {seconds:.1} s; best {hz:.1} Hz and {torque:.3} N m, {nats:.2} nats expected ({longer:.0} s needed), most by the {who}'s channel"
        )
    })
}

/// Empty runs at the points looked at.
fn planned(record: &Record, base: &Base) -> Record {
    let range = |values: Vec<f64>| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        [least, values.iter().copied().fold(0.0, f64::max)]
    };
    let speeds = range(base.runs.iter().map(|r| r.angle.shaft_hz).collect());
    let torques = range(base.runs.iter().map(|r| r.torque_n_m).collect());
    let samples = (PLANNED_S * record.sample_rate_hz) as usize;
    let run = |hz: f64, torque: f64| {
        let edges = (0..).map(|i| f64::from(i) / hz).take_while(|t| *t < PLANNED_S.max(3.5 / hz));
        Run {
            name: String::new(),
            channels: [vec![0.0; samples], vec![0.0; samples]],
            edges_s: edges.collect(),
            first_pulse_index: 0,
            input_torque_n_m: torque,
            clipped_share: 0.0,
        }
    };
    let points = SPEEDS.iter().flat_map(|s| TORQUES.iter().map(move |t| (s, t)));
    let runs = points.map(|((i, a), (j, b))| run(speeds[*i] * a, torques[*j] * b)).collect();
    Record { runs, pulses_per_rev: 1, ..record.clone() }
}

/// The same explanation at the points looked at.
fn there_as(bench: &Bench<'_>, candidate: &Candidate) -> Option<Candidate> {
    let same = |c: &Candidate| c.name == candidate.name && c.templates.len() == candidate.templates.len();
    let tooth = candidate.tooth.map(|tooth| bench.teeth.at(bench, candidate.body(), tooth)).unwrap_or_default();
    let seated = candidate.order.map(|o| order::at_order(bench, o, 1.0)).unwrap_or_default();
    bench.fixed().iter().cloned().chain(tooth).chain(seated).find(same)
}

/// Strengths of the rival where it stands for the term on this record.
fn fitted_to(data: &Data, seen: &[usize], (term, x): (&Candidate, &[f64]), rival: &Candidate) -> Vec<f64> {
    let empty = |bins: &Vec<C>| vec![C::ZERO; bins.len()];
    let residual = data.residual.iter().map(|run| [empty(&run[0]), empty(&run[1])]).collect();
    let mut predicted = Data { residual, weight: data.weight.clone() };
    let minus: Vec<f64> = x.iter().map(|v| -v).collect();
    subtract(&mut predicted, &columns(&term.templates), &minus);
    solve(&normal(&predicted, seen, &columns(&rival.templates))).x.iter().copied().collect()
}

fn columns(templates: &[Template]) -> Vec<Column<'_>> {
    templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect()
}

/// Evidence of one run between two explanations, nats, by channel, in the noise of the record at the same frequencies.
fn evidence(
    base: &Base,
    there: &Base,
    run: usize,
    (own, x): (&Candidate, &[f64]),
    (other, y): (&Candidate, &[f64]),
) -> [f64; 2] {
    let longer = base.analyser.duration_s() / there.analyser.duration_s();
    [0, 1].map(|c| {
        let mut difference = vec![C::ZERO; there.analyser.bins];
        for (templates, values, sign) in [(&own.templates, x, 1.0), (&other.templates, y, -1.0)] {
            for (template, value) in templates.iter().zip(values) {
                template.runs[run][c].iter().for_each(|&(b, t)| difference[b as usize] += t * (sign * value));
            }
        }
        let noise = |b: usize| {
            let at = ((b as f64 * longer) as usize).min(base.analyser.bins - 1);
            base.runs.iter().map(|r| r.noise[c][at]).sum::<f64>() / base.runs.len() as f64
        };
        // A run as long as the record's has that much finer bins, each with so much less noise.
        difference.iter().enumerate().map(|(b, d)| d.norm_sqr() / noise(b)).sum::<f64>()
    })
}
