//! One tooth of a gear: every order of its shaft, because a pulse once per turn is wide.
//!
//! Lines: all whole orders of the shaft that are no mesh harmonic. What decides: the lines stand everywhere (more
//! than the sidebands next to the mesh), and the synchronous average of the shaft, less mesh, first sidebands and low
//! orders, has most of its energy in one tooth pitch and its neighbours, the same one on turns not fitted. Where the
//! energy lies on many teeth it is a pattern of the pitch and no single tooth. A crack, a chip and a pitch error of
//! one tooth differ in the pulse's shape, which an unknown path hides. Averages are the analysis' ([`average`]).

use super::Context;
use crate::analysis::angle::Angle;
use crate::analysis::average;
use crate::candidate::{Candidate, Domain, Kind, Place, Shaft};
use crate::scene::Scene;
use crate::split::{Split, Stretch};
use meshband::indicators::RunEnsemble;

/// Share of the energy above the median pitch's that one tooth and its neighbours must hold.
const MIN_TOOTH_ENERGY_SHARE: f64 = 0.5;
/// Energy of the strongest pitch over the median one's.
const MIN_MEDIAN_RATIO: f64 = 2.5;

/// All orders of either shaft.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    Shaft::PAIR_SHAFTS.into_iter().map(|shaft| candidate(context, shaft)).filter(|c| !c.places.is_empty()).collect()
}

/// All orders of one shaft.
pub fn candidate(context: &Context, shaft: Shaft) -> Candidate {
    let scene = context.scene;
    let own = scene.shaft_order(shaft as usize);
    let places = (1..=(scene.highest_order / own) as usize)
        .map(|n| (n, n as f64 * own))
        .filter(|(_, order)| !(context.on_mesh(*order) || shaft == Shaft::Gear && context.on_pinion(*order)))
        .map(|(n, order)| Place { order, spacing: own, label: format!("{n} {}", shaft.word()) });
    Candidate {
        kind: Kind::Pattern(shaft),
        base: own,
        domain: Domain::Orders,
        places: places.collect(),
        locked: true,
        alternatives: 1.0,
    }
}

/// Where the energy of a shaft's average lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Tooth pitch with most energy, counted from angle 0.
    pub tooth: usize,
    /// Its energy over the median pitch's.
    pub over_median: f64,
    /// Share of the energy above the median's that it and its neighbours hold.
    pub share: f64,
}

impl Pulse {
    /// Of the energy of every tooth pitch; none where nothing stands over the median.
    pub fn of(energy: &[f64]) -> Option<Self> {
        let teeth = energy.len();
        let mut sorted = energy.to_vec();
        sorted.sort_by(f64::total_cmp);
        let median = *sorted.get(teeth / 2)?;
        let tooth = (0..teeth).max_by(|&a, &b| energy[a].total_cmp(&energy[b]))?;
        let above: f64 = energy.iter().map(|e| (e - median).max(0.0)).sum();
        let near: f64 = [teeth - 1, 0, 1].iter().map(|d| (energy[(tooth + d) % teeth] - median).max(0.0)).sum();
        (above > 0.0 && median > 0.0).then(|| Self { tooth, over_median: energy[tooth] / median, share: near / above })
    }

    /// This one, of fitted turns, if it is one tooth of so many, and the same one or its neighbour on those held out.
    pub fn on_one_tooth(self, teeth: usize, held_out: impl FnOnce() -> Option<Self>) -> Option<Self> {
        if self.share < MIN_TOOTH_ENERGY_SHARE || self.over_median < MIN_MEDIAN_RATIO {
            return None;
        }
        let is_elsewhere = |held: Self| (held.tooth + teeth + 1 - self.tooth) % teeth > 2;
        (!held_out().is_some_and(is_elsewhere)).then_some(self)
    }
}

/// The pulse of a shaft on some stretches, all channels.
pub fn pulse(scene: &Scene, shaft: Shaft, stretches: impl Fn(&Split) -> &[Stretch]) -> Option<Pulse> {
    let teeth = scene.teeth[shaft as usize] as usize;
    let mut energy = vec![0.0; teeth];
    for run in &scene.runs {
        for stretch in stretches(&run.split) {
            let angle = piece(&run.angle, *stretch);
            for samples in &run.samples {
                let mut ensembles = [RunEnsemble::default(); 2];
                let part = &samples[stretch.samples(run.angle.per_turn[0])];
                let averages = average::averages(part, &angle, scene.teeth, &mut ensembles);
                let difference = averages[shaft as usize].difference.iter().map(|x| f64::from(*x));
                add_normalised(&mut energy, &difference.collect::<Vec<f64>>());
            }
        }
    }
    Pulse::of(&energy)
}

/// Whether the shaft's pattern is one tooth: on the fitted turns, and the same tooth or its neighbour on those held
/// out.
pub fn is_single(scene: &Scene, shaft: Shaft) -> Option<Pulse> {
    let fitted = pulse(scene, shaft, |split| &split.fit)?;
    fitted.on_one_tooth(scene.teeth[shaft as usize] as usize, || pulse(scene, shaft, |split| &split.held_out))
}

/// The angle of a stretch alone.
pub fn piece(angle: &Angle, stretch: Stretch) -> Angle {
    Angle { from_turn: angle.from_turn + stretch.from as f64, turns: stretch.turns, ..angle.clone() }
}

/// Adds the energy of a difference signal over one turn to that of the pitches, as shares of its whole.
pub fn add_normalised(energy: &mut [f64], difference: &[f64]) {
    let total: f64 = difference.iter().map(|x| x * x).sum();
    if total <= 0.0 {
        return;
    }
    let teeth = energy.len();
    for (i, x) in difference.iter().enumerate() {
        energy[i * teeth / difference.len()] += x * x / total;
    }
}
