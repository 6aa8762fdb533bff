//! What families that follow no shaft predict: the power at their lines on the turns not used, and what surrogates
//! of them would take.
//!
//! A line takes its excess over the floor within a few bins, never more than was predicted from the fitted turns, and
//! no bin is taken twice however many lines fall on it. The control is the same with every spacing moved by 1 to 6 %,
//! its lines chosen on the fitted turns by the same rule: the share that as many lines at wrong places take. Lines at
//! the real places are left to the real family.

use super::accept;
use super::bearing_slip;
use super::candidate::{Taken, moved_order};
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::Adopted;
use super::spectra::Spectra;
use super::split::Stretch;
use rayon::prelude::*;

/// Bins on each side of a nonsynchronous line whose power is its own.
const LINE_BINS: f64 = 3.5;

/// Stretches of orders that are spoken for, in the order taken.
#[derive(Default)]
struct Covered(Vec<(f64, f64)>);

impl Covered {
    fn holds(&self, order: f64) -> bool {
        self.0.iter().any(|(low, high)| (*low..*high).contains(&order))
    }
}

/// Mean square of samples on some stretches.
pub fn power(samples: &[f64], per_turn: usize, stretches: &[Stretch]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for stretch in stretches {
        let part = &samples[stretch.samples(per_turn)];
        sum += part.iter().map(|x| x * x).sum::<f64>();
        count += part.len();
    }
    sum / count.max(1) as f64
}

/// Share of the held-out power that nonsynchronous families predicted and that was there, by run and channel, with
/// their spacings moved by a share.
pub fn nonsynchronous_share(scene: &Scene, views: [&Views; 2], adopted: &[&Adopted], moved: f64) -> Vec<Vec<f64>> {
    let nonsynchronous: Vec<&Adopted> = adopted.iter().copied().filter(|a| !a.candidate.locked).collect();
    let excluded = bearing_slip::excluded(adopted, scene, views[1]);
    let lines: Vec<Vec<[f64; 2]>> =
        nonsynchronous.iter().map(|own| orders(own, views, scene, moved, &excluded)).collect();
    let explained = |r: usize, c: usize| -> f64 {
        let run = &scene.runs[r];
        let total = power(&run.samples[c], run.angle.per_turn[0], &run.split.held_out);
        let mut covered: [Covered; 4] = Default::default();
        let mut sum = 0.0;
        for (own, lines) in nonsynchronous.iter().zip(&lines) {
            let domain = own.candidate.domain;
            let covered = &mut covered[domain as usize];
            let [fit, held] = [0, 1].map(|i| views[i].of(domain));
            let level = own.verdict.score.level;
            let half = LINE_BINS * fit.bin(level);
            if moved != 0.0 {
                let real = own.candidate.places.iter().zip(&own.verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
                covered.0.extend(real.map(|(place, _)| (place.order - half, place.order + half)));
            }
            for &order in lines {
                let predicted = excess(fit, (r, c), level, (order[0], half), covered);
                let found = excess(held, (r, c), level, (order[1], half), covered);
                sum += predicted.min(found).max(0.0);
                covered.0.push((order[1] - half, order[1] + half));
            }
        }
        sum / total.max(f64::MIN_POSITIVE)
    };
    let channels = scene.channels.len();
    (0..scene.runs.len()).map(|r| (0..channels).into_par_iter().map(|c| explained(r, c)).collect()).collect()
}

/// Mean square above the floor about an order, without the bins that are covered.
fn excess(spectra: &Spectra, (r, c): (usize, usize), level: usize, line: (f64, f64), covered: &Covered) -> f64 {
    let (order, half) = line;
    let levels = &spectra.levels[r][c];
    let Some(level) = levels.get(level.min(levels.len().saturating_sub(1))) else { return 0.0 };
    let bin = level.density.bin;
    let first = ((order - half) / bin).ceil().max(0.0) as usize;
    let last = ((order + half) / bin).floor().max(0.0) as usize;
    let near = covered.0.iter().filter(|(low, high)| *high > order - half && *low < order + half).copied();
    let near = Covered(near.collect());
    (first..=last.min(level.floor.len().saturating_sub(1)))
        .filter(|i| !near.holds(*i as f64 * bin))
        .map(|i| (level.density.values[i] - level.floor[i]) * bin)
        .sum()
}

/// Orders of a family's lines that stand on the fitted turns of the channels searched, its own or of a surrogate:
/// there, and on the turns not used, where the base may have slipped. `excluded` are the real families' lines,
/// which no copy may slip to.
pub fn orders(own: &Adopted, views: [&Views; 2], scene: &Scene, moved: f64, excluded: &Taken) -> Vec<[f64; 2]> {
    if moved == 0.0 {
        return own.standing().map(|place| [place.order, place.order + own.off(place)]).collect();
    }
    let spectra = views[0].of(own.candidate.domain);
    let level = own.verdict.score.level;
    let strength = |order: f64| -> f64 {
        let readings = (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c)));
        let of = |(r, c): (usize, usize)| spectra.reading(r, c, level, order, 1).map(|reading| reading.ln_bayes());
        readings.filter_map(of).sum()
    };
    let copies =
        own.candidate.places.iter().map(|p| [moved_order(p, moved, spectra.bin(level)), own.candidate.lever(p)]);
    let lines: Vec<[f64; 2]> = copies.filter(|[order, _]| strength(*order) > 0.0).collect();
    let slip = if bearing_slip::may_slip(own, scene) {
        bearing_slip::slip(&lines, own, excluded, scene, views[1]).share
    } else {
        0.0
    };
    lines.into_iter().map(|[order, lever]| [order, order + slip * lever]).collect()
}

/// What surrogates take, channel by channel: median and largest.
pub fn controls(scene: &Scene, views: [&Views; 2], adopted: &[&Adopted]) -> Vec<[f64; 2]> {
    let copies: Vec<Vec<Vec<f64>>> =
        accept::displacements().map(|moved| nonsynchronous_share(scene, views, adopted, moved)).collect();
    let of_channel = |c: usize| {
        let mean = |runs: &Vec<Vec<f64>>| runs.iter().map(|run| run[c]).sum::<f64>() / runs.len().max(1) as f64;
        let mut shares: Vec<f64> = copies.iter().map(mean).collect();
        shares.sort_by(f64::total_cmp);
        [shares[shares.len() / 2], shares[shares.len() - 1]]
    };
    (0..scene.channels.len()).map(of_channel).collect()
}
