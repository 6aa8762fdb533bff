//! Impacts that follow no shaft: a rolling bearing's, found in squared envelopes and read as what they are.
//!
//! Elements strike with slip and jitter, so their lines smear with the harmonic number and what they excite has no
//! phase to predict: the information is cyclostationary (Randall, Antoni 2011). [`bands`] takes what is deterministic
//! out and gives squared envelopes over orders; [`combs`] finds combs and says by how much chance gives as much;
//! [`readings`] compares all explanations of one comb and gives its name. Where the owner declares bearings
//! ([`declared`]) only their orders are asked for by name. A comb found is spoken for: its multiples and sidebands
//! are no further ones ([`Impacts::explains`]).
//!
//! Limits: the last quarter of the turns is held out, whatever the search for lines holds out; a comb that stands at
//! one run only is found there.

pub mod bands;
pub mod combs;
pub mod declared;
pub mod readings;
pub mod tail;
pub mod thresholds;

use super::baseline::Grids;
use super::scene::Scene;
use bands::Band;
use combs::{Comb, Known, SIDES};
use declared::Declared;
use readings::Reading;
use thresholds::{
    BASES, FEWEST_TURNS, HELD_OUT_START_SHARE, HIGHEST_ORDER, MAX_COMBS, MIN_ADOPTION_NATS, MIN_HELD_OUT_NATS,
    MIN_OTHER_LINES_NATS, MIN_RING_NATS, SAME_COMB, SLIP,
};

/// Multiples of a comb's base that another base, or twice it, may be with sidebands.
const RELATION_NUMBERS: (u32, u32, i32) = (16, 2, 4);
/// Bins from which multiples of a rate stand apart.
const APART_BINS: f64 = 12.0;
/// Bins within which two orders are one.
const SAME_BINS: f64 = 2.0;

/// A comb of impacts.
#[derive(Debug, Clone)]
pub struct Impacts {
    /// The comb.
    pub comb: Comb,
    /// What it is.
    pub reading: Reading,
    /// Name of the declared bearing that it is of.
    pub bearing: Option<String>,
    /// Run and channel of the scene that show it best.
    pub place: (usize, usize),
    /// Band, Hz.
    pub hz: [f64; 2],
    /// Bands of one width that were read as one.
    pub meaned: usize,
    /// Depth of the first harmonic: amplitude of the squared envelope over its mean.
    pub depth: f64,
    /// Bin of the spectrum, orders.
    pub bin: f64,
    /// Orders of the shafts.
    pub shafts: Vec<f64>,
    /// The squared envelope spectrum, power over the floor by order.
    pub spectrum: Vec<(f64, f64)>,
}

impl Impacts {
    fn of(comb: Comb, reading: Reading, bearing: Option<String>, bands: &[Band], shafts: &[f64]) -> Self {
        let band = &bands[comb.band];
        let part = &band.parts[0];
        Self {
            place: (band.run, band.channel),
            hz: band.hz,
            meaned: band.meaned,
            depth: part.depth_at(reading.base),
            bin: part.bin,
            shafts: shafts.to_vec(),
            spectrum: part.over.iter().enumerate().map(|(i, over)| (i as f64 * part.bin, *over)).collect(),
            comb,
            reading,
            bearing,
        }
    }

    /// Whether an order is one of its lines, a sideband of one, or half of such.
    pub fn explains(&self, order: f64) -> bool {
        let (multiples, halves, sides) = RELATION_NUMBERS;
        let is_at = |order: f64, n: i32, own: f64| {
            let multiple = (order - f64::from(n) * own) / self.reading.base;
            let nearest = multiple.round();
            let off = (multiple - nearest).abs() * self.reading.base;
            (1.0..=f64::from(multiples)).contains(&nearest) && off <= (SAME_BINS * self.bin).max(SLIP * order)
        };
        let at_any = |order: f64| self.shafts.iter().any(|own| (-sides..=sides).any(|n| is_at(order, n, *own)));
        (1..=halves).any(|m| at_any(f64::from(m) * order))
    }

    /// Whether another base is its own or a multiple of it within what jitter smears: one hump has two tops.
    fn is_same(&self, base: f64) -> bool {
        let multiple = (base / self.reading.base).round().max(1.0);
        (base / (multiple * self.reading.base) - 1.0).abs() <= SAME_COMB
    }

    /// Whether an order is its base within what jitter smears.
    pub fn has_base(&self, order: f64) -> bool {
        (order / self.reading.base - 1.0).abs() <= SAME_COMB
    }

    /// Orders of its lines that are worth a list.
    pub fn lines(&self) -> Vec<(String, f64)> {
        let harmonic = |h: usize| (format!("{h} o"), h as f64 * self.reading.base);
        (1..=self.comb.harmonics).map(harmonic).filter(|(_, order)| *order < HIGHEST_ORDER).collect()
    }
}

/// Combs of impacts in what the calibrated model leaves, the strongest first; of declared bearings by name.
pub fn find(scene: &Scene, left: &Grids, declared: &[Declared]) -> Vec<Impacts> {
    let is_long = |turns: usize| (1.0 - HELD_OUT_START_SHARE) * turns as f64 >= FEWEST_TURNS as f64;
    if !scene.runs.iter().all(|run| is_long(run.angle.turns)) {
        return Vec::new();
    }
    let bands = bands::bank(scene, left);
    let shafts = if scene.has_gears() { vec![1.0, scene.gear_order] } else { vec![1.0] };
    let mut known = Known { rates: rates(scene, &bands), shafts, combs: Vec::new() };
    let mut found = declared::find(&bands, &known, declared);
    known.combs.extend(found.iter().map(|own| (own.reading.base, SIDES)));
    let [slowest, fastest] = [f64::min, f64::max].map(|of| known.shafts.iter().copied().fold(1.0, of));
    let range = [(BASES.0 * slowest, (BASES.1 * fastest).min(HIGHEST_ORDER / 3.0))];
    let asked = found.len();
    for _ in 0..MAX_COMBS {
        let Some(comb) = combs::best(&bands, &known, &range).filter(|comb| comb.nats >= MIN_ADOPTION_NATS) else {
            break;
        };
        let band = &bands[comb.band];
        let mut reading = readings::read(band, &comb, &known);
        let again = combs::again(&comb, reading.base, band, &known);
        let comb = Comb { again, ..comb };
        let sides = if reading.modulated_by.is_some() { SIDES } else { 0 };
        known.combs.push((comb.base, sides));
        let rates: Vec<f64> = known.all_rates().copied().collect();
        let is_shafts_own = readings::is_of_shaft(reading.base, band.parts[0].bin, &rates, 1.0)
            || readings::is_beside_shaft(reading.base, &known.shafts);
        if comb.again < MIN_HELD_OUT_NATS
            || comb.others < MIN_OTHER_LINES_NATS
            || is_shafts_own
            || found.iter().any(|own| own.is_same(reading.base) || own.explains(reading.base))
        {
            continue;
        }
        // One comb of a record has a name, or the bearings declared: what a second one is, is not known from one
        // record.
        if !declared.is_empty() || found[asked..].iter().any(|own| !own.reading.parts.is_empty()) {
            reading.parts.clear();
            reading.remark = "a second order beside the one named: another bearing of the rig, or another part".into();
        }
        if scene.gearing.is_some() {
            reading.parts.clear();
            reading.remark = "an order of a train, which any of its shafts may carry".into();
        }
        found.push(Impacts::of(comb, reading, None, &bands, &known.shafts));
    }
    question_rings(&mut found);
    found
}

/// Rates of a train's parts whose multiples stand apart in the spectra: those of slower ones are everywhere.
fn rates(scene: &Scene, bands: &[Band]) -> Vec<f64> {
    let bin = bands.iter().map(|band| band.parts[0].bin).fold(0.0, f64::max);
    let all = scene.gearing.iter().flat_map(|gearing| gearing.rates());
    all.filter(|rate| *rate >= APART_BINS * bin).collect()
}

/// Where both rings of one bearing stand in their own right, which of them is damaged is not known from heights.
fn question_rings(found: &mut [Impacts]) {
    for i in 0..found.len() {
        let own = &found[i];
        let is_ring = matches!(own.reading.parts.as_slice(), ["outer ring" | "inner ring"]) && own.bearing.is_none();
        let shaft = own.shafts[own.reading.shaft.unwrap_or(0)];
        let other = |other: &&Impacts| {
            other.comb.nats >= MIN_RING_NATS
                && readings::are_of_one_bearing(own.reading.base, other.reading.base, shaft)
        };
        let Some(base) = found.iter().find(other).filter(|_| is_ring).map(|other| other.reading.base) else { continue };
        found[i].reading.parts = vec!["inner ring", "outer ring"];
        found[i].reading.remark = format!("order {base:.4} stands as well: both rings of one bearing");
    }
}
