//! The loop itself: split by run, centre the declared machine, add effects strongest first, judge each, read the held-out runs once.
//!
//! The residual's weights are renewed after every accepted term. Each further term must bring a stated share of what the strongest
//! one brought: a template that is right to a few percent leaves a few percent, which is no second effect.

use super::base_fit::{Base, RunState, TOLERANCES};
use super::candidate::{Candidate, Claim, Finite, Tuning};
use super::detect;
use super::impulsive::impacts;
use super::input::Record;
use super::judge::{Judge, Judged, LEAST_SCORE, Split, corrected, joint};
use super::least_squares::{Data, chi_square, normal, solve};
use super::library::Bench;
use super::library::mesh::refine_relief;
use super::library::path::refine_mode;
use super::outcome::{Effect, Outcome};
use super::spectrum::{Bins, noise_power};
use super::tables::report;
use super::verdict::{undetermined, verdicts};
use super::waveform::{clipping, speed_fluctuation};
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Options of the loop.
#[derive(Debug, Clone)]
pub struct Options {
    /// Seed of the split.
    pub seed: u64,
    /// Most effects looked for.
    pub most: usize,
    /// Progress on stderr.
    pub progress: bool,
    /// Library names withheld (for leave-one-out proof).
    pub withheld: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, most: 5, progress: false, withheld: Vec::new() }
    }
}

/// A further term must gain this share of the largest gain so far.
const LEAST_SHARE: f64 = 0.01;
/// Most times that the declared parameters are centred again with effects in the fit.
const MOST_CENTRED: usize = 2;
/// Power over local noise left by a search from which it pays to search again from the declaration.
const MOST_OVER_NOISE: f64 = 1.3;
/// And power left as a share of what the declaration leaves.
const LARGEST_REST: f64 = 0.1;
/// Second-order error of a move of the declared parameters from which it pays to centre again.
const LEAST_DEPARTURE: f64 = 3.0;
/// Gain from which a first-order template's own error may decide: below it a few percent of form error are within chance.
const FINITE_GAIN: f64 = 300.0;
/// A candidate's share of the best score from which its response at finite strength could still make it the best.
const FINITE_SHARE: f64 = 0.8;
/// Score from which contacts carried along by a shaft are always simulated, at several strengths.
const STRONG_SCORE: f64 = 3000.0;
/// Change of strength from the first-order template to the simulated one from which other strengths are tried, too.
const LEAST_BEND: f64 = 0.1;
/// Share of the best simulated score below which a candidate is simulated once only.
const STILL_LEADING: f64 = 0.9;
/// Most candidates simulated in a round.
const MOST_FINITE: usize = 4;
/// Score by which a plain description must beat a name that passes (twice the logarithm of a Bayes factor of 10).
const NAME_MARGIN: f64 = 4.6;
/// Share of its gain by which a description with more unknowns must beat a name: the form error of a first-order template.
const TABLE_MARGIN: f64 = 0.03;
/// Largest probability of a term's gain by chance, after correction for the search.
const LARGEST_P: f64 = 1e-3;
/// A term that leaves more of the power at its own lines than this explains nothing.
const MOST_LEFT: f64 = 0.5;

/// Groups runs by speed; one inner speed is held out, another selects, the rest fit.
fn split(base: &Base, seed: u64) -> Result<Split> {
    let mut by_speed: Vec<usize> = (0..base.runs.len()).collect();
    by_speed.sort_by(|&a, &b| base.runs[a].angle.shaft_hz.total_cmp(&base.runs[b].angle.shaft_hz));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for r in by_speed {
        let speed = base.runs[r].angle.shaft_hz;
        match groups.last_mut() {
            Some(group) if (speed / base.runs[group[0]].angle.shaft_hz - 1.0).abs() < 0.02 => group.push(r),
            _ => groups.push(vec![r]),
        }
    }
    if groups.len() < 3 {
        return Err(Error::invalid("record.toml: run", "the closed loop needs runs at three or more speeds"));
    }
    let mut inner: Vec<usize> = (1..groups.len() - 1).collect();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let held = inner.swap_remove((rng.random::<u32>() as usize) % inner.len());
    let select = if inner.is_empty() { groups.len() - 1 } else { inner[(rng.random::<u32>() as usize) % inner.len()] };
    let sorted = |pick: &dyn Fn(usize) -> bool| {
        let mut runs: Vec<usize> =
            groups.iter().enumerate().filter(|(g, _)| pick(*g)).flat_map(|(_, runs)| runs.clone()).collect();
        runs.sort_unstable();
        runs
    };
    Ok(Split {
        fit: sorted(&|g| g != held && g != select),
        select: sorted(&|g| g == select),
        held_out: sorted(&|g| g == held),
    })
}

/// Finds what the declared machine of `record` lacks.
///
/// # Errors
/// Fewer than three speeds, or runs shorter than half a second.
pub fn close_loop(record: &Record, options: &Options) -> Result<Outcome> {
    let start = std::time::Instant::now();
    let say = |what: &str| {
        if options.progress {
            eprintln!("{:6.1} s  {what}", start.elapsed().as_secs_f64());
        }
    };
    if record.runs.iter().any(|r| (r.channels[0].len() as f64) < 0.5 * record.sample_rate_hz) {
        return Err(Error::invalid("record.toml: run", "every run must last at least half a second"));
    }
    say("predicting the declared machine");
    let mut base = Base::new(record);
    let declared = base.data();
    let split = split(&base, options.seed)?;
    let seen = split.seen();
    let fitted = base.fit(&split.fit, 2);
    if !fitted {
        say("no declared parameters within tolerance explain the record: searching from the declaration");
        base = Base::new(record);
    }
    let plain = base.data();
    let mut whole: Vec<Effect> = clipping(&mut base, record, &plain, &split.held_out).into_iter().collect();
    if whole.is_empty() {
        whole.extend(speed_fluctuation(&mut base, record, &plain, &split.held_out));
    }
    if whole.iter().any(|e| e.family == "non-stationary") {
        // Smeared lines may have led the declared parameters astray: the declaration itself may do better.
        let mut unfitted = Base::new(record);
        let again = speed_fluctuation(&mut unfitted, record, &plain, &split.held_out);
        let left =
            |base: &Base| chi_square(&Data { residual: base.data().residual, weight: plain.weight.clone() }, &seen);
        if let Some(again) = again
            && left(&unfitted) < left(&base)
        {
            whole = vec![again];
            base = unfitted;
        }
    }
    for effect in whole.iter_mut().filter(|e| options.withheld.contains(&e.name)) {
        let text = if effect.name == "clipping" {
            "signal limited from above and below"
        } else {
            "angle moving within the runs"
        };
        (effect.verdict, effect.name) = ("generic".into(), text.into());
    }
    // These distort every line: what is left of them is no second effect.
    let rounds = if whole.is_empty() { options.most } else { 0 };
    let (at_first, _) = power_and_noise(&base, &declared.residual, &seen);
    let mut explained = explain(base, &split, options, rounds, &plain, &say);
    let much = explained.power > (MOST_OVER_NOISE * explained.noise).max(LARGEST_REST * at_first);
    if rounds > 0 && fitted && much {
        // Parameters that were fitted before the effect was known may have been led too far astray to find back.
        say("much is left: searching again from the declaration as it stands");
        let again = explain(Base::new(record), &split, options, rounds, &plain, &say);
        if again.left < explained.left {
            explained = again;
        }
    }
    let Explained { base, mut accepted, pool, mut refused, strongest, data, .. } = explained;
    say("verdicts");
    let mut effects = verdicts(&base, &data, &split, &accepted, &pool);
    // Next to the others and with the final weights a term must still stand.
    let stands = |e: &Effect| e.evidence.left_at_its_lines < MOST_LEFT && e.evidence.p_value < LARGEST_P;
    let mut keep = effects.iter().map(stands).collect::<Vec<_>>().into_iter();
    accepted.retain(|_| keep.next().unwrap_or(true));
    effects.retain(stands);
    if whole.is_empty() {
        let terms: Vec<&Candidate> = accepted.iter().collect();
        let rest = corrected(&base, &data, &joint(&base, &data, &seen, &terms).x, &terms);
        whole.extend(impacts(&base, &rest, &split).filter(|e| effects.is_empty() || e.verdict == "named"));
    }
    if whole.is_empty()
        && effects.is_empty()
        && let Some(found) = strongest
        && much_is_there(&base, &data, &seen)
    {
        say("nothing holds from run to run, but much is there: a plain description of what comes closest");
        effects.extend(undetermined(&base, &data, &split, &found, &pool));
    }
    for term in &accepted {
        refused.remove(&term.name);
    }
    let mut outcome = report(record, &declared, &base, &data, &split, &accepted, effects, refused);
    outcome.effects.extend(whole);
    say("done");
    Ok(outcome)
}

/// A search brought to its end.
struct Explained {
    base: Base,
    accepted: Vec<Candidate>,
    pool: Vec<Candidate>,
    refused: BTreeMap<String, f64>,
    /// Candidate of the largest gain before anything was accepted.
    strongest: Option<Box<Candidate>>,
    data: Data,
    /// Whitened residual of the runs seen, by weights common to all searches.
    left: f64,
    /// Power of that residual, and of the local noise in it.
    power: f64,
    noise: f64,
}

/// Searches, centring again as often as needed, and confirms on the held-out runs.
fn explain(
    mut base: Base,
    split: &Split,
    options: &Options,
    rounds: usize,
    plain: &Data,
    say: &dyn Fn(&str),
) -> Explained {
    let seen = split.seen();
    let mut attempt = 0;
    let (mut accepted, pool, refused, strongest, data) = loop {
        let bench = Bench::new(&base);
        match search(&bench, split, options, rounds, attempt, say) {
            Search::Done { accepted, pool, refused, strongest, data } => {
                break (accepted, pool, refused, strongest, data);
            }
            Search::Recentre(change) => {
                say("declared parameters moved with the effect: centring again");
                drop(bench);
                let change = base.within_reach(&change);
                base.adopt(&change);
                attempt += 1;
            }
        }
    };
    confirm(&base, &data, split, &mut accepted);
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let rest = corrected(&base, &data, &joint(&base, &data, &seen, &terms).x, &terms).residual;
    let (power, noise) = power_and_noise(&base, &rest, &seen);
    let left = chi_square(&Data { residual: rest, weight: plain.weight.clone() }, &seen);
    Explained { base, accepted, pool, refused, strongest, data, left, power, noise }
}

/// Power of a residual, and of the local noise in it.
fn power_and_noise(base: &Base, residual: &[[Bins; 2]], runs: &[usize]) -> (f64, f64) {
    let (mut power, mut noise) = (0.0, 1e-300);
    for bins in runs.iter().flat_map(|&r| &residual[r]) {
        let lowest = (8.0 * base.analyser.duration_s()) as usize;
        power += bins.iter().skip(lowest).map(|x| x.norm_sqr()).sum::<f64>();
        noise += noise_power(bins).iter().skip(lowest).sum::<f64>();
    }
    (power, noise)
}

/// Whether the declared parameters alone leave more than noise.
fn much_is_there(base: &Base, data: &Data, runs: &[usize]) -> bool {
    let rest = corrected(base, data, &joint(base, data, runs, &[]).x, &[]).residual;
    let (power, noise) = power_and_noise(base, &rest, runs);
    power > MOST_OVER_NOISE * noise
}

/// What a search came to.
enum Search {
    /// Terms, everything that scored, scores of what was refused, the candidate of the largest gain of the first round, final weights.
    Done {
        accepted: Vec<Candidate>,
        pool: Vec<Candidate>,
        refused: BTreeMap<String, f64>,
        strongest: Option<Box<Candidate>>,
        data: Data,
    },
    /// An effect took the declared parameters along before it was known: they move by this much with it in the fit.
    Recentre(Vec<f64>),
}

/// Adds effects strongest first.
fn search(
    bench: &Bench<'_>,
    split: &Split,
    options: &Options,
    rounds: usize,
    attempt: usize,
    say: &dyn Fn(&str),
) -> Search {
    let base = bench.base;
    let seen = split.seen();
    say("responses of the library");
    let mut data = base.data();
    let raw = data.residual.clone();
    let mut accepted: Vec<Candidate> = Vec::new();
    let mut pool: Vec<Candidate> = Vec::new();
    let mut refused: BTreeMap<String, f64> = BTreeMap::new();
    let mut strongest = None;
    let mut largest_gain = 0.0_f64;
    for round in 0..rounds {
        let terms: Vec<&Candidate> = accepted.iter().collect();
        // Noise from the residual after everything accepted; the form slack stays tied to the raw residual.
        let fitted = joint(base, &data, &seen, &terms);
        let rest = corrected(base, &data, &fitted.x, &terms);
        data.weight = base.weights(&rest.residual, &raw);
        let rest = Data { residual: rest.residual, weight: data.weight.clone() };
        let orders = detect::orders(base, &rest, &split.fit, 2);
        let mut frequencies = detect::frequencies(base, &rest, &split.fit, 2);
        frequencies.extend(detect::modulations(base, &rest, &split.fit, 1));
        say(&format!("round {}: {} order lines, {} fixed lines", round + 1, orders.len(), frequencies.len()));
        let mut candidates = bench.candidates(&rest, &split.fit, &orders, &frequencies);
        withhold(&mut candidates, &options.withheld);
        candidates.retain(|c| accepted.iter().all(|a| !same(a, c)));
        let judge = Judge::new(base, &data, split, &terms);
        let mut judged: Vec<Judged> = candidates.into_par_iter().map(|c| judge.judge(c)).collect();
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        tune(bench, &judge, &mut judged);
        at_their_strength(bench, &judge, &data, &mut judged);
        judged.retain(|j| !refuted_by_tachometer(base, j));
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        for j in judged.iter().take(6) {
            say(&format!(
                "  {} at {:?}/{:?}: score {:.1}, gain {:.1}, selection runs {:.1} of {:.1}, apart {:.1}",
                j.candidate.name,
                j.candidate.order,
                j.candidate.frequency_hz,
                j.score,
                j.gain,
                j.select_gain,
                j.select_promise,
                j.apart_gain
            ));
        }
        let tests = judged.len() as f64;
        let passes = |j: &Judged| j.passes(tests, !accepted.is_empty()) && j.gain > LEAST_SHARE * largest_gain;
        let best = judged.iter().position(passes);
        for j in judged.iter().take(30) {
            let worst = refused.entry(j.candidate.name.clone()).or_insert(f64::NEG_INFINITY);
            *worst = worst.max(j.score);
        }
        if round == 0 {
            let significant = judged.iter().filter(|j| j.score > LEAST_SCORE && j.p_value(tests) < LARGEST_P);
            strongest = significant.max_by(|a, b| a.score.total_cmp(&b.score)).map(|j| Box::new(j.candidate.clone()));
        }
        let Some(best) = best else {
            pool.extend(judged.into_iter().filter(|j| j.score > 0.0).take(60).map(|j| j.candidate));
            break;
        };
        let top = &judged[best];
        let near = |j: &Judged| {
            let freer = top.candidate.templates.len() > j.candidate.templates.len();
            let margin = if freer { NAME_MARGIN.max(TABLE_MARGIN * top.gain) } else { NAME_MARGIN };
            j.score > top.score - margin
        };
        let name = judged.iter().position(|j| j.candidate.claim == Claim::Named && near(j) && passes(j));
        let winner = &judged[name.unwrap_or(best)];
        largest_gain = largest_gain.max(winner.gain);
        let winner = winner.candidate.clone();
        pool.extend(judged.into_iter().filter(|j| j.score > 0.0).take(60).map(|j| j.candidate));
        accepted.push(winner);
        prune(base, &data, split, &mut accepted);
        let terms: Vec<&Candidate> = accepted.iter().collect();
        let move_to = joint(base, &data, &seen, &terms).x[..TOLERANCES.len()].to_vec();
        if attempt < MOST_CENTRED && base.departure(&data, &seen, &move_to) > LEAST_DEPARTURE {
            return Search::Recentre(move_to);
        }
    }
    Search::Done { accepted, pool, refused, strongest, data }
}

/// Whether two candidates are the same effect in the same place: a second helping of a term is never a second effect.
fn same(a: &Candidate, b: &Candidate) -> bool {
    let near = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() < 0.01 * (1.0 + a.abs()),
        (None, None) => true,
        _ => false,
    };
    a.name == b.name
        && near(a.order, b.order)
        && near(a.frequency_hz, b.frequency_hz)
        && a.parameters.first().map(|p| &p.name) == b.parameters.first().map(|p| &p.name)
}

/// Takes names out of the library. Plain order-locked excitations, fixed-frequency forcing and modes are no part of it and stay under
/// their description; what has none goes.
fn withhold(candidates: &mut Vec<Candidate>, names: &[String]) {
    candidates.retain_mut(|c| {
        if c.claim == Claim::Generic || !names.contains(&c.name) {
            return true;
        }
        let plain = c.plain.take();
        c.claim = Claim::Generic;
        plain.map(|text| c.name = text).is_some()
    });
}

/// Whether a swing of the shaft is claimed that the tachometer would have seen.
fn refuted_by_tachometer(base: &Base, judged: &Judged) -> bool {
    let Some(Finite::PositionModulation { order }) = judged.candidate.finite else { return false };
    let [a, b] = judged.x[..] else { return false };
    let amplitude_rad = a.hypot(b) * std::f64::consts::TAU / f64::from(base.machine.teeth[0]);
    let duration_s = base.analyser.duration_s();
    let refutes = |r: &&RunState| r.angle.refutes(order, amplitude_rad, base.pulses_per_rev, duration_s);
    2 * base.runs.iter().filter(refutes).count() > base.runs.len()
}

/// Improves the shape of the best candidates that have one.
fn tune(bench: &Bench<'_>, judge: &Judge<'_>, judged: &mut [Judged]) {
    let score = |c: Candidate| judge.judge(c).score;
    let best = judged.first().map_or(0.0, |j| j.score);
    let mut relief = [false; 2];
    for j in judged.iter_mut().take(8) {
        match j.candidate.tuning {
            Some(Tuning::Mode { channel, f0, zeta }) if j.score > 0.6 * best => {
                let (name, claim) = (j.candidate.name.clone(), j.candidate.claim);
                *j = judge.judge(Candidate { name, claim, ..refine_mode(bench, (channel, f0, zeta), score) });
            }
            Some(Tuning::Relief { share, exponent }) if j.score > 0.6 * best && !relief[exponent as usize - 1] => {
                relief[exponent as usize - 1] = true;
                *j = judge.judge(refine_relief(bench, (share, exponent), score));
            }
            _ => {}
        }
    }
}

/// Replaces first-order templates of strong candidates by simulated ones, for as many as may still win.
///
/// Contacts carried along their path by a few percent of a pitch turn the high mesh orders by radians: a first-order fit then sees a part of
/// the strength only, and several strengths are tried.
fn at_their_strength(bench: &Bench<'_>, judge: &Judge<'_>, data: &Data, judged: &mut [Judged]) {
    let best = judged.iter().map(|j| j.score).fold(0.0, f64::max);
    let carried = |j: &Judged| {
        matches!(j.candidate.finite, Some(Finite::RollingDisplacement { .. } | Finite::PositionModulation { .. }))
            && bench.shaft_orders()[..2].iter().any(|o| j.candidate.order == Some(*o))
    };
    let may_win = |j: &Judged| {
        j.candidate.finite.is_some()
            && j.gain > FINITE_GAIN
            && (j.score > FINITE_SHARE * best || best > STRONG_SCORE && carried(j))
            && !j.x.is_empty()
    };
    let mut chosen: Vec<usize> = (0..judged.len()).filter(|&i| may_win(&judged[i])).collect();
    chosen.sort_by(|&a, &b| judged[b].score.total_cmp(&judged[a].score));
    chosen.truncate(MOST_FINITE);
    let size = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut leader = 0.0_f64;
    for (rank, &i) in chosen.iter().enumerate() {
        let first_order = judged[i].candidate.clone();
        let at = |x: &[f64]| bench.at_strength(&first_order, x, data).map(|bent| judge.judge(bent));
        let Some(mut now) = at(&judged[i].x) else { continue };
        let bends = (size(&now.x) / size(&judged[i].x) - 1.0).abs() > LEAST_BEND;
        if bends && best > STRONG_SCORE {
            for factor in [1.7, 3.0, 5.0] {
                let stronger: Vec<f64> = judged[i].x.iter().map(|v| v * factor).collect();
                now = at(&stronger).filter(|other| other.score > now.score).unwrap_or(now);
            }
        }
        if now.score <= judged[i].score - 1.0 {
            continue;
        }
        judged[i] = now;
        leader = leader.max(judged[i].score);
        // The strength itself follows the secant: whoever may still lead gets the steps it needs, the others enough to compare.
        let steps = match judged[i].score < STILL_LEADING * leader {
            true => 0,
            false if rank == 0 || bends => 4,
            false => 1,
        };
        for _ in 0..steps {
            let Some(again) = at(&judged[i].x) else { break };
            let moved: Vec<f64> = again.x.iter().zip(&judged[i].x).map(|(a, b)| a - b).collect();
            let settled = size(&moved) < 0.002 * size(&again.x);
            if again.score <= judged[i].score - 1.0 {
                break;
            }
            judged[i] = again;
            leader = leader.max(judged[i].score);
            if settled {
                break;
            }
        }
    }
}

/// Drops terms that do not lower the whitened error of the held-out runs, predicted from the others.
fn confirm(base: &Base, data: &Data, split: &Split, accepted: &mut Vec<Candidate>) {
    let seen = split.seen();
    // The held-out runs' own angle offsets and speeds, with the tachometer's uncertainty as prior, are fitted last: they are no part of a term.
    let own = base.columns().split_off(TOLERANCES.len());
    let error = |terms: &[&Candidate]| {
        let mut x = joint(base, data, &seen, terms).x;
        x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
        let rest = corrected(base, data, &x, terms);
        chi_square(&rest, &split.held_out) - solve(&normal(&rest, &split.held_out, &own)).gain
    };
    let mut i = 0;
    while i < accepted.len() {
        let with: Vec<&Candidate> = accepted.iter().collect();
        let without: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        if error(&without) > error(&with) {
            i += 1;
        } else {
            accepted.remove(i);
        }
    }
}

/// Drops terms that no longer earn their place next to the newest.
fn prune(base: &Base, data: &Data, split: &Split, accepted: &mut Vec<Candidate>) {
    let mut i = 0;
    while accepted.len() > 1 && i + 1 < accepted.len() {
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        let again = Judge::new(base, data, split, &others).judge(accepted[i].clone());
        if again.score < LEAST_SCORE {
            accepted.remove(i);
        } else {
            i += 1;
        }
    }
}
