//! Best candidates brought to their own shape and strength before they are compared.
//!
//! Modes and reliefs have a shape to be searched; where the response is not proportional to the strength, the
//! declared equations are simulated at the strength found. Cost: a simulation of every run per step, for the few
//! candidates that may win.

use super::accept;
use super::base_fit::{Base, RunState};
use super::candidate::{Candidate, Tuning};
use super::judge::{Judge, Judged};
use super::least_squares::Data;
use super::library::Bench;
use super::library::finite::Company;
use super::library::mesh::refine_relief;
use super::library::order::moved;
use super::library::path::refine_mode;
use super::refusal::Refusal;
use crate::effects::hypothesis::{Seat, Tooth, Wave};
use std::collections::BTreeMap;

/// Gain from which a first-order template's own error may decide: below it a few percent of form error are within
/// chance.
const FINITE_GAIN: f64 = 300.0;
/// A candidate's share of the best score from which its response at finite strength could still make it the best.
const FINITE_SHARE: f64 = 0.8;
/// Score from which contacts carried along by a shaft are always simulated, at several strengths.
pub const STRONG_SCORE: f64 = 3000.0;
/// Change of strength from the first-order template to the simulated one from which other strengths are tried, too.
const LEAST_BEND: f64 = 0.1;
/// Share of the best simulated score below which a candidate is simulated once only.
const LEADER_SCORE_SHARE: f64 = 0.9;
/// Change of the strength below which it is taken as found.
const MAX_STRENGTH_CHANGE: f64 = 0.002;
/// Largest change of the strength's logarithm by the secant.
const LARGEST_STEP: f64 = 1.0;
/// Most candidates simulated in a round.
const MAX_SIMULATED_CANDIDATES: usize = 4;

/// Strengths found by name and order, in ten-thousandths: a search that begins again begins with them.
pub type Strengths = BTreeMap<(String, i64), f64>;

/// Whether it claims a strength that cannot be, or a swing of the shaft that the tachometer would have seen.
///
/// # Errors
/// The gate's refusal.
pub fn refuted(base: &Base, judged: &Judged) -> Result<(), Refusal> {
    accept::makes_sense(judged.candidate.is_possible(&judged.x))?;
    let Some(order) = judged.candidate.order.filter(|_| judged.candidate.has_wave(Wave::Position)) else {
        return Ok(());
    };
    let [a, b] = judged.x[..] else { return Ok(()) };
    let amplitude_rad = a.hypot(b) * std::f64::consts::TAU / f64::from(base.machine.teeth[0]);
    let duration_s = base.analyser.duration_s();
    let refutes = |r: &&RunState| r.angle.refutes(order, amplitude_rad, base.pulses_per_rev, duration_s);
    accept::seen_by_tachometer(base.runs.iter().filter(refutes).count(), base.runs.len())
}

/// Improves the shape of the best candidates that have one.
pub fn tune(bench: &Bench<'_>, judge: &Judge<'_>, judged: &mut [Judged]) {
    let score = |c: Candidate| {
        let judged = judge.judge(c);
        if judged.candidate.is_possible(&judged.x) { judged.score } else { f64::NEG_INFINITY }
    };
    let fastest = bench.angles.iter().map(|a| a.1).fold(0.0, f64::max);
    let per_bin = 1.0 / (bench.base.analyser.duration_s() * fastest);
    let best = judged.first().map_or(0.0, |j| j.score);
    let mut relief = [false; 2];
    for j in judged.iter_mut().take(16) {
        match j.candidate.tuning {
            Some(Tuning::Mode { channel, f0, zeta }) if j.score > 0.6 * best => {
                let (name, claim) = (j.candidate.name.clone(), j.candidate.claim);
                *j = judge.judge(Candidate { name, claim, ..refine_mode(bench, (channel, f0, zeta), score) });
            }
            Some(Tuning::Relief { exponent, .. }) if j.score > 0.2 * best && !relief[exponent as usize - 1] => {
                relief[exponent as usize - 1] = true;
                *j = judge.judge(refine_relief(bench, exponent, score));
            }
            Some(Tuning::Order { seat }) if j.score > 0.8 * best => {
                // Lines of single runs place an order to a good part of a bin, all lines of all runs together far
                // more finely.
                let Some(first) = j.candidate.order else { continue };
                for step in [0.12, 0.04, 0.013] {
                    let at = j.candidate.order.unwrap_or(first);
                    let near = [-2.0, -1.0, 1.0, 2.0].map(|i| at + i * step * per_bin);
                    let tried = near.map(|order| judge.judge_started(moved(bench, &j.candidate, seat, order), None));
                    let top = tried.into_iter().max_by(|a, b| a.score.total_cmp(&b.score));
                    *j = top.filter(|t| t.score > j.score).unwrap_or_else(|| j.clone());
                }
            }
            _ => {}
        }
    }
}

/// Whether contacts are carried along by a shaft's own order.
fn carried(bench: &Bench<'_>, judged: &Judged) -> bool {
    let candidate = &judged.candidate;
    (candidate.has_wave(Wave::RollingDisplacement) || candidate.has_wave(Wave::Position))
        && bench.shaft_orders()[..2].iter().any(|o| candidate.order == Some(*o))
}

/// Whether its response at its own strength may yet make it the best, next to a `best` score.
pub fn may_win(bench: &Bench<'_>, best: f64, judged: &Judged) -> bool {
    let candidate = &judged.candidate;
    let is_simulated = candidate.bends() && !candidate.phase_free && judged.gain > FINITE_GAIN && !judged.x.is_empty();
    is_simulated && (judged.score > FINITE_SHARE * best || best > STRONG_SCORE && carried(bench, judged))
}

/// Replaces first-order templates of strong candidates by simulated ones, for as many as may still win.
///
/// Contacts carried along their path by a few percent of a pitch turn the high mesh orders by radians: a first-order
/// fit then sees a part of the strength only, and several strengths are tried.
pub fn at_their_strength(
    bench: &Bench<'_>,
    judge: &Judge<'_>,
    data: &Data,
    company: &Company,
    found: &mut Strengths,
    judged: &mut [Judged],
) {
    let best = judged.iter().map(|j| j.score).fold(0.0, f64::max);
    let mut chosen: Vec<usize> = (0..judged.len()).filter(|&i| may_win(bench, best, &judged[i])).collect();
    chosen.sort_by(|&a, &b| judged[b].score.total_cmp(&judged[a].score));
    chosen.truncate(MAX_SIMULATED_CANDIDATES);
    let mut leader = 0.0_f64;
    for (rank, &i) in chosen.iter().enumerate() {
        let first_order = judged[i].candidate.clone();
        let at = |x: &[f64]| bench.at_strength(&first_order, x, data, company).map(|bent| judge.judge(bent));
        let key = (first_order.name.clone(), (1e4 * first_order.order.unwrap_or(0.0)).round() as i64);
        let known = found.get(&key).copied().filter(|_| best > STRONG_SCORE);
        let Some((simulated, now, bends)) = begun(&at, &judged[i], known, best > STRONG_SCORE) else { continue };
        if now.score <= judged[i].score - 1.0 {
            continue;
        }
        // Whoever may still lead gets the steps it needs, the others enough to compare.
        let steps = match now.score < LEADER_SCORE_SHARE * leader.max(now.score) {
            true => 0,
            false if rank == 0 || bends => 6,
            false => 1,
        };
        judged[i] = settled(&at, simulated, now, steps);
        leader = leader.max(judged[i].score);
        found.insert(key, size(&judged[i].x));
    }
}

/// Root of the summed squares: a strength, whatever its phase.
pub fn size(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// A candidate simulated for the first time: the strength, what the fit makes of it, and whether the two differ much.
///
/// A strength `known` from an earlier search is taken at once, else several are tried where the response bends and
/// much is at stake.
fn begun(
    at: &impl Fn(&[f64]) -> Option<Judged>,
    first_order: &Judged,
    known: Option<f64>,
    strong: bool,
) -> Option<(Vec<f64>, Judged, bool)> {
    let x = &first_order.x;
    let times = |factor: f64| -> Vec<f64> { x.iter().map(|v| v * factor).collect() };
    // Direction from the present fit: phases count from a start that may have changed.
    let mut simulated = known.map_or_else(
        || first_guess(&first_order.candidate, x),
        |known| x.iter().map(|v| v * known / size(x)).collect(),
    );
    let mut now = at(&simulated)?;
    let bends = (size(&now.x) / size(&simulated) - 1.0).abs() > LEAST_BEND;
    if bends && strong && known.is_none() {
        for stronger in [1.7, 3.0, 5.0].map(times) {
            if let Some(other) = at(&stronger).filter(|other| other.score > now.score) {
                (now, simulated) = (other, stronger);
            }
        }
    }
    Some((simulated, now, bends))
}

/// The best of at most `steps` further simulations on the way to where the strength simulated and what the fit makes
/// of it agree.
fn settled(at: &impl Fn(&[f64]) -> Option<Judged>, simulated: Vec<f64>, now: Judged, steps: usize) -> Judged {
    let mut tried = (simulated, now.x.clone());
    let mut best = now;
    let mut before: Option<[f64; 2]> = None;
    for _ in 0..steps {
        let point = [size(&tried.0).ln(), (size(&tried.1) / size(&tried.0)).ln()];
        let step = next_step(point, before);
        let next: Vec<f64> = tried.1.iter().map(|v| v * (step - point[1]).exp()).collect();
        before = Some(point);
        let Some(again) = at(&next) else { break };
        let moved: Vec<f64> = again.x.iter().zip(&next).map(|(a, b)| a - b).collect();
        let agree = size(&moved) < MAX_STRENGTH_CHANGE * size(&again.x);
        tried = (next, again.x.clone());
        if again.score > best.score - 1.0 {
            best = again;
        }
        if agree {
            break;
        }
    }
    best
}

/// Strength that a first-order fit stands for: a cracked tooth, being softer, deflects more.
pub fn first_guess(candidate: &Candidate, x: &[f64]) -> Vec<f64> {
    match (candidate.seat, x) {
        (Some(Seat::OneTooth(_, Tooth::Softened)), [loss]) if *loss > 0.0 => vec![loss / (1.0 + loss)],
        _ => x.to_vec(),
    }
}

/// Change of the strength's logarithm that makes fitted and simulated strength agree, from the point (logarithm of
/// the simulated strength, of fitted over simulated) and the one before: the fit's own at first, then the secant
/// through both.
///
/// The fit's own would swing about a strong crack's loss for ever: a tooth's response grows as `loss / (1 - loss)`.
fn next_step(point: [f64; 2], before: Option<[f64; 2]>) -> f64 {
    let Some(before) = before else { return point[1] };
    let slope = (point[1] - before[1]) / (point[0] - before[0]);
    let step = -point[1] / slope;
    if step.is_finite() && step.abs() < LARGEST_STEP && step * point[1] > 0.0 { step } else { 0.5 * point[1] }
}
