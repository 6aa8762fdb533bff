//! A structured family of lines: where its lines are, what it would be called, and how strong the record speaks for it.
//!
//! A candidate is scored on every channel searched and every run; a family that follows neither shaft exactly is read
//! at the resolution that speaks most for it (its lines are smeared), which costs the logarithm of the choices. The
//! same score at moved places is the null. Places of one family that the resolution cannot tell apart are one
//! reading, the first listed: else a base that is a rational relative of the true one would count each line as often
//! as it has a combination near it.

use super::evidence::{Reading, of_family};
pub use super::shaft::Shaft;
use super::spectra::Spectra;
use crate::analysis::lines::LOBE_BINS;

/// Where a family is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// Order spectrum of the residual.
    Orders,
    /// Spectrum over frequency, "orders" being hertz.
    Frequency,
    /// Order spectrum of what folded at the sampling rate.
    Folded,
    /// Order spectrum of the course of strength of all turns.
    Strength,
}

impl Domain {
    /// As JSON has it.
    pub fn word(self) -> &'static str {
        ["orders", "frequency", "folded", "strength"][self as usize]
    }
}

/// Orders spoken for, by domain.
pub type TakenOf = [Taken; 4];

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Order of the pinion (or Hz).
    pub order: f64,
    /// What it moves by where the family's spacing moves by its whole: the spacing times its number.
    pub spacing: f64,
    /// In words: "2 mesh - 1 gear".
    pub label: String,
}

/// Which family of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Sidebands of a shaft about the mesh harmonics.
    Modulation(Shaft),
    /// Low orders of a shaft.
    ShaftOrders(Shaft),
    /// One tooth of a gear.
    SingleTooth(Shaft),
    /// Whole orders of a shaft, many of them, at no single tooth.
    Pattern(Shaft),
    /// One whole order that is no mesh harmonic.
    Ghost,
    /// Harmonics of an order of neither shaft.
    Passage,
    /// The same modulated by a shaft.
    ModulatedPassage(Shaft),
    /// Sidebands at an order of neither shaft about the mesh.
    AboutMesh,
    /// A line at a frequency.
    FixedFrequency,
    /// Folded mesh harmonics.
    Alias,
    /// Samples at the end of the range.
    Clipping,
    /// Strength or speed of everything swings slowly.
    Swing,
    /// A fault of a train, by its index among the train's families.
    Train(u16),
}

/// A family that may be adopted.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Which.
    pub kind: Kind,
    /// Base order (or frequency).
    pub base: f64,
    /// Where it is read.
    pub domain: Domain,
    /// Its lines.
    pub places: Vec<Place>,
    /// Whether phases follow a shaft, so that the waveform can be predicted.
    pub locked: bool,
    /// Places and shapes that it was chosen from.
    pub alternatives: f64,
}

impl Candidate {
    /// Whether the family has a base of its own, an order of neither shaft.
    pub fn is_base(&self) -> bool {
        matches!(self.kind, Kind::Passage | Kind::ModulatedPassage(_) | Kind::AboutMesh)
    }

    /// What a line's order moves by where the base moves by its whole: of sidebands about its lines, nothing.
    pub fn lever(&self, place: &Place) -> f64 {
        let multiple = place.spacing / self.base;
        if (multiple - multiple.round()).abs() < 1e-6 { place.spacing } else { 0.0 }
    }
}

/// How strongly the record speaks for a candidate.
#[derive(Debug, Clone, Default)]
pub struct Score {
    /// Logarithm of the Bayes factor against no line, after the choice of the level.
    pub ln_bayes: f64,
    /// Level it was read at.
    pub level: usize,
    /// For each place: logarithm of the Bayes factor, all channels and runs.
    pub of_places: Vec<f64>,
    /// Places that were looked at, all channels and runs.
    pub readings: usize,
}

/// Orders spoken for.
#[derive(Debug, Clone, Default)]
pub struct Taken {
    orders: Vec<f64>,
}

impl Taken {
    /// Adds orders.
    pub fn extend(&mut self, orders: impl IntoIterator<Item = f64>) {
        self.orders.extend(orders);
        self.orders.sort_by(f64::total_cmp);
    }

    /// Whether one lies within `half` of `order`.
    pub fn near(&self, order: f64, half: f64) -> bool {
        let after = self.orders.partition_point(|o| *o < order - half);
        self.orders.get(after).is_some_and(|o| *o <= order + half)
    }
}

/// Share of a line's order (without the mesh's) over which slip smears it.
const WIDEST_SMEAR: f64 = 0.01;

/// Largest share of its spacing by which a copy is moved.
pub const WIDEST_MOVE: f64 = 0.06;

/// Share of a first sideband's distance from its mesh harmonic that its copies keep: nearer, a skirt that the
/// sideband hardly stands on is steep.
const MESH_DISTANCE_SHARE: f64 = 0.7;

/// What scoring needs.
pub struct Field<'a> {
    /// Spectra of the candidate's domain.
    pub spectra: &'a Spectra,
    /// Orders of adopted families and of the mesh.
    pub taken: &'a Taken,
    /// Channels read.
    pub channels: std::ops::Range<usize>,
}

/// Score with every place moved by `moved`, relative to its spacing; 0 is the candidate itself.
pub fn score(candidate: &Candidate, field: &Field, moved: f64) -> Score {
    let depth = if candidate.locked { 1 } else { field.spectra.depth().max(1) };
    (0..depth)
        .map(|level| at_level(candidate, field, moved, level, &|_, _, reading| reading))
        .map(|score| Score { ln_bayes: score.ln_bayes - (depth as f64).ln(), ..score })
        .max_by(|a, b| a.ln_bayes.total_cmp(&b.ln_bayes))
        .unwrap_or_default()
}

/// Place of a line where the spacing is moved: by the share of it, at least beyond the main lobe, never as far as the
/// next line.
pub fn moved_order(place: &Place, moved: f64, bin: f64) -> f64 {
    if moved == 0.0 {
        return place.order;
    }
    let least = (LOBE_BINS + 1.0 + 200.0 * moved.abs()) * bin;
    place.order + moved.signum() * (moved.abs() * place.spacing.abs()).max(least)
}

/// A family's lines where it stands, which no surrogate of it may read: a copy that lands on them is as strong as
/// the family.
struct OwnLines {
    unmoved: Taken,
    /// Distance of neighbouring lines of a locked family, orders.
    room: f64,
    /// Distance of the first sidebands from their mesh harmonics.
    first: Option<f64>,
    /// Lowest and highest order, where copies spread over all that is free: a swing's spectrum is short.
    spread: Option<[f64; 2]>,
}

impl OwnLines {
    fn of(candidate: &Candidate, moved: f64, spectra: &Spectra) -> Self {
        let mut unmoved = Taken::default();
        if moved != 0.0 {
            unmoved.extend(candidate.places.iter().map(|place| place.order));
        }
        let shaft = match candidate.kind {
            Kind::Train(_) => median_gap(&candidate.places),
            _ => candidate.places.iter().map(|place| place.spacing.abs()).fold(f64::INFINITY, f64::min),
        };
        let first = matches!(candidate.kind, Kind::Modulation(_)).then_some(candidate.base);
        let spread = (candidate.domain == Domain::Strength).then_some([spectra.lowest, spectra.highest]);
        Self { unmoved, room: if candidate.locked { shaft } else { f64::INFINITY }, first, spread }
    }

    /// Place of a line in a copy, between the main lobes of two neighbours where there is room.
    fn moved_order(&self, place: &Place, moved: f64, bin: f64) -> f64 {
        let order = moved_order(place, moved, bin);
        if moved == 0.0 {
            return order;
        }
        if let Some([lowest, highest]) = self.spread {
            let free = (highest - lowest - 2.0 * (LOBE_BINS + 1.0) * bin).max(0.0);
            let at = lowest + free * (0.5 + 0.5 * moved / WIDEST_MOVE);
            return if at < place.order - (LOBE_BINS + 1.0) * bin { at } else { at + 2.0 * (LOBE_BINS + 1.0) * bin };
        }
        let (nearest, farthest) = ((LOBE_BINS + 1.0) * bin, self.room - (LOBE_BINS + 1.0) * bin);
        let mut away = (order - place.order).abs();
        if away > farthest {
            // Copies spread over the room that there is.
            away = nearest + (farthest - nearest).max(0.0) * (moved.abs() / WIDEST_MOVE).min(1.0);
        }
        let is_inward = moved * place.spacing < 0.0;
        let is_first = self.first.is_some_and(|first| place.spacing.abs() < 1.5 * first);
        if is_first && is_inward {
            let farthest = ((1.0 - MESH_DISTANCE_SHARE) * place.spacing.abs()).max(nearest);
            if away > farthest {
                away = nearest + (farthest - nearest) * (moved.abs() / WIDEST_MOVE).min(1.0);
            }
        }
        place.order + moved.signum() * away
    }
}

/// Median distance of neighbouring lines: sidebands of several rates lie unevenly.
fn median_gap(places: &[Place]) -> f64 {
    let mut orders: Vec<f64> = places.iter().map(|place| place.order).collect();
    orders.sort_by(f64::total_cmp);
    let mut gaps: Vec<f64> = orders.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Level at which a place is read in spectra: slip smears in proportion, and no line is read more coarsely than its
/// own smear could be.
pub fn own_level(place: &Place, level: usize, spectra: &Spectra) -> usize {
    (0..=level).rev().find(|l| spectra.bin(*l) <= WIDEST_SMEAR * place.spacing.abs()).unwrap_or(0)
}

/// What is made of the reading at a place, in a run and channel.
pub type Change<'a> = dyn Fn(&Place, (usize, usize), Reading) -> Reading + 'a;

/// Score at one level; `change` may alter a reading (an injected line).
pub fn at_level(candidate: &Candidate, field: &Field, moved: f64, level: usize, change: &Change) -> Score {
    let spectra = field.spectra;
    let bins: Vec<f64> = (0..=level).map(|l| spectra.bin(l)).collect();
    let reach = usize::from(!candidate.locked);
    let own = OwnLines::of(candidate, moved, spectra);
    let mut score = Score { level, ..Score::default() };
    let mut all = Vec::new();
    let mut read: Vec<f64> = Vec::new();
    for place in &candidate.places {
        let level = own_level(place, level, spectra);
        let order = own.moved_order(place, moved, bins[level]);
        let mut sum = 0.0;
        let half = 0.5 * LOBE_BINS * bins[level];
        let next = read.partition_point(|at| *at <= order - half);
        let again = !candidate.locked && read.get(next).is_some_and(|at| *at < order + half);
        let lobe = LOBE_BINS * bins[level];
        if !again && !field.taken.near(order, lobe) && !own.unmoved.near(order, lobe) {
            read.insert(read.partition_point(|at| *at < order), order);
            for run in 0..spectra.levels.len() {
                for channel in field.channels.clone() {
                    let Some(reading) = spectra.reading(run, channel, level, order, reach) else { continue };
                    // The highest of neighbouring bins has had two more chances.
                    let choices = (1.0 + 2.0 * reach as f64).ln();
                    let ln = change(place, (run, channel), reading).ln_bayes() - choices;
                    sum += ln;
                    all.push(ln);
                }
            }
        }
        score.of_places.push(sum);
    }
    score.readings = all.len();
    score.ln_bayes = if all.is_empty() { f64::NEG_INFINITY } else { of_family(&all) };
    score
}
