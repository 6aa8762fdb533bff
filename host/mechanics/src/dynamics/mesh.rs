//! The mesh over one step: pairs in contact, their stiffness, damping and errors as Taylor series.
//!
//! Given the motion and the effects it ends the step where a pair crosses a knot of its stiffness curve
//! or of an effect, and collects everything the solver needs into [`Terms`]: rank-one channels
//! `f -= out (k (in . q) + c (in . q') - g)` and external forces. With backlash every pair carries its
//! own regime (drive flank, free, coast flank), changed only at roots of its deflection polynomial.
//! A cracked tooth's pair follows its own curve.

use super::assembly::{Coordinate, System};
use super::excitation::{Backlash, Effect, Facts, Forces, Moment, PairOnPath, Place};
use super::kinematics::Motion;
use super::roots::first_root;
use super::series::Series;
use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::CrackedPair;
use std::f64::consts::TAU;

/// Position ahead of the contact, base pitches, by which a piece is chosen at a knot.
const LOOKAHEAD_PITCHES: f64 = 1e-10;

/// Damping of the tooth contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeshDamping {
    /// Each pair: this time, s, times its stiffness.
    Time(f64),
    /// `2 ratio sqrt(k mass)` of the total stiffness, shared as the stiffness is.
    Ratio {
        /// Damping ratio.
        ratio: f64,
        /// Equivalent mass on the line of action, kg.
        mass_kg: f64,
    },
}

/// A rank-one term: force `-out (k (in . q) + c (in . q') - g)`.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// Index of the direction measured.
    pub input: usize,
    /// Index of the direction acted on.
    pub output: usize,
    /// Stiffness.
    pub k: Series,
    /// Damping.
    pub c: Series,
    /// Force by errors.
    pub g: Series,
}

/// One pair's share during the step.
#[derive(Debug, Clone, Copy)]
pub struct PairTerm {
    /// Number of the pair.
    pub number: i64,
    /// Which flank carries.
    pub regime: Regime,
    /// Stiffness, N/m.
    pub k: Series,
    /// Damping, N s/m.
    pub c: Series,
    /// Error, m, the coast flank's clearance not included.
    pub e: Series,
    /// Clearance passed where the coast flank carries, else 0, m.
    pub clearance_m: f64,
}

/// Which flank of a pair is in contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Regime {
    /// Drive flank: deflection positive.
    Drive,
    /// No contact.
    Free,
    /// Coast flank: deflection below minus the clearance.
    Coast,
}

/// What acts during one step.
#[derive(Debug, Default)]
pub struct Terms {
    /// Position of the contact at the start, base pitches from the start of pair 0's path.
    pub position: f64,
    /// Rank-one terms; the mesh is the first.
    channels: Vec<Channel>,
    /// External force series by direction index.
    pub forces: Vec<(usize, Series)>,
    /// Pairs on the path.
    pub pairs: Vec<PairTerm>,
    /// Positions between which all of this stays as it is, where nothing in it varies.
    constant: Option<(f64, f64)>,
}

/// Most rank-one terms of a step: the mesh, friction on three coordinates, two bearings in two directions.
pub const CHANNELS: usize = 8;

impl Terms {
    /// The rank-one terms; effects on the same place are summed, so there are never more than [`CHANNELS`].
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }
}

/// Index of the mesh direction among [`Mesh::directions`].
pub const MESH: usize = 0;
/// Index of the cross (sliding) direction.
pub const CROSS: usize = 1;
/// Index of the unit direction of coordinate 0.
pub const UNIT: usize = 2;

/// The mesh of a machine in motion, with its effects.
pub struct Mesh<'a> {
    /// Stiffness of one pair over base pitches from the start of contact.
    pub stiffness: &'a PiecewisePolynomial,
    /// Damping of the contact.
    pub damping: MeshDamping,
    /// Angle of the pinion.
    pub motion: &'a Motion,
    /// Effects.
    pub effects: &'a [Box<dyn Effect>],
    /// What effects may know.
    pub facts: Facts,
    cracked: Option<&'a CrackedPair>,
    coordinates: Vec<Coordinate>,
    knots: Vec<f64>,
    backlash: Option<Backlash>,
    regimes: Vec<(i64, Regime)>,
}

impl<'a> Mesh<'a> {
    /// Puts motion and effects on a system.
    pub fn new(
        system: &System,
        stiffness: &'a PiecewisePolynomial,
        damping: MeshDamping,
        motion: &'a Motion,
        effects: &'a [Box<dyn Effect>],
        facts: Facts,
    ) -> Self {
        let mut knots = stiffness.knots().to_vec();
        let end = *knots.last().expect("a curve has knots");
        knots.extend(effects.iter().flat_map(|e| e.path_knots(&facts)).filter(|&k| k > 0.0 && k < end));
        tidy(&mut knots);
        let backlash = effects.iter().find_map(|e| e.backlash());
        let coordinates = system.coordinates.clone();
        let regimes = Vec::new();
        Self { stiffness, damping, motion, effects, facts, cracked: None, coordinates, knots, backlash, regimes }
    }

    /// Gives the pair of one tooth its own curve.
    pub fn with_crack(mut self, cracked: Option<&'a CrackedPair>) -> Self {
        self.cracked = cracked;
        self.knots.extend(cracked.iter().flat_map(|c| c.curve.knots()));
        tidy(&mut self.knots);
        self
    }

    /// Stiffness curve of a pair.
    fn curve(&self, number: i64) -> &'a PiecewisePolynomial {
        match self.cracked {
            Some(c) if number.rem_euclid(i64::from(self.facts.teeth[c.side.index()])) == i64::from(c.tooth) => &c.curve,
            _ => self.stiffness,
        }
    }

    /// Clearance between the flanks, m; zero where contact is never lost.
    pub fn clearance_m(&self) -> f64 {
        self.backlash.map_or(0.0, |b| b.clearance_m)
    }

    /// Whether contact may be lost.
    pub fn is_nonlinear(&self) -> bool {
        self.backlash.is_some()
    }

    /// The directions that channel indices refer to: mesh, cross, then each coordinate.
    pub fn directions<const N: usize>(system: &System) -> Vec<[f64; N]> {
        let column = |v: &nalgebra::DVector<f64>| std::array::from_fn(|i| v[i]);
        let mut all = vec![column(&system.mesh), column(&system.cross)];
        all.extend((0..N).map(|j| std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 })));
        all
    }

    /// [`Mesh::directions`] of any number of coordinates.
    pub fn all_directions(system: &System) -> Vec<Vec<f64>> {
        let n = system.len();
        let mut all: Vec<Vec<f64>> = [&system.mesh, &system.cross].map(|v| v.iter().copied().collect()).into();
        all.extend((0..n).map(|j| (0..n).map(|i| f64::from(u8::from(i == j))).collect()));
        all
    }

    /// Fills `terms` for a step from `t` of at most `longest` seconds and returns its length.
    ///
    /// `approach` is `delta` at `t`, m: it decides the flank of a pair that has just entered.
    pub fn begin(&mut self, t: f64, longest: f64, approach: f64, terms: &mut Terms) -> f64 {
        let smooth = self.effects.iter().fold(self.motion.next_break(t), |b, e| b.min(e.next_break_s(t)));
        let mut h = longest.min(smooth - t);
        let mut turns = self.motion.turns(t, h);
        self.effects.iter().for_each(|e| e.turns(t, h, &mut turns));
        let mut position = turns.scaled(f64::from(self.facts.teeth[0]));
        if let Some(part) = terms.constant.and_then(|zone| part_within(&position, zone)) {
            terms.position = position.coefficient(0);
            return h * part.min(1.0);
        }
        if !self.effects.is_empty() {
            let moment = moment_of(&self.facts, t, h, &turns);
            self.effects.iter().for_each(|e| e.shift(&moment, &mut position));
        }
        let ratio = self.first_crossing(&position);
        if ratio < 1.0 {
            h *= ratio;
            position = position.rescaled(ratio);
            turns = turns.rescaled(ratio);
        }
        self.collect(t, h, &turns, &position, approach, terms);
        let rigid = self.effects.is_empty() && !self.is_nonlinear();
        let constant = rigid && terms.pairs.iter().all(|pair| pair.k.degree() == 0);
        terms.constant = constant.then(|| self.zone(&position));
        h
    }

    /// The positions around the present one within which no pair crosses a knot.
    fn zone(&self, position: &Series) -> (f64, f64) {
        let ahead = if position.coefficient(1) >= 0.0 { LOOKAHEAD_PITCHES } else { -LOOKAHEAD_PITCHES };
        let start = position.coefficient(0) + ahead;
        let (low, high) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let (first, last) = ((start - high).floor() as i64, (start - low).ceil() as i64);
        (first..=last).fold((f64::NEG_INFINITY, f64::INFINITY), |(from, to), number| {
            let above = self.knots.partition_point(|&k| k <= start - number as f64);
            let below = above.checked_sub(1).map_or(f64::NEG_INFINITY, |i| self.knots[i] + number as f64);
            let above = self.knots.get(above).map_or(f64::INFINITY, |k| k + number as f64);
            (from.max(below), to.min(above))
        })
    }

    /// Fraction of the step until some pair crosses a knot.
    fn first_crossing(&self, position: &Series) -> f64 {
        let (start, slope) = (position.coefficient(0), position.coefficient(1));
        let forward = slope >= 0.0;
        let ahead = if forward { LOOKAHEAD_PITCHES } else { -LOOKAHEAD_PITCHES };
        let (low, high) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let linear = position.degree() <= 1;
        let mut ratio: f64 = 1.0;
        // Pairs that are on the path, or enter it within this step.
        let reach = position.coefficients()[1..].iter().map(|c| c.abs()).sum::<f64>();
        let first = (start - reach - high).floor() as i64;
        let last = (start + reach - low).ceil() as i64;
        for number in first..=last {
            let s = start + ahead - number as f64;
            let above = self.knots.partition_point(|&k| k <= s);
            let neighbours = [above.checked_sub(1), (above < self.knots.len()).then_some(above)];
            for knot in neighbours.into_iter().flatten().map(|i| self.knots[i]) {
                let distance = knot + number as f64 - start;
                if linear {
                    let tau = distance / slope;
                    if tau > 0.0 && distance.abs() > 2.0 * LOOKAHEAD_PITCHES && tau < ratio {
                        ratio = tau;
                    }
                } else if distance.abs() <= reach {
                    let mut p = *position;
                    p.add_constant(-knot - number as f64);
                    let from = if distance.abs() <= 2.0 * LOOKAHEAD_PITCHES { 1e-6 } else { 0.0 };
                    if let Some(tau) = first_root(p.coefficients(), from, ratio)
                        && tau > 0.0
                    {
                        ratio = ratio.min(tau);
                    }
                }
            }
        }
        ratio
    }

    fn collect(&mut self, t: f64, h: f64, turns: &Series, position: &Series, approach: f64, terms: &mut Terms) {
        terms.position = position.coefficient(0);
        terms.channels.clear();
        terms.forces.clear();
        terms.pairs.clear();
        let ahead = if position.coefficient(1) >= 0.0 { LOOKAHEAD_PITCHES } else { -LOOKAHEAD_PITCHES };
        let (low, high) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let start = position.coefficient(0) + ahead;
        let (first, last) = ((start - high).floor() as i64, (start - low).floor() as i64);
        let facts = self.facts;
        let moment = (!self.effects.is_empty()).then(|| moment_of(&facts, t, h, turns));
        let mut total = Series::ZERO;
        let mut friction: Option<[Series; 9]> = None;
        let mut pairs_of_effects = Vec::new();
        for number in first..=last {
            let s0 = start - number as f64;
            let curve = self.curve(number);
            let Some(piece) = curve.locate(s0) else { continue };
            let mut s = *position;
            s.add_constant(-(number as f64));
            let mut local = s;
            local.add_constant(-curve.knots()[piece]);
            let mut k = local.compose(curve.piece(piece));
            let mut e = Series::ZERO;
            if let Some(moment) = &moment {
                let tooth = self.facts.teeth.map(|z| number.rem_euclid(i64::from(z)) as u32);
                let pair = PairOnPath { number, tooth, position: s };
                for effect in self.effects {
                    effect.pair_stiffness(moment, &pair, &mut k);
                    effect.pair_error(moment, &pair, &mut e);
                }
                pairs_of_effects.push(pair);
            }
            total.add_scaled(&k, 1.0);
            let regime = self.regime_of(number, approach - e.coefficient(0));
            let clearance_m = if regime == Regime::Coast { self.clearance_m() } else { 0.0 };
            terms.pairs.push(PairTerm { number, regime, k, c: Series::ZERO, e, clearance_m });
        }
        self.regimes.retain(|(number, _)| (first..=last).contains(number));
        let shares = match self.damping {
            MeshDamping::Time(time) => {
                terms.pairs.iter_mut().for_each(|p| p.c = p.k.scaled(time));
                None
            }
            MeshDamping::Ratio { ratio, mass_kg } if total.coefficient(0) > 0.0 => {
                Some(total.scaled(mass_kg).sqrt().scaled(2.0 * ratio).quotient(&total))
            }
            MeshDamping::Ratio { .. } => None,
        };
        if let Some(share) = shares {
            terms.pairs.iter_mut().for_each(|p| p.c = p.k.product(&share));
        }
        let mut mesh = Channel { input: MESH, output: MESH, k: Series::ZERO, c: Series::ZERO, g: Series::ZERO };
        for (i, pair) in terms.pairs.iter().enumerate() {
            let mut e = pair.e;
            if pair.regime == Regime::Free {
                continue;
            }
            e.add_constant(-pair.clearance_m);
            let mut g = Series::ZERO;
            if !e.is_zero() {
                g = pair.k.product(&e);
                if e.degree() > 0 {
                    g.add_scaled(&pair.c.product(&e.derivative()), 1.0 / h);
                }
            }
            mesh.k.add_scaled(&pair.k, 1.0);
            mesh.c.add_scaled(&pair.c, 1.0);
            mesh.g.add_scaled(&g, 1.0);
            let Some(moment) = &moment else { continue };
            for effect in self.effects {
                let Some(coefficient) = effect.friction(moment, &pairs_of_effects[i]) else { continue };
                let friction = friction.get_or_insert([Series::ZERO; 9]);
                let s = &pairs_of_effects[i].position;
                let arms = [
                    coefficient,
                    coefficient.product(&self.facts.roll_distance_m(0, s)),
                    coefficient.product(&self.facts.roll_distance_m(1, s)).scaled(-1.0),
                ];
                for (slot, arm) in arms.iter().enumerate() {
                    for (part, series) in [pair.k, pair.c, g].iter().enumerate() {
                        friction[3 * slot + part].add_scaled(&arm.product(series), 1.0);
                    }
                }
            }
        }
        terms.channels.push(mesh);
        if let Some(friction) = friction {
            let outputs = [Some(CROSS), self.unit(Coordinate::Rotation(0)), self.unit(Coordinate::Rotation(1))];
            for (slot, output) in outputs.into_iter().enumerate() {
                let Some(output) = output else { continue };
                let [k, c, g] = [friction[3 * slot], friction[3 * slot + 1], friction[3 * slot + 2]];
                terms.channels.push(Channel { input: MESH, output, k, c, g });
            }
        }
        if let Some(moment) = &moment {
            self.add_effect_forces(moment, terms);
        }
    }

    fn add_effect_forces(&self, moment: &Moment, terms: &mut Terms) {
        let mut forces = Forces::default();
        self.effects.iter().for_each(|effect| effect.force(moment, &mut forces));
        for body in 0..2 {
            let mut sum: Option<Series> = None;
            for k in self.effects.iter().filter_map(|effect| effect.bearing(moment, body)) {
                sum.get_or_insert(Series::ZERO).add_scaled(&k, 1.0);
            }
            let Some(k) = sum else { continue };
            for axis in [Coordinate::Across(body), Coordinate::Along(body)] {
                if let Some(unit) = self.unit(axis) {
                    let (c, g) = (Series::ZERO, Series::ZERO);
                    terms.channels.push(Channel { input: unit, output: unit, k, c, g });
                }
            }
        }
        for (place, series) in forces.0 {
            let coordinate = match place {
                Place::Motor => self.unit(Coordinate::Motor).or(self.unit(Coordinate::Rotation(0))),
                Place::Load => self.unit(Coordinate::Load).or(self.unit(Coordinate::Rotation(1))),
                Place::Across(body) => self.unit(Coordinate::Across(body)),
                Place::Along(body) => self.unit(Coordinate::Along(body)),
            };
            if let Some(unit) = coordinate {
                terms.forces.push((unit, series));
            }
        }
    }

    fn unit(&self, coordinate: Coordinate) -> Option<usize> {
        self.coordinates.iter().position(|&c| c == coordinate).map(|i| UNIT + i)
    }

    /// The regime of a pair, decided by its deflection when it enters the path.
    fn regime_of(&mut self, number: i64, deflection: f64) -> Regime {
        let Some(backlash) = self.backlash else { return Regime::Drive };
        if let Some((_, regime)) = self.regimes.iter().find(|(n, _)| *n == number) {
            return *regime;
        }
        let regime = match deflection {
            d if d > 0.0 => Regime::Drive,
            d if d < -backlash.clearance_m => Regime::Coast,
            _ => Regime::Free,
        };
        self.regimes.push((number, regime));
        regime
    }

    /// First change of regime within `(0, end]` of the step, given `delta` over the step.
    pub fn first_switch(&self, terms: &Terms, approach: &Series, end: f64) -> Option<(f64, i64, Regime)> {
        let clearance = self.backlash?.clearance_m;
        let mut first: Option<(f64, i64, Regime)> = None;
        for pair in &terms.pairs {
            let mut deflection = *approach;
            deflection.add_scaled(&pair.e, -1.0);
            let mut lower = deflection;
            lower.add_constant(clearance);
            let exits: &[(Series, bool, Regime)] = match pair.regime {
                Regime::Drive => &[(deflection, false, Regime::Free)],
                Regime::Coast => &[(lower, true, Regime::Free)],
                Regime::Free => &[(deflection, true, Regime::Drive), (lower, false, Regime::Coast)],
            };
            for &(series, rising, next) in exits {
                let until = first.map_or(end, |f| f.0);
                if let Some(tau) = crossing(&series, rising, until) {
                    first = Some((tau, pair.number, next));
                }
            }
        }
        first
    }

    /// Puts a pair into another regime.
    pub fn switch(&mut self, number: i64, regime: Regime) {
        if let Some(entry) = self.regimes.iter_mut().find(|(n, _)| *n == number) {
            entry.1 = regime;
        }
    }
}

/// Part of a step at constant speed until it leaves a zone that it starts in, clear of the border ahead.
fn part_within(position: &Series, (low, high): (f64, f64)) -> Option<f64> {
    let (start, slope) = (position.coefficient(0), position.coefficient(1));
    let (behind, ahead) = if slope >= 0.0 { (start - low, high - start) } else { (high - start, start - low) };
    let clear = behind >= -LOOKAHEAD_PITCHES && ahead > 2.0 * LOOKAHEAD_PITCHES;
    (position.degree() <= 1 && clear).then(|| ahead / slope.abs())
}

/// Sorted knots without near-duplicates.
fn tidy(knots: &mut Vec<f64>) {
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
}

/// First time in `(0, end]` at which the series crosses zero upwards (`rising`) or downwards.
fn crossing(series: &Series, rising: bool, end: f64) -> Option<f64> {
    let oriented = if rising { *series } else { series.scaled(-1.0) };
    let p = oriented.coefficients();
    // Right after a switch the series starts at zero (to rounding) and moves inwards.
    let size: f64 = p.iter().map(|c| c.abs()).sum();
    let mut from = if p[0].abs() <= 1e-12 * size { 1e-7_f64.min(0.5 * end) } else { 0.0 };
    while let Some(tau) = first_root(p, from, end) {
        if oriented.derivative().value(tau) > 0.0 {
            return Some(tau);
        }
        from = tau + 1e-12;
        if from >= end {
            break;
        }
    }
    None
}

/// The coming step as effects see it; `turns`: angle of the pinion.
pub fn moment_of<'f>(facts: &'f Facts, t: f64, h: f64, turns: &Series) -> Moment<'f> {
    let pinion = turns.scaled(TAU);
    let gear = pinion.scaled(f64::from(facts.teeth[0]) / f64::from(facts.teeth[1]));
    Moment { facts, start_s: t, length_s: h, angle_rad: [pinion, gear] }
}
