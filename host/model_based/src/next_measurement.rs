//! The measurement that would decide between a term and what the record cannot tell from it, computed from the model.
//!
//! The term, at its strength, is predicted for runs at speeds and torques within and beside those of the record. Each
//! rival is then fitted to that prediction, on the record as it is and on one such run together, with the declared
//! parameters and the run's own angle and speed free within their tolerances, as the loop would fit it. What it
//! misses beyond what it misses on the record alone is the evidence that the run is expected to give: half of it in
//! nats. The run with the most against the rival that it tells least is the one to make. Cost: the library's
//! responses at ten further points of half a second, where a verdict is ambiguous; nothing elsewhere. Limits:
//! responses of first order; a new run is taken to start where neither explanation gains by it; delays and tones,
//! whose phases are each run's own, are not compared; sensors other than the two channels are not in the model.

use super::base_fit::{Base, MODEL_SLACK, TOLERANCES};
use super::candidate::{Candidate, Template, Tuning};
use super::judge::{Split, corrected, joint};
use super::least_squares::{Column, Data, Normal, normal, solve};
use super::library::{Bench, mesh, order, path};
use super::outcome::{Effect, NextMeasurement};
use super::start::Start;
use crate::effects::hypothesis::{Path, Seat};
use crate::observation::input::{Record, Run};
use crate::observation::spectrum::OVERDISPERSION;
use crate::spectral::noise_power;
use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex64 as C;

/// Speeds looked at, over the record's lowest (0) or highest (1): a machine is rarely free to run outside.
const SPEEDS: [(usize, f64); 5] = [(0, 0.6), (0, 1.0), (0, 1.35), (1, 1.0), (1, 1.5)];
/// Torques looked at, over the record's least and largest.
const TORQUES: [(usize, f64); 2] = [(0, 0.5), (1, 1.5)];
/// Length of the runs that are predicted, s; their evidence is given for the length of the record's.
const PLANNED_S: f64 = 0.5;
/// Expected evidence, nats, from which a run decides: the rival is a hundred times less likely then, twice the
/// logarithm that a name needs.
const MIN_DECISION_NATS: f64 = 4.6;
/// Most explanations of one name that are compared: shapes and places of the same kind.
const MAX_NAME_EXPLANATIONS: usize = 3;
/// What to do where the model cannot say.
const UNKNOWN_ADVICE: &str = "runs at a third torque and at a higher speed separate these laws";

/// Says for every ambiguous effect which run would decide; `effects` are the verdicts on `accepted`.
pub fn advise(
    record: &Record,
    (base, data, split): (&Base, &Data, &Split),
    accepted: &[Candidate],
    pool: &[Candidate],
    effects: &mut [Effect],
) {
    if effects.iter().all(|effect| effect.verdict != "ambiguous") {
        return;
    }
    let seen = split.seen();
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let x = joint(base, data, &seen, &terms).x;
    let planned = planned(record, base);
    let there = Base::new(&planned);
    let bench = Bench::new(&there);
    let noise = noise(base, &corrected(base, data, &x, &terms), &seen);
    let plan = Plan { base, data, seen, bench: &bench, noise };
    let mut at = base.nuisances.len();
    for (term, effect) in accepted.iter().zip(effects) {
        let own = &x[at..at + term.templates.len()];
        at += term.templates.len();
        if effect.verdict == "ambiguous" {
            effect.next_measurement = plan.best(term, own, &rivals(&bench, term, effect, pool));
            let words = effect.next_measurement.as_ref().map_or_else(|| UNKNOWN_ADVICE.into(), in_words);
            effect.deciding_experiment = Some(words);
        }
    }
}

/// In words.
fn in_words(next: &NextMeasurement) -> String {
    let (hz, torque, seconds, nats) = (next.speed_hz, next.torque_n_m, next.seconds, next.nats);
    let who = ["pinion", "gear"][next.channel];
    let share = format!("{:.2} of them by the {who}'s channel (channel {})", next.nats_of_channel, next.channel);
    if next.decides {
        format!(
            "a run of {seconds:.1} s at {hz:.2} Hz and {torque:.3} N m: {nats:.1} nats expected against {}, {share}",
            next.against
        )
    } else {
        let needed = seconds * MIN_DECISION_NATS / nats.max(1e-3);
        format!(
            "no run of {seconds:.1} s at 0.6 to 1.5 times these speeds and 0.5 to 1.5 times these torques decides; \
             best at {hz:.2} Hz and {torque:.3} N m, {nats:.2} nats expected against {} \
             ({needed:.0} s needed), {share}",
            next.against
        )
    }
}

/// Explanations that the verdict names beside the term's own, from the search or else from the library.
fn rivals(bench: &Bench<'_>, term: &Candidate, effect: &Effect, pool: &[Candidate]) -> Vec<Candidate> {
    let names = effect.name.split(" or ").map(str::trim).filter(|name| *name != term.name);
    names
        .flat_map(|name| {
            // A shape that nothing in the search had stands for any.
            let name = name.strip_prefix("another ").unwrap_or(name);
            let has_name = |c: &&Candidate| c.name == name && !c.templates.is_empty();
            let own: Vec<Candidate> = pool.iter().filter(has_name).take(MAX_NAME_EXPLANATIONS).cloned().collect();
            match own.is_empty() {
                true => bench.fixed().iter().filter(has_name).take(1).cloned().collect(),
                false => own,
            }
        })
        .collect()
}

/// Empty runs at the points looked at.
fn planned(record: &Record, base: &Base) -> Record {
    let range = |values: Vec<f64>| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        [least, values.iter().copied().fold(0.0, f64::max)]
    };
    let speeds = range(base.runs.iter().map(|r| r.angle.shaft_hz).collect());
    let torques = range(base.runs.iter().map(|r| r.torque_n_m).collect());
    let run = |hz: f64, torque: f64| {
        let seconds = PLANNED_S.max(3.5 / hz);
        let edges = (0..).map(|i| f64::from(i) / hz).take_while(|t| *t < seconds);
        let samples = (PLANNED_S * record.sample_rate_hz) as usize;
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

/// Mean noise power of the runs seen, by channel and bin.
fn noise(base: &Base, rest: &Data, seen: &[usize]) -> [Vec<f64>; 2] {
    [0, 1].map(|c| {
        let mut mean = vec![0.0; base.analyser.bins];
        for &r in seen {
            let own = noise_power(&rest.residual[r][c]);
            mean.iter_mut().zip(own).for_each(|(mean, own)| *mean += own / seen.len() as f64);
        }
        mean
    })
}

struct Plan<'a> {
    base: &'a Base,
    data: &'a Data,
    seen: Vec<usize>,
    /// The library at the points looked at.
    bench: &'a Bench<'a>,
    noise: [Vec<f64>; 2],
}

/// A rival on the record alone: normal equations for the term's prediction, and what it misses.
struct OnRecord {
    normal: Normal,
    missed: f64,
}

impl Plan<'_> {
    /// The run that tells the term best from the rival that it tells least.
    fn best(&self, term: &Candidate, x: &[f64], rivals: &[Candidate]) -> Option<NextMeasurement> {
        let own = same_at(self.bench, term)?;
        let prediction = combined(&own.templates, x, self.bench.base);
        let all: Vec<(&Candidate, Candidate, OnRecord)> = rivals
            .iter()
            .filter_map(|rival| Some((rival, same_at(self.bench, rival)?, self.on_record(term, x, rival))))
            .collect();
        let of_run = |run: usize| {
            let against = |(rival, there, before): &(&Candidate, Candidate, OnRecord)| {
                let nats = |channels: &[usize]| self.evidence(&prediction, run, channels, there, before);
                ([nats(&[0, 1]), nats(&[0]), nats(&[1])], rival.name.clone())
            };
            all.iter().map(against).min_by(|a, b| a.0[0].total_cmp(&b.0[0])).map(|(nats, name)| (run, nats, name))
        };
        let most = (0..self.bench.base.runs.len()).filter_map(of_run).max_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        let (run, [nats, first, second], against) = most?;
        let state = &self.bench.base.runs[run];
        let channel = usize::from(second > first);
        Some(NextMeasurement {
            speed_hz: state.angle.shaft_hz,
            torque_n_m: state.torque_n_m,
            seconds: self.base.analyser.duration_s(),
            channel,
            nats,
            nats_of_channel: [first, second][channel],
            against,
            decides: nats >= MIN_DECISION_NATS,
        })
    }

    /// The rival fitted to the term's prediction on the record.
    fn on_record(&self, term: &Candidate, x: &[f64], rival: &Candidate) -> OnRecord {
        let residual = combined(&term.templates, x, self.base);
        let predicted = Data { residual, weight: self.data.weight.clone() };
        let normal = normal(&predicted, &self.seen, &columns(self.base, rival, None));
        let missed = power(&predicted, &self.seen, &[0, 1]) - solve(&normal).gain;
        OnRecord { normal, missed }
    }

    /// Evidence of one run by these channels, nats.
    fn evidence(
        &self,
        prediction: &[[Vec<C>; 2]],
        run: usize,
        channels: &[usize],
        rival: &Candidate,
        before: &OnRecord,
    ) -> f64 {
        let there = self.bench.base;
        let weight =
            (0..there.runs.len()).map(|r| [0, 1].map(|c| self.weight(r, c, r == run && channels.contains(&c))));
        let predicted = Data { residual: prediction.to_vec(), weight: weight.collect() };
        let new = normal(&predicted, &[run], &columns(there, rival, Some(run)));
        let both = joined(&before.normal, &new, rival.templates.len());
        let missed = before_power(before) + power(&predicted, &[run], channels) - solve(&both).gain;
        0.5 * (missed - before.missed).max(0.0)
    }

    /// Weights of a run as long as the record's, whose bins are finer, each with so much less noise.
    fn weight(&self, run: usize, channel: usize, counts: bool) -> Vec<f64> {
        let there = self.bench.base;
        let longer = self.base.analyser.duration_s() / there.analyser.duration_s();
        let lowest = (8.0 * there.analyser.duration_s()) as usize;
        let model = &there.runs[run].model[channel];
        let of = |b: usize| {
            if !counts || b < lowest {
                return 0.0;
            }
            let at = ((b as f64 * longer) as usize).min(self.base.analyser.bins - 1);
            let slack = MODEL_SLACK * MODEL_SLACK * model[b].norm_sqr();
            2.0 / ((self.noise[channel][at] + slack) * OVERDISPERSION)
        };
        (0..there.analyser.bins).map(of).collect()
    }
}

/// Chi-square of the term's prediction on the record, unexplained.
fn before_power(before: &OnRecord) -> f64 {
    before.missed + solve(&before.normal).gain
}

/// Nuisances, with the means of their priors at the present values, then the rival; of the runs' own nuisances only
/// those of `run`, where one is given.
fn columns<'a>(base: &'a Base, rival: &'a Candidate, run: Option<usize>) -> Vec<Column<'a>> {
    let at_present =
        base.nuisances.iter().zip(&base.priors).map(|(template, prior)| Column { template, prior: (prior.0, 0.0) });
    let mut all: Vec<Column<'_>> = at_present.collect();
    if let Some(run) = run {
        let own = TOLERANCES.len() + 2 * run;
        all = [&all[..TOLERANCES.len()], &all[own..own + 2]].concat();
        // Their priors count once, with the record.
        all[..TOLERANCES.len()].iter_mut().for_each(|column| column.prior = (0.0, 0.0));
    }
    all.extend(rival.templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }));
    all
}

/// Both sets of equations: declared parameters and the last `rival` unknowns are common, angle and speed of the new
/// run are its own.
fn joined(record: &Normal, run: &Normal, rival: usize) -> Normal {
    let (shared, old) = (TOLERANCES.len(), record.right.len());
    let place = |i: usize| match i {
        i if i < shared => i,
        i if i < shared + 2 => old + i - shared,
        i => old - rival + i - shared - 2,
    };
    let size = old + 2;
    let mut both = Normal { gram: DMatrix::zeros(size, size), right: DVector::zeros(size) };
    both.gram.view_mut((0, 0), (old, old)).copy_from(&record.gram);
    both.right.rows_mut(0, old).copy_from(&record.right);
    for i in 0..run.right.len() {
        both.right[place(i)] += run.right[i];
        for j in 0..run.right.len() {
            both.gram[(place(i), place(j))] += run.gram[(i, j)];
        }
    }
    both
}

/// Weighted power of `data` in `runs`.
fn power(data: &Data, runs: &[usize], channels: &[usize]) -> f64 {
    let of = |r: usize, c: usize| -> f64 {
        data.residual[r][c].iter().zip(&data.weight[r][c]).map(|(x, w)| x.norm_sqr() * w).sum()
    };
    runs.iter().flat_map(|&r| channels.iter().map(move |&c| (r, c))).map(|(r, c)| of(r, c)).sum()
}

/// Bins of templates at the unknowns `x`.
fn combined(templates: &[Template], x: &[f64], base: &Base) -> Vec<[Vec<C>; 2]> {
    let of = |r: usize, c: usize| {
        let mut bins = vec![C::ZERO; base.analyser.bins];
        for (template, value) in templates.iter().zip(x) {
            template.runs[r][c].iter().for_each(|(b, t)| bins[b] += t * *value);
        }
        bins
    };
    (0..base.runs.len()).map(|r| [0, 1].map(|c| of(r, c))).collect()
}

/// The same explanation at the points looked at.
fn same_at(bench: &Bench<'_>, candidate: &Candidate) -> Option<Candidate> {
    if candidate.phase_free {
        return None;
    }
    match candidate.tuning {
        Some(Tuning::Relief { share, exponent }) => return Some(mesh::relief(bench, share, exponent)),
        Some(Tuning::Mode { channel, f0, zeta }) => return Some(path::mode(bench, channel, f0, zeta)),
        Some(
            Tuning::Order { .. }
            | Tuning::Delay { .. }
            | Tuning::Echo { .. }
            | Tuning::Growth { .. }
            | Tuning::Transition { .. },
        )
        | None => {}
    }
    if let Some(tooth) = candidate.tooth {
        let both = bench.teeth.at(bench, candidate.body(), tooth, &Start::Counted);
        return both.into_iter().find(|c| c.name == candidate.name);
    }
    let is_same = |c: &Candidate| {
        let alike = c.name == candidate.name && c.templates.len() == candidate.templates.len();
        alike && c.exponents == candidate.exponents && channels(c) == channels(candidate)
    };
    if let Some(found) = bench.fixed().iter().find(|c| is_same(c) && c.order == candidate.order) {
        return Some(found.clone());
    }
    if let (Some(Seat::Wave(_)), Some(at)) = (candidate.seat, candidate.order) {
        return order::at_order(bench, at, 1.0).into_iter().find(is_same);
    }
    // Of what the residual takes part in, only what it leaves alone has the same unknowns.
    let bins = || vec![C::ZERO; bench.base.analyser.bins];
    let weights = || vec![0.0; bench.base.analyser.bins];
    let runs = 0..bench.base.runs.len();
    let empty = Data {
        residual: runs.clone().map(|_| [bins(), bins()]).collect(),
        weight: runs.map(|_| [weights(), weights()]).collect(),
    };
    let nothing = Split { fit: Vec::new(), select: Vec::new(), held_out: Vec::new() };
    let of_delay =
        |c: &Candidate| c.hypothesis.is_some_and(|h| h.seats.iter().any(|s| matches!(s, Seat::Path(Path::Delay))));
    let mut rest = bench.teeth.candidates(bench, &empty, &nothing, None);
    rest.extend(path::candidates(bench, &empty, &[]).into_iter().filter(|c| !of_delay(c)));
    rest.into_iter().find(is_same)
}

/// Which channels the templates act on.
fn channels(candidate: &Candidate) -> [bool; 2] {
    let acts = |c: usize| candidate.templates.iter().flat_map(|t| &t.runs).any(|run| !run[c].is_empty());
    [acts(0), acts(1)]
}
