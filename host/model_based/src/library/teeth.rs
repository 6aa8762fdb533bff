//! Effects carried by single teeth: pitch errors and stiffness loss (crack), for both gears.
//!
//! The response to one tooth's error repeats, shifted by whole teeth, for every other tooth. Its orders fall into
//! families `m + n z`; tooth `i` enters family `m` with the phase `exp(-2 pi i m i / z)`, so one response per family
//! serves a single tooth, every single tooth, and a free table of all teeth.

use super::Bench;
use crate::base_fit::Base;
use crate::candidate::{Candidate, Claim, Parameter, Template, Tuning, quadrature};
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Seat, Tooth};
use crate::judge::Split;
use crate::least_squares::{Column, Data, normal};
use crate::machine::Hunting;
use crate::model::forward::Line;
use crate::observation::spectrum::Sparse;
use crate::start::{Start, relative};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

struct Families {
    kind: Tooth,
    shaft: usize,
    /// Family 0: the mesh orders' share of one tooth.
    mesh: Template,
    /// Families 1..=z/2 as quadrature pairs.
    pairs: Vec<[Template; 2]>,
}

/// Responses of all tooth families.
pub struct ToothFamilies {
    all: Vec<Families>,
}

impl ToothFamilies {
    /// Computes the responses of both kinds on both gears.
    pub fn new(base: &Base, angles: &[(f64, f64)]) -> Self {
        let machine = &base.machine;
        let z1 = f64::from(machine.teeth[0]);
        let longest = base.runs.iter().map(|r| machine.harmonics(r.angle.shaft_hz)).max().unwrap_or(24);
        let mut all = Vec::new();
        for shaft in 0..2 {
            let z = machine.teeth[shaft];
            // Lines of every family and run, both kinds.
            let lines: Vec<[Vec<Vec<Line>>; 2]> = (0..=z / 2)
                .into_par_iter()
                .map(|m| {
                    let nu = f64::from(m) / f64::from(z);
                    let table: Vec<C> =
                        (-2 * longest..=2 * longest).map(|i| machine.curve.transform(nu + i as f64)).collect();
                    let at = |i: i64| table[(i + 2 * longest) as usize];
                    let fold = if m == 0 || 2 * m == z { 1.0 } else { 2.0 };
                    let scale = -fold / f64::from(z);
                    let mut kinds = [Vec::new(), Vec::new()];
                    for run in &base.runs {
                        let comb = machine.comb(nu * z1, run.angle.shaft_hz);
                        let half = comb.centre as i64;
                        let size = comb.orders.len();
                        let displacement: Vec<C> = (0..size).map(|n| at(n as i64 - half) * scale).collect();
                        let loss: Vec<C> = (0..size)
                            .map(|n| {
                                let sum: C = (0..size).map(|l| run.inner.approach[l] * at(n as i64 - l as i64)).sum();
                                sum * scale
                            })
                            .collect();
                        for (kind, contact) in [displacement, loss].iter().enumerate() {
                            kinds[kind].push(machine.respond(&comb, &[], contact).lines);
                        }
                    }
                    kinds
                })
                .collect();
            for (index, kind) in [Tooth::Displaced, Tooth::Softened].into_iter().enumerate() {
                let mut pairs: Vec<[Template; 2]> =
                    lines.par_iter().map(|family| quadrature(&base.analyser, angles, &family[index])).collect();
                let [mesh, _] = pairs.remove(0);
                // One tooth's mean deflection sign: a loss of stiffness acts as a negative contact force.
                all.push(Families { kind, shaft, mesh, pairs });
            }
        }
        Self { all }
    }

    /// Best single tooth of each kind and gear, and free tables of all teeth.
    pub fn candidates(&self, bench: &Bench<'_>, data: &Data, split: &Split, turns: Option<&[u32]>) -> Vec<Candidate> {
        let mut list = self.singles(bench, data, split, turns);
        list.extend(self.all.iter().map(|families| families.table(bench)));
        list
    }

    /// Best single tooth of each kind and gear.
    ///
    /// The gear's single tooth is tried as counted, as `turns` tell, and with every run started where it fits best.
    pub fn singles(&self, bench: &Bench<'_>, data: &Data, split: &Split, turns: Option<&[u32]>) -> Vec<Candidate> {
        let teeth = bench.base.machine.teeth;
        let hunting = Hunting::of(teeth);
        let mut list = Vec::new();
        for families in &self.all {
            let likeness = families.likeness(teeth[families.shaft], data);
            let mut starts = vec![likeness.best(&split.fit, Start::Counted, teeth)];
            if families.shaft == 1 && hunting.turns > 1 {
                starts.extend(turns.map(|t| likeness.best(&split.fit, Start::Given(t.to_vec()), teeth)));
                let fitted = likeness.best_started(&split.fit, teeth, hunting);
                let is_new = |(tooth, start): &(u32, Start)| *tooth != fitted.0 || start.turns() != fitted.1.turns();
                if starts.iter().all(is_new) {
                    starts.push(fitted);
                }
            }
            list.extend(starts.into_iter().map(|(tooth, start)| families.single(bench, tooth, start)));
        }
        list
    }

    /// Each kind on one tooth of a body, with the runs started as `start` says.
    pub fn at(&self, bench: &Bench<'_>, body: usize, tooth: u32, start: &Start) -> Vec<Candidate> {
        let own = self.all.iter().filter(|families| families.shaft == body);
        own.map(|families| families.single(bench, tooth, start.clone())).collect()
    }
}

/// The effect of the registry that sits on one tooth of a body.
fn one_tooth(body: usize, kind: Tooth) -> &'static Hypothesis {
    let own = |h: &&Hypothesis| matches!(h.seats, [Seat::OneTooth(b, k)] if *b == body && *k == kind);
    hypotheses().find(own).expect("an effect sits on one tooth")
}

/// The effect of the registry that displaces every tooth of a body.
fn every_tooth(body: usize) -> &'static Hypothesis {
    hypotheses()
        .find(|h| matches!(h.seats, [Seat::EveryTooth(b)] if *b == body))
        .expect("an effect displaces every tooth")
}

impl Families {
    /// Powers of speed and torque of one tooth's excitation.
    fn exponents(&self) -> [f64; 2] {
        if self.kind == Tooth::Displaced { [0.0, 0.0] } else { [0.0, 1.0] }
    }

    /// A value of its own for every tooth.
    fn table(&self, bench: &Bench<'_>) -> Candidate {
        let shaft = ["pinion", "gear"][self.shaft];
        let order = [1.0, bench.ratio()][self.shaft];
        let displaced = self.kind == Tooth::Displaced;
        let (name, claim) = match self.kind {
            Tooth::Displaced => (every_tooth(self.shaft).name.into(), Claim::Named),
            Tooth::Softened => (format!("periodic stiffness change over one {shaft} turn"), Claim::Generic),
        };
        let unit = one_tooth(self.shaft, self.kind).unit;
        let parameter =
            |m: usize| Parameter { name: format!("tooth_table_harmonic_{}", m + 1), unit, first: 2 * m, complex: true };
        Candidate {
            name,
            claim,
            family: "shaft-order",
            shaft,
            order: Some(order),
            parameters: (0..self.pairs.len()).map(parameter).collect(),
            templates: self.pairs.iter().flatten().cloned().collect(),
            exponents: self.exponents(),
            hypothesis: displaced.then(|| every_tooth(self.shaft)),
            pair_orders: (1..=self.pairs.len()).map(|m| m as f64 * order).collect(),
            plain: displaced.then(|| every_tooth(self.shaft).plain.into()),
            ..Candidate::default()
        }
    }

    /// One tooth, with the runs started as `start` says.
    fn single(&self, bench: &Bench<'_>, tooth: u32, start: Start) -> Candidate {
        let teeth = bench.base.machine.teeth;
        let (z, single) = (teeth[self.shaft], one_tooth(self.shaft, self.kind));
        Candidate {
            name: single.name.into(),
            claim: Claim::Named,
            family: "shaft-order",
            shaft: ["pinion", "gear"][self.shaft],
            order: Some([1.0, bench.ratio()][self.shaft]),
            parameters: vec![Parameter {
                name: format!("{} of tooth {tooth}", single.quantity),
                unit: single.unit,
                first: 0,
                complex: false,
            }],
            templates: vec![self.tooth(|run| seen_as(tooth, &start, run, teeth), z, bench.base.analyser.bins)],
            searched: f64::from(z),
            exponents: self.exponents(),
            hypothesis: Some(single),
            seat: Some(Seat::OneTooth(self.shaft, self.kind)),
            tuning: (self.kind == Tooth::Softened).then_some(Tuning::Growth { growth: 0.0, bow: 0.0 }),
            tooth: Some(tooth),
            start,
            ..Candidate::default()
        }
    }

    /// What every tooth's error has in common with the residual of every run, families taken as orthogonal.
    fn likeness(&self, z: u32, data: &Data) -> Likeness {
        let right: Vec<Vec<[f64; 2]>> = self
            .pairs
            .par_iter()
            .map(|pair| {
                let of = |r: usize, i: usize| {
                    normal(data, &[r], &[Column { template: &pair[i], prior: (0.0, 0.0) }]).right[0]
                };
                (0..data.residual.len()).map(|r| [of(r, 0), of(r, 1)]).collect()
            })
            .collect();
        let value = |run: usize, tooth: u32| -> f64 {
            right
                .iter()
                .enumerate()
                .map(|(m, b)| {
                    let phase = -TAU * (m as f64 + 1.0) * f64::from(tooth) / f64::from(z);
                    phase.cos() * b[run][0] + phase.sin() * b[run][1]
                })
                .sum()
        };
        Likeness((0..data.residual.len()).map(|run| (0..z).map(|tooth| value(run, tooth)).collect()).collect())
    }

    fn tooth(&self, tooth: impl Fn(usize) -> u32, z: u32, bins: usize) -> Template {
        let runs = (0..self.mesh.runs.len()).map(|r| {
            [0, 1].map(|c| {
                let mut dense = vec![C::ZERO; bins];
                self.mesh.runs[r][c].iter().for_each(|(b, t)| dense[b] += t);
                for (m, pair) in self.pairs.iter().enumerate() {
                    let phase = -TAU * (m as f64 + 1.0) * f64::from(tooth(r)) / f64::from(z);
                    for (part, factor) in pair.iter().zip([phase.cos(), phase.sin()]) {
                        part.runs[r][c].iter().for_each(|(b, t)| dense[b] += t * factor);
                    }
                }
                Sparse::of(&dense)
            })
        });
        Template::new(runs)
    }
}

/// The tooth that a run counted from its pulse 0 shows in the place of `tooth`: a turn of the pinion brings the gear
/// on by the pinion's teeth.
fn seen_as(tooth: u32, start: &Start, run: usize, teeth: [u32; 2]) -> u32 {
    let [z1, z] = teeth.map(i64::from);
    let later = start.turns().map_or(0, |turns| i64::from(turns[run]));
    (i64::from(tooth) - z1 * later).rem_euclid(z) as u32
}

/// Product of every run's residual with every tooth's response: `[run][tooth]`.
struct Likeness(Vec<Vec<f64>>);

impl Likeness {
    /// Tooth that the runs to `fit` resemble most with this start.
    fn best(&self, fit: &[usize], start: Start, teeth: [u32; 2]) -> (u32, Start) {
        let value = |tooth: u32| -> f64 {
            let of = |&r: &usize| {
                let counted = if start == Start::Counted { tooth } else { seen_as(tooth, &start, r, teeth) };
                self.0[r][counted as usize]
            };
            fit.iter().map(of).sum::<f64>().abs()
        };
        let count = self.0.first().map_or(0, Vec::len) as u32;
        let tooth = (0..count).max_by(|&a, &b| value(a).total_cmp(&value(b))).unwrap_or(0);
        (tooth, start)
    }

    /// Tooth of the gear and start of every run that the runs to `fit` resemble most; the others start where they do
    /// themselves.
    fn best_started(&self, fit: &[usize], teeth: [u32; 2], hunting: Hunting) -> (u32, Start) {
        let [z1, z] = teeth;
        let shown = |tooth: u32, k: u32| (tooth + (z - z1 * k % z)) % z;
        let start = |run: usize, tooth: u32, sign: f64| -> (u32, f64) {
            let all = (0..hunting.turns).map(|k| (k, sign * self.0[run][shown(tooth, k) as usize]));
            all.fold((0, f64::NEG_INFINITY), |top, next| if next.1 > top.1 { next } else { top })
        };
        // Teeth that never take each other's place.
        let classes = (0..z / hunting.turns).flat_map(|tooth| [(tooth, 1.0), (tooth, -1.0)]);
        let value = |(tooth, sign): (u32, f64)| fit.iter().map(|&r| start(r, tooth, sign).1).sum::<f64>();
        let (tooth, sign) = classes.max_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or((0, 1.0));
        let turns: Vec<u32> = (0..self.0.len()).map(|run| start(run, tooth, sign).0).collect();
        (shown(tooth, turns[0]), relative(turns, hunting))
    }
}
