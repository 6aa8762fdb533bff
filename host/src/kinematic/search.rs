//! Families one after the other: the strongest that the gate lets pass, then the rest without its lines.

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Domain, Field, Kind, Taken, score};
use super::families::{self, Context, bearing, passage, tooth};
use super::residual::Views;
use super::scene::Scene;
use crate::analysis::lines::LOBE_BINS;

/// Most families adopted.
const MOST: usize = 8;
/// Candidates of a round that are judged before it is given up.
const JUDGED: usize = 6;
/// Multiples and sidebands of an adopted base that are no base of their own.
const DERIVED: (u32, i32) = (6, 3);

/// A family adopted on the fitted part.
#[derive(Debug, Clone)]
pub struct Adopted {
    /// The family.
    pub candidate: Candidate,
    /// The gate's answer.
    pub verdict: Verdict,
    /// The tooth of a single-tooth family.
    pub pulse: Option<tooth::Pulse>,
}

/// What the search found.
pub struct Search {
    /// Families adopted, in this order.
    pub adopted: Vec<Adopted>,
    /// Best of each kind that was refused.
    pub refused: Vec<(Candidate, Verdict)>,
    /// Orders spoken for, by domain.
    pub taken: [Taken; 3],
    /// Candidates scored.
    pub tried: usize,
}

/// Index of a domain among the three views.
pub fn index(domain: Domain) -> usize {
    domain as usize
}

/// A search that was not made.
pub fn nothing(scene: &Scene, views: &Views) -> Search {
    Search { adopted: Vec::new(), refused: Vec::new(), taken: mesh_taken(scene, views), tried: 0 }
}

/// Searches on the fitted part of the searched channels.
pub fn search(scene: &Scene, views: &Views) -> Search {
    let mut search = nothing(scene, views);
    while search.adopted.len() < MOST {
        let Some(found) = search.round(scene, views) else { break };
        search.take(scene, views, found);
    }
    search
}

/// The views with what is taken, as one family of them is read.
pub fn field<'a>(views: &'a Views, taken: &'a [Taken; 3], domain: Domain, channels: std::ops::Range<usize>) -> Field<'a> {
    let spectra = match domain {
        Domain::Orders => &views.orders,
        Domain::Envelope => &views.envelope,
        Domain::Frequency => &views.frequency,
    };
    Field { spectra, taken: &taken[index(domain)], channels }
}

/// Context of the families.
pub fn context<'a>(scene: &'a Scene, views: &'a Views, taken: &'a [Taken; 3]) -> Context<'a> {
    Context { scene, orders: &views.orders, envelope: &views.envelope, frequency: &views.frequency, taken }
}

/// The mesh itself is spoken for; in an envelope the shafts' orders are.
fn mesh_taken(scene: &Scene, views: &Views) -> [Taken; 3] {
    let mut taken: [Taken; 3] = Default::default();
    let z = scene.mesh_order();
    taken[0].extend((1..=(scene.highest_order / z) as usize).map(|k| k as f64 * z));
    for own in [1.0, scene.gear_order] {
        taken[1].extend((1..=(views.envelope.highest / own) as usize).map(|n| n as f64 * own));
    }
    for k in 1..=(scene.highest_order / z) as usize {
        take_frequencies(&mut taken[2], scene, views, k as f64 * z);
    }
    taken
}

/// Takes the frequencies that an order sweeps.
fn take_frequencies(taken: &mut Taken, scene: &Scene, views: &Views, order: f64) {
    let bin = views.frequency.bin(0);
    for run in &scene.runs {
        let (low, high) = (order * run.angle.speed.slowest_hz, order * run.angle.speed.fastest_hz);
        taken.extend((0..=((high - low) / bin) as usize + 1).map(|i| low + i as f64 * bin));
    }
}

impl Search {
    fn round(&mut self, scene: &Scene, views: &Views) -> Option<Adopted> {
        let context = context(scene, views, &self.taken);
        let candidates: Vec<Candidate> =
            families::all(&context).into_iter().filter(|c| !self.is_known(c, scene)).collect();
        self.tried += candidates.len();
        let strength = |c: &Candidate| {
            let field = field(views, &self.taken, c.domain, 0..scene.searched);
            score(c, &field, 0.0).ln_bayes - c.alternatives.max(1.0).ln()
        };
        let mut ranked: Vec<(f64, Candidate)> = candidates.into_iter().map(|c| (strength(&c), c)).collect();
        ranked.retain(|(s, _)| *s > 0.0);
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut refused = Vec::new();
        let mut found = None;
        for (_, candidate) in ranked.into_iter().take(JUDGED) {
            let refined = passage::refinements(&context, &candidate);
            let best = refined.into_iter().map(|c| (strength(&c), c)).max_by(|a, b| a.0.total_cmp(&b.0));
            let candidate = best.map_or(candidate, |(_, c)| c);
            let field = field(views, &self.taken, candidate.domain, 0..scene.searched);
            let verdict = accept::judge(&candidate, &field);
            if verdict.refused.is_none() {
                found = Some((candidate, verdict));
                break;
            }
            refused.push((candidate, verdict));
        }
        for (candidate, verdict) in refused {
            if self.refused.iter().all(|(c, _)| c.kind != candidate.kind) {
                self.refused.push((candidate, verdict));
            }
        }
        let (mut candidate, verdict) = found?;
        let pulse = match candidate.kind {
            Kind::Pattern(shaft) => tooth::is_single(scene, shaft),
            _ => None,
        };
        if let (Kind::Pattern(shaft), Some(_)) = (candidate.kind, pulse) {
            candidate.kind = Kind::SingleTooth(shaft);
        }
        Some(Adopted { candidate, verdict, pulse })
    }

    /// Whether a candidate is what an adopted family has explained already.
    fn is_known(&self, candidate: &Candidate, scene: &Scene) -> bool {
        self.adopted.iter().any(|own| {
            let same_shaft_kind = match (own.candidate.kind, candidate.kind) {
                (Kind::SingleTooth(a), Kind::Modulation(b) | Kind::Pattern(b)) => a == b,
                (Kind::Pattern(a), Kind::Modulation(b) | Kind::Pattern(b)) => a == b,
                (a @ (Kind::Modulation(_) | Kind::ShaftOrders(_)), b) => a == b,
                _ => false,
            };
            same_shaft_kind || (is_base(candidate) && is_base(&own.candidate) && derived(candidate.base, own.candidate.base, scene))
        })
    }

    fn take(&mut self, scene: &Scene, views: &Views, found: Adopted) {
        let candidate = &found.candidate;
        let own = index(candidate.domain);
        let bin = field(views, &self.taken, candidate.domain, 0..1).spectra.bin(found.verdict.score.level);
        let width = LOBE_BINS * bin;
        for (place, ln) in candidate.places.iter().zip(&found.verdict.score.of_places) {
            if *ln <= 0.0 {
                continue;
            }
            let fine = field(views, &self.taken, candidate.domain, 0..1).spectra.bin(0);
            let steps = if candidate.locked { 0 } else { (width / fine / LOBE_BINS) as i32 };
            self.taken[own].extend((-steps..=steps).map(|i| place.order + f64::from(i) * fine * LOBE_BINS));
            match candidate.domain {
                Domain::Orders => take_frequencies(&mut self.taken[2], scene, views, place.order),
                Domain::Frequency => take_orders(&mut self.taken[0], scene, views, place.order),
                Domain::Envelope => {}
            }
        }
        self.adopted.push(found);
    }
}

fn take_orders(taken: &mut Taken, scene: &Scene, views: &Views, hz: f64) {
    let bin = views.orders.bin(0);
    for run in &scene.runs {
        let (low, high) = (hz / run.angle.speed.fastest_hz, hz / run.angle.speed.slowest_hz);
        taken.extend((0..=((high - low) / bin) as usize + 1).map(|i| low + i as f64 * bin));
    }
}

fn is_base(candidate: &Candidate) -> bool {
    matches!(candidate.kind, Kind::Passage | Kind::ModulatedPassage(_) | Kind::AboutMesh)
}

/// Whether a base is a multiple, a part or a sideband of another.
fn derived(base: f64, own: f64, scene: &Scene) -> bool {
    let half = scene.resolution();
    let near = |a: f64, b: f64| (a - b).abs() <= half.max(3e-3 * b);
    let z = scene.mesh_order();
    (1..=DERIVED.0).map(f64::from).any(|j| {
        let of_shafts = (-DERIVED.1..=DERIVED.1)
            .any(|n| [1.0, scene.gear_order].iter().any(|s| near(base, (j * own + f64::from(n) * s).abs())));
        of_shafts || near(base * j, own) || (1..=4).any(|k| near(base, (f64::from(k) * z - j * own).abs()))
    })
}

/// Bases of the adopted families of neither shaft.
pub fn bases(adopted: &[Adopted]) -> Vec<f64> {
    adopted.iter().filter(|a| is_base(&a.candidate)).map(|a| a.candidate.base).collect()
}

/// The bearing that the adopted orders of neither shaft make together.
pub fn bearing(adopted: &[Adopted], scene: &Scene) -> Option<bearing::Bearing> {
    bearing::read(&bases(adopted), scene.gear_order).filter(|b| b.others == 0)
}
