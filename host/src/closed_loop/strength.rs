//! Best candidates brought to their own shape and strength before they are compared.
//!
//! Modes and reliefs have a shape to be searched; where the response is not proportional to the strength, the declared equations are
//! simulated at the strength found. Cost: a simulation of every run per step, for the few candidates that may win.

use super::base_fit::{Base, RunState};
use super::candidate::{Candidate, Finite, Tuning};
use super::judge::{Judge, Judged};
use super::least_squares::Data;
use super::library::Bench;
use super::library::mesh::refine_relief;
use super::library::path::refine_mode;

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

/// Whether a swing of the shaft is claimed that the tachometer would have seen.
pub fn refuted_by_tachometer(base: &Base, judged: &Judged) -> bool {
    let Some(Finite::PositionModulation { order }) = judged.candidate.finite else { return false };
    let [a, b] = judged.x[..] else { return false };
    let amplitude_rad = a.hypot(b) * std::f64::consts::TAU / f64::from(base.machine.teeth[0]);
    let duration_s = base.analyser.duration_s();
    let refutes = |r: &&RunState| r.angle.refutes(order, amplitude_rad, base.pulses_per_rev, duration_s);
    2 * base.runs.iter().filter(refutes).count() > base.runs.len()
}

/// Improves the shape of the best candidates that have one.
pub fn tune(bench: &Bench<'_>, judge: &Judge<'_>, judged: &mut [Judged]) {
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
pub fn at_their_strength(bench: &Bench<'_>, judge: &Judge<'_>, data: &Data, judged: &mut [Judged]) {
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
