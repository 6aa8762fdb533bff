//! Effects that repeat with every tooth pair: wear, tip relief, profile error, friction.

use super::Responses;
use crate::candidate::{Candidate, Claim, Parameter, Template, Tuning, quadrature};
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Seat};
use crate::model::harmonic_balance::{DOF, GEAR, PINION};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Shares of the path that a relief is tried with before it is refined.
const RELIEF_SHARES: [f64; 8] = [0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4];
/// Least share of the path in a scan.
const NARROWEST_RELIEF: f64 = 0.03;
/// Step of a scan.
const SCAN_STEP: f64 = 0.005;
/// Peaks of a scan that are climbed.
const MOST_PEAKS: usize = 5;
/// Step at which a share is found.
const FINEST_STEP: f64 = 5e-4;

/// Candidates on the mesh's own comb.
pub fn candidates(bench: &Responses<'_>) -> Vec<Candidate> {
    let mut list = Vec::new();
    for hypothesis in hypotheses() {
        for seat in hypothesis.seats {
            match *seat {
                Seat::EveryPair(over_path) => list.push(shaped(bench, hypothesis, 1.0, &over_path)),
                Seat::Ends => {
                    let all = [1, 2].into_iter().flat_map(|exponent| RELIEF_SHARES.map(|share| (share, exponent)));
                    list.extend(all.map(|(share, exponent)| relief(bench, share, exponent)));
                }
                Seat::MeshOrders(count) => list.push(shape(bench, Shape::Orders(hypothesis, count))),
                Seat::Sliding => list.push(friction(bench, hypothesis)),
                _ => {}
            }
        }
    }
    list.extend([Shape::FreeDisplacement, Shape::Stiffness, Shape::FreeStiffness].map(|s| shape(bench, s)));
    list
}

/// The first-order response of this machine to the same deviation of every pair as that of `candidate`; none where it
/// is no effect that every pair has.
pub fn on(machine: &Responses<'_>, candidate: &Candidate) -> Option<Candidate> {
    let hypothesis = candidate.hypothesis.filter(|_| candidate.claim == Claim::Named)?;
    hypothesis.seats.iter().find_map(|seat| match (*seat, candidate.tuning) {
        (Seat::EveryPair(over_path), _) => Some(shaped(machine, hypothesis, 1.0, &over_path)),
        (Seat::Ends, Some(Tuning::Relief { share, exponent })) => Some(relief(machine, share, exponent)),
        (Seat::MeshOrders(count), _) => Some(shape(machine, Shape::Orders(hypothesis, count))),
        (Seat::Sliding, _) => Some(friction(machine, hypothesis)),
        _ => None,
    })
}

/// Relief of both ends of the path over `share` of it, linear (exponent 1) or parabolic (2).
pub fn relief(bench: &Responses<'_>, share: f64, exponent: i32) -> Candidate {
    let ramp = move |x: f64| ((share - x) / share).max(0.0).powi(exponent);
    let hypothesis = hypotheses().find(|h| matches!(h.seats, [Seat::Ends])).expect("an effect relieves the ends");
    let mut relief = shaped(bench, hypothesis, 10.0, &move |x: f64| ramp(x) + ramp(1.0 - x));
    relief.tuning = Some(Tuning::Relief { share, exponent });
    relief
}

/// The share of the best `score`.
pub fn refine_relief(bench: &Responses<'_>, exponent: i32, score: impl Fn(Candidate) -> f64 + Sync) -> Candidate {
    let best = relief_peaks(bench, exponent, score).into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    relief(bench, best.map_or(NARROWEST_RELIEF, |(_, share)| share), exponent)
}

/// The highest peaks of a `score` over the share, with their shares: by a scan over all, since high mesh orders swing
/// with the share, then by pattern search from each, since what stands highest at the points of a scan need not be
/// the highest peak.
pub fn relief_peaks(bench: &Responses<'_>, exponent: i32, score: impl Fn(Candidate) -> f64 + Sync) -> Vec<(f64, f64)> {
    // A parabola over the whole path is wear.
    let widest = if exponent == 1 { 0.5 } else { 0.4 };
    let scored = |share: f64| match (NARROWEST_RELIEF..=widest).contains(&share) {
        true => score(relief(bench, share, exponent)),
        false => f64::NEG_INFINITY,
    };
    let points = (widest / SCAN_STEP).round() as usize;
    let scan: Vec<f64> = (0..=points + 1).into_par_iter().map(|i| scored(i as f64 * SCAN_STEP)).collect();
    let is_top = |i: &usize| scan[*i] >= scan[i - 1] && scan[*i] > scan[i + 1];
    let mut tops: Vec<usize> = (1..=points).filter(is_top).collect();
    tops.sort_by(|&a, &b| scan[b].total_cmp(&scan[a]));
    tops.truncate(MOST_PEAKS);
    let refined = |top: usize| {
        let mut best = (scan[top], top as f64 * SCAN_STEP);
        let mut step = 0.5 * SCAN_STEP;
        while step > FINEST_STEP {
            let next = [best.1 - step, best.1 + step].map(|share| (scored(share), share));
            match next.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).filter(|next| next.0 > best.0) {
                Some(next) => best = next,
                None => step *= 0.4,
            }
        }
        best
    };
    tops.into_par_iter().map(refined).collect()
}

/// Error of a given shape on every pair, contact force `-k(s) (e + tau de/dt)`; `shape` over 0..1 of the path.
fn shaped(
    bench: &Responses<'_>,
    hypothesis: &'static Hypothesis,
    searched: f64,
    shape: &(dyn Fn(f64) -> f64 + Sync),
) -> Candidate {
    let machine = &bench.base.machine;
    let curve = &machine.curve;
    let length = curve.contact_ratio();
    let weighted = curve.times(|u| shape(u / length));
    let step = 1e-4;
    let slope = curve.times(|u| (shape(u / length + step) - shape(u / length - step)) / (2.0 * step * length));
    let lines = bench.respond(
        |_| 0.0,
        |run, comb| {
            let rate = run.angle.shaft_hz * f64::from(machine.teeth[0]) * machine.tau_s;
            let half = comb.centre as i64;
            // Both signs of an order are conjugate for a real shape.
            let positive: Vec<C> =
                (0..=half).map(|n| -weighted.transform(n as f64) - slope.transform(n as f64) * rate).collect();
            let contact = (-half..=half)
                .map(|n| {
                    let value = positive[n.unsigned_abs() as usize];
                    if n < 0 { value.conj() } else { value }
                })
                .collect();
            vec![(Vec::new(), contact)]
        },
    );
    let [real, _] = quadrature(&bench.base.analyser, &bench.angles, &lines[0]);
    Candidate { searched, ..every_pair(hypothesis, machine.teeth, real, [0.0, 0.0]) }
}

/// The candidate of an effect with one strength that all pairs share.
fn every_pair(hypothesis: &'static Hypothesis, teeth: [u32; 2], template: Template, exponents: [f64; 2]) -> Candidate {
    Candidate {
        name: hypothesis.name.into(),
        claim: Claim::Named,
        family: "mesh-order",
        order: Some(f64::from(teeth[0])),
        parameters: vec![Parameter {
            name: hypothesis.quantity.into(),
            unit: hypothesis.unit,
            first: 0,
            complex: false,
        }],
        templates: vec![template],
        exponents,
        hypothesis: Some(hypothesis),
        ..Candidate::default()
    }
}

/// What repeats with every tooth pair, harmonic by harmonic.
#[derive(Clone, Copy)]
enum Shape {
    /// Displacement at the first few mesh orders: an effect of the registry.
    Orders(&'static Hypothesis, usize),
    /// Displacement of any shape over the pitch.
    FreeDisplacement,
    /// Mesh stiffness at the first few mesh orders.
    Stiffness,
    /// Mesh stiffness of any shape over the pitch.
    FreeStiffness,
}

impl Shape {
    fn harmonics(self) -> i64 {
        match self {
            Self::Orders(_, count) => count as i64,
            Self::Stiffness => 4,
            Self::FreeDisplacement | Self::FreeStiffness => 12,
        }
    }
}

/// Displacement of every pair, or (in proportion to torque) a change of mesh stiffness, with a free amplitude and
/// phase at each mesh order.
///
/// The free shapes contain wear, relief and any other error that all teeth share: what they gain over one of those
/// names says how far the name's shape is off.
fn shape(bench: &Responses<'_>, shape: Shape) -> Candidate {
    let machine = &bench.base.machine;
    let z = f64::from(machine.teeth[0]);
    let loaded = matches!(shape, Shape::Stiffness | Shape::FreeStiffness);
    let lines = bench.respond(
        |_| 0.0,
        |run, comb| {
            (1..=shape.harmonics())
                .map(|h| {
                    let omega = TAU * run.angle.shaft_hz * z * h as f64;
                    let rate = C::new(1.0, omega * machine.tau_s);
                    // Both signs of the order keep the rigid row's balance real; the pair's quadrature gives the phase.
                    let size = comb.orders.len() as i64;
                    let contact = (0..size)
                        .map(|n| {
                            if loaded {
                                run.inner.force.get((n - h) as usize).copied().unwrap_or(C::ZERO)
                            } else {
                                -machine.stiffness(n - comb.centre as i64 - h) * rate
                            }
                        })
                        .collect();
                    (Vec::new(), contact)
                })
                .collect()
        },
    );
    let (name, claim) = match shape {
        Shape::Orders(hypothesis, _) => (hypothesis.name, Claim::Named),
        Shape::FreeDisplacement => ("displacement error repeating with every tooth pair", Claim::Generic),
        Shape::Stiffness => ("mesh stiffness varying at mesh orders", Claim::Generic),
        Shape::FreeStiffness => ("mesh stiffness varying with every tooth pair", Claim::Generic),
    };
    Candidate {
        name: name.into(),
        claim,
        family: "mesh-order",
        order: Some(z),
        parameters: (0..shape.harmonics() as usize)
            .map(|h| Parameter {
                name: format!("{}_at_mesh_order_{}", if loaded { "share" } else { "displacement" }, h + 1),
                unit: if loaded { "1" } else { "m" },
                first: 2 * h,
                complex: true,
            })
            .collect(),
        templates: lines.iter().flat_map(|l| quadrature(&bench.base.analyser, &bench.angles, l)).collect(),
        hypothesis: match shape {
            Shape::Orders(hypothesis, _) => Some(hypothesis),
            _ => None,
        },
        exponents: [0.0, if loaded { 1.0 } else { 0.0 }],
        ..Candidate::default()
    }
}

/// Sliding friction across the line of action: its torques on both gears, `mu k(s) D lever sign(s - pitch)`.
fn friction(bench: &Responses<'_>, hypothesis: &'static Hypothesis) -> Candidate {
    let machine = &bench.base.machine;
    let [rb1, rb2] = machine.base_radius_m;
    let tangent = machine.pressure_angle_rad.tan();
    let facts = machine.facts(0.0);
    // Distance along the line of action from the pinion's tangent point.
    let pitch = rb1 * tangent;
    let start = pitch - facts.pitch_point_base_pitches * facts.base_pitch_m;
    let levers = [0, 1].map(|side| {
        machine.curve.times(|u| {
            let s = start + u * facts.base_pitch_m;
            let lever = if side == 0 { s } else { (rb1 + rb2) * tangent - s };
            lever * (s - pitch).signum()
        })
    });
    let lines = bench.respond(
        |_| 0.0,
        |run, comb| {
            let size = comb.orders.len() as i64;
            let tables = levers
                .each_ref()
                .map(|curve| (-(size - 1)..size).map(|n| curve.transform(n as f64)).collect::<Vec<C>>());
            let forces = (0..size)
                .map(|n| {
                    let mut f = [C::ZERO; DOF];
                    for l in 0..size {
                        let index = (n - l + size - 1) as usize;
                        // Sliding power, friction times (s1 th1' - s2 th2'), is lost: opposite signs.
                        f[PINION] -= tables[0][index] * run.inner.approach[l as usize];
                        f[GEAR] += tables[1][index] * run.inner.approach[l as usize];
                    }
                    f
                })
                .collect();
            vec![(forces, Vec::new())]
        },
    );
    let [real, _] = quadrature(&bench.base.analyser, &bench.angles, &lines[0]);
    let tuning = Some(Tuning::Transition { square: 0.0 });
    Candidate { tuning, ..every_pair(hypothesis, machine.teeth, real, [0.0, 1.0]) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base_fit::Base;
    use meshband_analysis::drawn;
    use meshband_analysis::generate::{self, Scenario};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn ref_the_highest_peak_between_the_points_of_a_scan_is_found_beside_one_on_a_point() {
        let mut random = ChaCha8Rng::seed_from_u64(1004);
        let declared = drawn::machine(&mut random).unwrap();
        let mut scenario = Scenario::null(&declared.shafts, 7);
        scenario.duration_s = 0.5;
        drawn::layout(&declared, &mut scenario, &mut random);
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
        let base = Base::new(&record);
        // Two peaks so narrow that the points of the scan beside the higher one stand below the other.
        let score = |candidate: Candidate| {
            let Some(Tuning::Relief { share, .. }) = candidate.tuning else { panic!("a relief has its share") };
            let peak = |top: f64, at: f64| top / (1.0 + ((share - at) / 0.002).powi(2));
            peak(100.0, 0.2525) + peak(70.0, 0.35)
        };
        let found = refine_relief(&Responses::new(&base), 1, score);
        let Some(Tuning::Relief { share, exponent: 1 }) = found.tuning else { panic!("{:?}", found.tuning) };
        assert!((share - 0.2525).abs() < 2.0 * FINEST_STEP, "{share}");
    }
}
