//! Lines that belong together: harmonics of one order, with the sidebands of a shaft, or about the mesh harmonics.
//!
//! | kind | places of base order o |
//! | --- | --- |
//! | harmonics | j o |
//! | modulated by a shaft | j o +- n o_s |
//! | about the mesh | k z1 +- j o |
//!
//! Every strong line, its parts, its distance from the mesh and the distances between lines are tried as base. A
//! candidate's evidence is the logarithm of the binomial probability that as many of its places hit lines by chance,
//! given how densely lines lie, with places far from the base (high j, n) counted like near ones: a family with few
//! misses wins over one that needs many places. Ties (a sideband taken for the base gives the same places shifted)
//! are decided by the power at the places j o themselves. The best candidate takes its lines; the rest is tried
//! again, and joins the family of the same base. What remains stands alone. Nothing is named as damage here.

use super::search::Line;
use serde::Serialize;
use statrs::distribution::{Binomial, DiscreteCDF};

/// Highest harmonic of a base, highest sideband order.
const HARMONICS: usize = 16;
const SIDEBANDS: i32 = 2;
/// Harmonics of a base about the mesh.
const MESH_SIDE_HARMONICS: usize = 3;
/// Lines from which bases are taken.
const MAX_BASE_LINES: usize = 40;
const PAIRS: usize = 14;
/// Largest probability of a family by chance.
const LARGEST_P: f64 = 1e-3;
/// Places off by this share of a harmonic's order still hit: slip wanders.
const SLIP: f64 = 2e-3;
/// Bins by which a place may be missed.
const BINS: f64 = 1.5;

/// How a family is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One line.
    Single,
    /// Harmonics of one order.
    Harmonics,
    /// Harmonics with sidebands of the pinion's shaft.
    ModulatedByPinion,
    /// Harmonics with sidebands of the gear's shaft.
    ModulatedByGear,
    /// Sidebands at one distance and its multiples about the mesh harmonics.
    AboutMesh,
}

/// A line's place in its family.
#[derive(Debug, Clone, Serialize)]
pub struct Member {
    /// The line.
    #[serde(flatten)]
    pub line: Line,
    /// "2 o", "2 o - 1 pinion", "3 mesh + 1 o".
    pub place: String,
}

/// Lines that belong together.
#[derive(Debug, Clone, Serialize)]
pub struct Family {
    /// How it is built.
    pub kind: Kind,
    /// Other ways in which more lines stand about the same base.
    pub also: Vec<Kind>,
    /// Base order, of the pinion.
    pub base_order: f64,
    /// Root of the lines' summed mean squares; record's unit, or share of the band's mean power.
    pub rms: f64,
    /// Logarithm of the probability that lines fall into such places by chance; 0 for a single line.
    pub ln_probability: f64,
    /// Its lines, strongest first.
    pub members: Vec<Member>,
}

/// What of the machine families are built with.
#[derive(Debug, Clone, Copy)]
pub struct Orders {
    /// Mesh order of the pinion.
    pub teeth: f64,
    /// Order of the gear's shaft.
    pub gear_order: f64,
    /// Range in which lines were looked for.
    pub lowest: f64,
    /// See `lowest`.
    pub highest: f64,
    /// Whether the mesh stands in this spectrum at all; not in an envelope's.
    pub mesh: bool,
}

#[derive(Debug, Clone)]
struct Place {
    order: f64,
    /// Multiple of the base in it.
    multiple: f64,
    harmonic: usize,
    side: i32,
    mesh: usize,
}

struct Candidate {
    kind: Kind,
    base: f64,
    ln_probability: f64,
    /// Power at the multiples of the base itself.
    carriers: f64,
    /// Index of the line and its place.
    hits: Vec<(usize, Place)>,
}

impl Candidate {
    /// A line that slip has smeared is found in pieces: what lies beside a place that is hit belongs to it.
    fn take_smeared(&mut self, lines: &[Line]) {
        for (i, line) in
            lines.iter().enumerate().filter(|(i, _)| self.hits.iter().all(|hit| hit.0 != *i)).collect::<Vec<_>>()
        {
            let near =
                |place: &Place| (line.order - place.order).abs() <= 2.0 * tolerance(line, place.multiple, self.base);
            let place = self.hits.iter().map(|hit| &hit.1).find(|place| near(place)).cloned();
            self.hits.extend(place.map(|place| (i, place)));
        }
    }
}

/// Groups `lines` into families, most powerful first.
pub fn group(lines: &[Line], orders: &Orders, known: &dyn Fn(f64, f64) -> bool) -> Vec<Family> {
    let mut rest: Vec<Line> = lines.to_vec();
    let mut families = Vec::new();
    while let Some(mut best) = best_candidate(&rest, orders, known) {
        best.take_smeared(&rest);
        join(&mut families, family(&best, &rest));
        let taken: Vec<usize> = best.hits.iter().map(|hit| hit.0).collect();
        let mut index = 0..;
        rest.retain(|_| !taken.contains(&index.next().unwrap_or_default()));
    }
    families.extend(rest.into_iter().map(|line| Family {
        kind: Kind::Single,
        also: Vec::new(),
        base_order: line.order,
        rms: line.amplitude / 2.0_f64.sqrt(),
        ln_probability: 0.0,
        members: vec![Member { line, place: "o".into() }],
    }));
    families.sort_by(|a, b| b.rms.total_cmp(&a.rms));
    families
}

/// Adds a family, to the one of the same base where there is one: a passage stands by itself and about the mesh.
fn join(families: &mut Vec<Family>, new: Family) {
    let is_same = |old: &&mut Family| (old.base_order - new.base_order).abs() <= SLIP * old.base_order;
    let Some(old) = families.iter_mut().find(is_same) else { return families.push(new) };
    if new.kind != old.kind && !old.also.contains(&new.kind) {
        old.also.push(new.kind);
    }
    if new.rms > old.rms {
        old.base_order = new.base_order;
    }
    old.rms = old.rms.hypot(new.rms);
    old.ln_probability += new.ln_probability;
    old.members.extend(new.members);
    old.members.sort_by(|a, b| b.line.amplitude.total_cmp(&a.line.amplitude));
}

fn best_candidate(lines: &[Line], orders: &Orders, known: &dyn Fn(f64, f64) -> bool) -> Option<Candidate> {
    let mut kinds = vec![Kind::Harmonics, Kind::ModulatedByPinion, Kind::ModulatedByGear];
    if orders.mesh {
        kinds.push(Kind::AboutMesh);
    }
    let mut best: Option<Candidate> = None;
    for base in bases(lines, orders) {
        for &kind in &kinds {
            let Some(candidate) = candidate(kind, base, lines, orders, known) else { continue };
            if best.as_ref().is_none_or(|best| better(&candidate, best)) {
                best = Some(candidate);
            }
        }
    }
    best
}

/// Evidence first; where it is nearly the same, the power on the multiples of the base, then the larger base.
fn better(a: &Candidate, b: &Candidate) -> bool {
    let tie = 0.15 * a.ln_probability.abs().max(b.ln_probability.abs());
    if (a.ln_probability - b.ln_probability).abs() > tie {
        return a.ln_probability < b.ln_probability;
    }
    if (a.carriers - b.carriers).abs() > 0.1 * a.carriers.max(b.carriers) {
        return a.carriers > b.carriers;
    }
    (a.ln_probability, -a.base) < (b.ln_probability, -b.base)
}

fn bases(lines: &[Line], orders: &Orders) -> Vec<f64> {
    let mut strongest: Vec<Line> = lines.to_vec();
    strongest.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    strongest.truncate(MAX_BASE_LINES);
    let mut bases = Vec::new();
    for line in &strongest {
        bases.extend((1..=4).map(|j| line.order / f64::from(j)));
        if orders.mesh {
            let away = (line.order - (line.order / orders.teeth).round() * orders.teeth).abs();
            bases.extend([away, away / 2.0]);
        }
    }
    for (i, a) in strongest.iter().take(PAIRS).enumerate() {
        bases.extend(strongest[..i].iter().map(|b| (a.order - b.order).abs()));
    }
    bases.retain(|base| *base > orders.lowest.max(0.1));
    bases
}

fn places(kind: Kind, base: f64, orders: &Orders) -> Vec<Place> {
    let mut places = Vec::new();
    let harmonics = if kind == Kind::AboutMesh { MESH_SIDE_HARMONICS } else { HARMONICS };
    for harmonic in 1..=harmonics {
        let own = harmonic as f64 * base;
        let mut add = |order: f64, multiple: f64, side: i32, mesh: usize| {
            if order >= orders.lowest && order <= orders.highest {
                places.push(Place { order, multiple, harmonic, side, mesh });
            }
        };
        add(own, harmonic as f64, 0, 0);
        let shaft = match kind {
            Kind::ModulatedByPinion => Some(1.0),
            Kind::ModulatedByGear => Some(orders.gear_order),
            _ => None,
        };
        if let Some(shaft) = shaft {
            for side in (-SIDEBANDS..=SIDEBANDS).filter(|n| *n != 0) {
                let order = own + f64::from(side) * shaft;
                // Beyond zero a sideband comes back mirrored.
                add(order.abs(), harmonic as f64 * order.signum(), side, 0);
            }
        }
        if kind == Kind::AboutMesh {
            for mesh in 1..=(orders.highest / orders.teeth) as usize + 1 {
                for side in [-1, 1] {
                    let multiple = f64::from(side) * harmonic as f64;
                    add(mesh as f64 * orders.teeth + multiple * base, multiple, side, mesh);
                }
            }
        }
    }
    places
}

fn candidate(
    kind: Kind,
    base: f64,
    lines: &[Line],
    orders: &Orders,
    known: &dyn Fn(f64, f64) -> bool,
) -> Option<Candidate> {
    if kind == Kind::AboutMesh && base > 0.5 * orders.teeth {
        // The same places as of the distance from the next harmonic.
        return None;
    }
    let mut base = base;
    let mut hits = Vec::new();
    let mut tried = 0;
    // The base is placed by all its lines, and the lines taken anew.
    for _ in 0..3 {
        let places = places(kind, base, orders);
        hits = taken(lines, &places, base);
        // Places beyond the last that is hit say nothing against the base.
        let last = hits.iter().map(|(_, place)| place.harmonic).max()?;
        let last_mesh = hits.iter().map(|(_, place)| place.mesh).max()?;
        let is_within = |place: &Place| place.harmonic <= last && place.mesh <= last_mesh;
        let free = |place: &&Place| is_within(place) && !known(place.order, BINS * lines[0].bin);
        tried = places.iter().filter(free).count();
        base = refined(base, lines, &hits)?;
    }
    let wanted = if kind == Kind::Harmonics { 2 } else { 3 };
    let has_sides = hits.iter().any(|(_, place)| place.side != 0);
    if hits.len() < wanted || (kind != Kind::Harmonics && !has_sides) {
        return None;
    }
    let width = orders.highest - orders.lowest;
    let reach: f64 = lines.iter().map(|line| 2.0 * tolerance(line, 1.0, base)).sum();
    let by_chance = (reach / width).clamp(1e-9, 0.5);
    let tried = tried.max(hits.len()) as u64;
    // One line was chosen to begin with.
    let probability = Binomial::new(by_chance, tried - 1).ok()?.sf(hits.len() as u64 - 2).max(1e-300);
    let is_carrier = |place: &Place| place.side == 0 || (place.mesh > 0 && place.harmonic == 1);
    let carriers = hits.iter().filter(|(_, p)| is_carrier(p)).map(|(i, _)| lines[*i].amplitude.powi(2)).sum();
    (probability < LARGEST_P).then_some(Candidate { kind, base, ln_probability: probability.ln(), carriers, hits })
}

fn tolerance(line: &Line, multiple: f64, base: f64) -> f64 {
    BINS * line.bin + SLIP * multiple.abs() * base
}

/// For each line the place it falls into, each place once.
fn taken(lines: &[Line], places: &[Place], base: f64) -> Vec<(usize, Place)> {
    let mut hits: Vec<(usize, Place)> = Vec::new();
    for place in places {
        let near = |i: &usize| (lines[*i].order - place.order).abs();
        let hit = (0..lines.len())
            .filter(|&i| near(&i) <= tolerance(&lines[i], place.multiple, base))
            .filter(|i| hits.iter().all(|hit| hit.0 != *i))
            .min_by(|a, b| near(a).total_cmp(&near(b)));
        hits.extend(hit.map(|i| (i, place.clone())));
    }
    hits
}

/// The base that fits the lines' places best, each by its own resolution.
fn refined(base: f64, lines: &[Line], hits: &[(usize, Place)]) -> Option<f64> {
    let (mut up, mut down) = (0.0, 0.0);
    for (i, place) in hits {
        let weight = 1.0 / lines[*i].bin.powi(2);
        up += weight * place.multiple * (lines[*i].order - place.order);
        down += weight * place.multiple * place.multiple;
    }
    (down > 0.0).then(|| base + up / down)
}

fn family(best: &Candidate, lines: &[Line]) -> Family {
    let shaft = if best.kind == Kind::ModulatedByGear { "gear" } else { "pinion" };
    let mut members: Vec<Member> = best
        .hits
        .iter()
        .map(|(i, place)| {
            let sign = if place.side < 0 { "-" } else { "+" };
            let text = match (place.mesh, place.side) {
                (0, 0) => format!("{} o", place.harmonic),
                (0, side) => format!("{} o {sign} {} {shaft}", place.harmonic, side.abs()),
                (mesh, _) => format!("{mesh} mesh {sign} {} o", place.harmonic),
            };
            Member { line: lines[*i], place: text }
        })
        .collect();
    members.sort_by(|a, b| b.line.amplitude.total_cmp(&a.line.amplitude));
    Family {
        kind: best.kind,
        also: Vec::new(),
        base_order: best.base,
        rms: (0.5 * members.iter().map(|m| m.line.amplitude.powi(2)).sum::<f64>()).sqrt(),
        ln_probability: best.ln_probability,
        members,
    }
}
