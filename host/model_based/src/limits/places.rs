//! Where the effects of the library could sit in a record: candidates at drawn places, and the unknowns that a
//! strength has there.

use super::super::candidate::{Candidate, Claim, Tuning};
use super::super::detect;
use super::super::judge::Split;
use super::super::least_squares::Data;
use super::super::library::{Bench, mesh, order, path};
use super::super::start::Start;
use super::super::strength::first_guess;
use crate::effects::hypothesis::{Fitted, Hypothesis, Seat, Site, Table, Tooth, Wave, Where};
use crate::effects::{entry, hypotheses};
use crate::machine::{Freedom, Hunting};
use nalgebra::DVector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Places of an effect, and how many of them an order, tooth, shape or frequency is drawn for anew.
const PLACES: usize = 16;
const SEATS: usize = 8;
/// Seed of all draws.
const SEED: u64 = 15;
/// Damping ratio of a path's mode.
const MODE_DAMPING: f64 = 0.03;
/// Bands that limits of their own are stated for, in thousandths: length of a relief as a share of the path,
/// frequency of a mode, Hz.
const RELIEFS: [[u32; 2]; 2] = [[150, 250], [250, 400]];
const MODES_HZ: [[u32; 2]; 3] = [[1_500_000, 2_500_000], [2_500_000, 3_500_000], [3_500_000, 4_500_000]];
/// Delay that a channel's limit is computed for, s: half a period at 15 kHz is thirty times as long, so that
/// strengths are proportional.
const DELAY_S: f64 = 1e-6;
/// Keys of the simulator that say where an effect sits, and those that are neither this nor a strength.
const SEAT_KEYS: [&str; 2] = ["gear", "channel"];
const NO_STRENGTH: [&str; 7] = ["order", "frequency", "phase", "tooth", "length", "exponent", "damping"];

/// What limits are stated for.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Row {
    pub family: String,
    pub strength: String,
    pub keys: Vec<(&'static str, u8)>,
    pub at: String,
    pub unit: &'static str,
    pub at_order: bool,
    /// The simulator's key whose value decides how well the effect shows, and the range that it is drawn from, in
    /// thousandths.
    pub within: Option<(&'static str, [u32; 2])>,
}

/// An effect at one order, tooth or frequency, with several phases, signs and starts of the runs.
pub struct Seated {
    pub row: Row,
    pub candidate: Candidate,
    hypothesis: &'static Hypothesis,
    /// Unknowns of one unit of the candidate's strength, place by place and run by run.
    pub unknowns: Vec<Vec<DVector<f64>>>,
    /// Whether the scans must propose it.
    pub proposed: bool,
}

impl Seated {
    /// The simulator's strength where the candidate's is `size` at a place; none beyond what the simulator takes.
    pub fn strength(&self, bench: &Bench<'_>, place: usize, size: f64) -> Option<f64> {
        let x: Vec<f64> = self.unknowns[place][0].iter().map(|v| v * size).collect();
        let table = carried(bench, &self.candidate, self.hypothesis, &x, size)?;
        let (key, value) = strength_of(&table)?;
        let parameter = entry(table.0).ok()?.parameters.iter().find(|p| p.name == key)?;
        Some(value.abs()).filter(|value| *value <= parameter.range[1])
    }
}

/// What of a place a strength leaves open.
#[derive(Clone, Copy)]
enum Open {
    /// The sign of one real unknown, or nothing where it is never negative.
    Sign,
    /// The phase of this pair of unknowns.
    Phase(usize),
    /// A phase in every run.
    PhaseOfRuns,
}

struct Draw<'a> {
    bench: &'a Bench<'a>,
    hunting: Hunting,
    random: ChaCha8Rng,
    all: Vec<Seated>,
}

/// Hands out candidates of every named effect at drawn places, part by part because of their size.
pub fn drawn(bench: &Bench<'_>, data: &Data, split: &Split, mut take: impl FnMut(Vec<Seated>)) {
    let hunting = Hunting::of(bench.base.machine.teeth);
    let mut draw = Draw { bench, hunting, random: ChaCha8Rng::seed_from_u64(SEED), all: Vec::new() };
    draw.without_choice();
    take(std::mem::take(&mut draw.all));
    draw.on_paths(data, split);
    take(std::mem::take(&mut draw.all));
    for _ in 0..SEATS {
        draw.at_orders(split);
        draw.with_shapes();
        take(std::mem::take(&mut draw.all));
        (0..2).for_each(|body| draw.on_tooth(body));
        (0..2).for_each(|larger| draw.hum(larger));
        take(std::mem::take(&mut draw.all));
    }
}

impl Draw<'_> {
    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.random.random::<f64>()
    }

    /// Within a band in thousandths.
    fn within(&mut self, [from, to]: [u32; 2]) -> f64 {
        1e-3 * self.between(f64::from(from), f64::from(to))
    }

    fn below(&mut self, count: u32) -> u32 {
        self.random.random::<u32>() % count
    }

    /// Adds a candidate with so many places; nothing for what the simulator has no effect for.
    fn add(&mut self, candidate: Candidate, open: Open, places: usize, proposed: bool) {
        let Some(hypothesis) = candidate.hypothesis.or_else(|| hypotheses().find(|h| h.name == candidate.name)) else {
            return;
        };
        let unknowns: Vec<_> = (0..places).map(|i| self.unknowns(&candidate, hypothesis, open, i)).collect();
        let x: Vec<f64> = unknowns[0][0].iter().copied().collect();
        let Some(row) = row(self.bench, &candidate, hypothesis, &x) else { return };
        // An effect may have a plainer hypothesis of the same name, whose turn comes when the first does not fit.
        let is_wave = matches!(candidate.seat, Some(Seat::Wave(_)));
        if is_wave && self.all.iter().any(|other| other.row == row && other.candidate.order == candidate.order) {
            return;
        }
        self.all.push(Seated { row, candidate, hypothesis, unknowns, proposed });
    }

    /// Unknowns of one unit of strength in every run.
    fn unknowns(&mut self, candidate: &Candidate, h: &Hypothesis, open: Open, place: usize) -> Vec<DVector<f64>> {
        let runs = self.bench.base.runs.len();
        let mut x = DVector::zeros(candidate.templates.len());
        let own = match open {
            Open::Sign => {
                x[0] = if place.is_multiple_of(2) || h.never_negative { 1.0 } else { -1.0 };
                return vec![x; runs];
            }
            Open::PhaseOfRuns => {
                for r in 0..runs {
                    (x[2 * r + 1], x[2 * r]) = self.between(0.0, TAU).sin_cos();
                }
                return vec![x; runs];
            }
            Open::Phase(pair) => pair,
        };
        let phase = self.between(0.0, TAU);
        let order = candidate.pair_orders.first().copied().unwrap_or(0.0);
        let freedom = self.hunting.freedom(&candidate.pair_orders);
        (0..runs)
            .map(|_| {
                let turned = match freedom {
                    Freedom::None => 0.0,
                    Freedom::Turns => TAU * order * f64::from(self.below(self.hunting.turns)),
                    Freedom::Phase => self.between(0.0, TAU),
                };
                (x[2 * own + 1], x[2 * own]) = (phase + turned).sin_cos();
                x.clone()
            })
            .collect()
    }

    /// What sits at one order or none: the shafts' own orders, and every pair alike.
    fn without_choice(&mut self) {
        let named = |c: &&Candidate| c.claim == Claim::Named && !matches!(c.tuning, Some(Tuning::Relief { .. }));
        let fixed: Vec<Candidate> = self.bench.fixed().iter().filter(named).cloned().collect();
        for candidate in fixed {
            let at_multiple = matches!(candidate.hypothesis.map(|h| h.at), Some(Where::Multiple(..)));
            match candidate.seat {
                Some(Seat::Wave(_)) if at_multiple => self.add(candidate, Open::Phase(0), PLACES, false),
                Some(_) => {}
                None if candidate.templates.len() == 1 => self.add(candidate, Open::Sign, PLACES / 2, false),
                // The first two mesh orders are strengths of their own.
                None => (0..2).for_each(|pair| self.add(candidate.clone(), Open::Phase(pair), PLACES, false)),
            }
        }
    }

    /// What has a shape of its own.
    fn with_shapes(&mut self) {
        for band in RELIEFS {
            let share = self.within(band);
            self.add(mesh::relief(self.bench, share, 1), Open::Sign, PLACES / SEATS, false);
        }
        for channel in 0..2 {
            for band in MODES_HZ {
                let hz = self.within(band);
                // The structure's gain is real, as the simulator has it.
                self.add(path::mode(self.bench, channel, hz, MODE_DAMPING), Open::Sign, PLACES / SEATS, false);
            }
        }
    }

    /// What sits at an order that the scans must find: ghosts at whole orders of the pinion up to the mesh, ripple of
    /// the motor at its low ones, the rest between orders.
    fn at_orders(&mut self, split: &Split) {
        let base = self.bench.base;
        let scanned = detect::places_of_orders(detect::grid_of_orders(base, &split.seen()));
        let teeth = base.machine.teeth[0];
        let middle = middle_order(teeth);
        let ghosts =
            [5 + self.below(middle - 5), middle + self.below(teeth.saturating_sub(1 + middle).max(1))].map(f64::from);
        let ripple = f64::from(3 + self.below(6));
        let free = self.between_orders();
        for at in [ghosts[0], ghosts[1], ripple, free] {
            for candidate in order::at_order(self.bench, at, 200.0) {
                let seat = match (candidate.seat, candidate.hypothesis.map(|h| h.at)) {
                    (_, Some(Where::WholeOrdersAbove(_))) if ghosts.contains(&at) => at,
                    (_, Some(Where::NeitherShaft { .. })) => free,
                    (Some(Seat::Wave(Wave::Force { at: Site::Motor, .. })), Some(Where::Everywhere)) => ripple,
                    (Some(Seat::Wave(Wave::Force { at: Site::Load, .. })), Some(Where::Everywhere)) => free,
                    _ => continue,
                };
                if seat == at && candidate.claim == Claim::Named {
                    let candidate = Candidate { scanned, ..candidate };
                    self.add(candidate, Open::Phase(0), PLACES / SEATS, true);
                }
            }
        }
    }

    /// An order of the pinion away from whole orders of either shaft.
    fn between_orders(&mut self) -> f64 {
        let off = |x: f64| (x - x.round()).abs();
        loop {
            let order = self.between(2.0, 8.0);
            if off(order) > 0.1 && off(order / self.bench.ratio()) > 0.1 {
                return order;
            }
        }
    }

    /// Of the gear the runs start anywhere in the hunting period.
    fn on_tooth(&mut self, body: usize) {
        let tooth = self.below(self.bench.base.machine.teeth[body]);
        let mut start = Start::Counted;
        if body == 1 && self.hunting.turns > 1 {
            let runs = 1..self.bench.base.runs.len();
            start = Start::Turns(std::iter::once(0).chain(runs.map(|_| self.below(self.hunting.turns))).collect());
        }
        for candidate in self.bench.teeth.at(self.bench, body, tooth, &start) {
            self.add(candidate, Open::Sign, PLACES / SEATS, false);
        }
    }

    fn on_paths(&mut self, data: &Data, split: &Split) {
        let all = path::candidates(self.bench, data, &split.fit);
        // Of delays and modes the residual chooses the shape.
        let drawn = |c: &Candidate| c.claim == Claim::Named && c.tuning.is_none() && c.searched < 100.0;
        all.into_iter().filter(drawn).for_each(|c| self.add(c, Open::Sign, PLACES / 2, false));
        for channel in 0..2 {
            self.add(path::delayed(self.bench, channel, DELAY_S), Open::Sign, PLACES / 2, false);
        }
    }

    /// Hum in both channels, the one that is not the `larger` weaker by a drawn share.
    fn hum(&mut self, larger: usize) {
        let hz = 50.0 * f64::from(1 + self.below(3));
        let mut amplitude = [C::ONE; 2];
        amplitude[1 - larger] = C::from_polar(self.between(0.1, 0.9), self.between(0.0, TAU));
        let scanned = detect::grid_of_frequencies(self.bench.base).2;
        let candidate = Candidate { scanned, ..order::line_tone(self.bench, hz, amplitude) };
        self.add(candidate, Open::PhaseOfRuns, PLACES / SEATS, true);
    }
}

/// Where and in which unit the strength of a candidate counts; `x`: unknowns of one unit.
fn row(bench: &Bench<'_>, candidate: &Candidate, hypothesis: &'static Hypothesis, x: &[f64]) -> Option<Row> {
    let table = carried(bench, candidate, hypothesis, x, 1.0)?;
    let (key, _) = strength_of(&table)?;
    let parameter = entry(table.0).ok()?.parameters.iter().find(|p| p.name == key)?;
    let keys: Vec<(&'static str, u8)> =
        table.1.iter().filter(|(key, _)| SEAT_KEYS.contains(key)).map(|(key, value)| (*key, *value as u8)).collect();
    let of_one = |value: &u8| *value < 2;
    let at = keys.iter().filter(|(_, value)| of_one(value)).map(|&(key, value)| match key {
        "gear" => ["pinion", "gear"][usize::from(value)].to_string(),
        _ => format!("channel {value}"),
    });
    let within = band(candidate, hypothesis, bench.base.machine.teeth[0]);
    let at = at.chain(within.map(|(key, [from, to])| {
        let [from, to] = [from, to].map(|x| 1e-3 * f64::from(x));
        format!("{key} {from} to {to}")
    }));
    Some(Row {
        family: candidate.name.clone(),
        at: at.collect::<Vec<_>>().join(", "),
        strength: format!("{}:{key}", table.0),
        unit: if parameter.unit.is_empty() { "1" } else { parameter.unit },
        at_order: candidate.order.is_some(),
        keys,
        within,
    })
}

/// The band of a candidate whose place decides how well it shows.
fn band(candidate: &Candidate, hypothesis: &Hypothesis, teeth: u32) -> Option<(&'static str, [u32; 2])> {
    let of = |bands: &[[u32; 2]], value: f64| {
        bands.iter().copied().find(|[from, to]| (f64::from(*from)..=f64::from(*to)).contains(&(1e3 * value)))
    };
    match (candidate.tuning, hypothesis.at) {
        (Some(Tuning::Relief { share, .. }), _) => of(&RELIEFS, share).map(|band| ("length", band)),
        (Some(Tuning::Mode { f0, .. }), _) => of(&MODES_HZ, f0).map(|band| ("frequency", band)),
        (_, Where::WholeOrdersAbove(_)) => {
            let middle = middle_order(teeth);
            let bands = [[5000, 1000 * (middle - 1)], [1000 * middle, 1000 * (teeth - 2)]];
            of(&bands, candidate.order?).map(|band| ("order", band))
        }
        _ => None,
    }
}

/// Order at half of the mesh order, between which and the mesh a ghost shows better.
fn middle_order(teeth: u32) -> u32 {
    (teeth / 2).max(6)
}

/// Key and value of the strength in a simulator's effect.
fn strength_of(table: &Table) -> Option<(&'static str, f64)> {
    let is_strength =
        |(key, value): &&(&str, f64)| !SEAT_KEYS.contains(key) && !NO_STRENGTH.contains(key) && *value != 0.0;
    table.1.iter().find(is_strength).copied()
}

/// The simulator's effect for the unknowns `x` of a candidate of this size: of the larger channel where there is one
/// for each.
fn carried(bench: &Bench<'_>, candidate: &Candidate, hypothesis: &Hypothesis, x: &[f64], size: f64) -> Option<Table> {
    let facts = bench.base.machine.facts(0.0);
    let parts = candidate.parts(x);
    let size = match candidate.seat {
        Some(Seat::OneTooth(_, Tooth::Softened)) => first_guess(candidate, &[size])[0],
        _ => size,
    };
    let power = |c: usize| -> f64 {
        let bins = candidate.templates.iter().flat_map(|t| &t.runs).flat_map(|run| run[c].iter());
        bins.map(|(_, value)| value.norm_sqr()).sum()
    };
    let powers = [power(0), power(1)];
    let larger = powers[0].max(powers[1]);
    let channel = match powers {
        [_, 0.0] => 0.0,
        [0.0, _] => 1.0,
        _ => 2.0,
    };
    let channel_share = powers.map(|p| (p / larger).sqrt());
    let fitted = Fitted { channel, channel_share, ..candidate.fitted(&facts, (size, 0.0), &parts) };
    let carried = (hypothesis.carry)(&fitted)?;
    let largest = |table: &Table| strength_of(table).map_or(0.0, |(_, value)| value.abs());
    carried.tables.into_iter().max_by(|a, b| largest(a).total_cmp(&largest(b)))
}
