//! Orders of neither shaft: harmonics of a base, the same modulated by a shaft, or sidebands at the base about the
//! mesh.
//!
//! Bases are the analysis' ([`families::group`] over [`search::lines`] of every channel searched), from the order
//! spectrum, and the strongest lines that stand between two others one turn of a shaft away (`centres`). Each is then
//! scored as every shape, on all channels at once: `j o`; `j o +- n o_s` (a ring that turns through the load zone:
//! one family, not five combs); `k z1 +- j o` with `j o`. Slip smears and moves the lines: places may be missed by a
//! bin, the resolution is chosen, phases are not predicted. Alternatives: all bases tried, by shape. Impacts are
//! looked for in envelopes ([`crate::impacts`]).

use super::Context;
use crate::analysis::families::{self, Family, Orders};
use crate::analysis::search::{self, Line, Range};
use crate::candidate::{Candidate, Domain, Kind, Place, Shaft};

/// Families of one channel whose bases are tried.
pub const FAMILIES: usize = 8;
/// Harmonics of a base alone, nested shapes: knocks have dozens of them about a resonance.
pub const LONE_HARMONICS: [usize; 2] = [8, 24];
/// Harmonics of a base modulated, and about the mesh.
const HARMONICS: (usize, usize) = (6, 8);
/// Mesh harmonics.
const MESH: usize = 6;
/// A carrier and its sidebands of a shaft: what a sideband would read again is the carrier's.
const SIDEBANDS: [i32; 5] = [0, -1, 1, -2, 2];
/// Multiples of the base that a line may be.
pub const MULTIPLES: usize = 4;
/// Lines of one channel's order spectrum, each between two sidebands, that are tried as bases.
const CENTRES: usize = 4;
/// Bins by which a sideband may be missed there.
const CENTRE_BINS: f64 = 1.5;
/// Relative distance of bases that are one.
const SAME_BASE_SHARE: f64 = 1e-3;
/// Trial bases about a base: steps of this share.
const FINE_STEP_SHARE: f64 = 2.5e-4;
const FINE_STEPS: i32 = 4;
/// Bins within which a peak places the base, and the most that a peak's power over the floor weighs.
const PLACING_BINS: f64 = 3.0;
const MOST_WEIGHT: f64 = 1e4;

/// Trial bases about each.
pub const TRIAL_BASES: f64 = (2 * FINE_STEPS + 1) as f64;

/// Every base in every shape.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let bases = bases(context);
    let shapes = |base: f64| {
        let mut all = LONE_HARMONICS.map(|most| harmonics(context, base, most)).to_vec();
        all.extend(context.scene.shafts().iter().map(|&shaft| modulated(context, base, shaft)));
        all.push(about_mesh(context, base));
        all
    };
    let all: Vec<Candidate> = bases.into_iter().flat_map(shapes).filter(|c| c.places.len() > 1).collect();
    let alternatives = all.len() as f64;
    all.into_iter().map(|c| Candidate { alternatives, ..c }).collect()
}

/// The same family with its base moved a little: slip is not known.
pub fn refinements(context: &Context, candidate: &Candidate) -> Vec<Candidate> {
    (-FINE_STEPS..=FINE_STEPS)
        .filter_map(|i| with_base(context, candidate, candidate.base * (1.0 + FINE_STEP_SHARE * f64::from(i))))
        .map(|c| Candidate { alternatives: candidate.alternatives * TRIAL_BASES, ..c })
        .collect()
}

/// A family of the same shape with another base; none where its kind has no base.
pub fn with_base(context: &Context, candidate: &Candidate, base: f64) -> Option<Candidate> {
    let other = match candidate.kind {
        Kind::Passage => {
            let numbers = candidate.places.iter().map(|p| (p.spacing / candidate.base).round() as usize);
            harmonics(context, base, numbers.max().unwrap_or(0).max(LONE_HARMONICS[0]))
        }
        Kind::ModulatedPassage(shaft) => modulated(context, base, shaft),
        Kind::AboutMesh => about_mesh(context, base),
        _ => return None,
    };
    Some(Candidate { alternatives: candidate.alternatives, ..other })
}

/// The family with its base placed as finely as the spectra resolve: least squares of the peaks at its standing
/// places, by power, twice.
pub fn placed(context: &Context, candidate: &Candidate, standing: &[bool], channels: usize) -> Candidate {
    let spectra = context.orders;
    let mut base = candidate.base;
    for reach in [PLACING_BINS, 0.5 * PLACING_BINS] {
        let (mut up, mut down) = (0.0, 0.0);
        for (place, _) in candidate.places.iter().zip(standing).filter(|(_, stands)| **stands) {
            let multiple = place.spacing / candidate.base;
            let order = place.order + place.spacing * (base / candidate.base - 1.0);
            for (r, c) in (0..spectra.levels.len()).flat_map(|r| (0..channels).map(move |c| (r, c))) {
                let Some((peak, ratio)) = search::peak(&spectra.levels[r][c][0], order, reach) else { continue };
                let weight = ratio.min(MOST_WEIGHT);
                up += weight * multiple * (peak - order);
                down += weight * multiple * multiple;
            }
        }
        base += if down > 0.0 { up / down } else { 0.0 };
    }
    let places = candidate.places.iter().map(|place| {
        let order = place.order + place.spacing * (base / candidate.base - 1.0);
        Place { order, spacing: place.spacing * base / candidate.base, label: place.label.clone() }
    });
    Candidate { base, places: places.collect(), ..candidate.clone() }
}

fn bases(context: &Context) -> Vec<f64> {
    let shafts: Vec<f64> = context.scene.shafts().iter().map(|s| context.scene.shaft_order(*s as usize)).collect();
    let lines = lines(context);
    let best = |families: Vec<Family>| families.into_iter().take(FAMILIES).map(|family| family.base_order);
    let mut bases: Vec<f64> = in_families(context, &lines).into_iter().flatten().flat_map(best).collect();
    bases.extend(lines.iter().flatten().flat_map(|lines| centres(lines, &shafts)));
    let parts: Vec<f64> = bases.iter().flat_map(|b| (1..=MULTIPLES).map(move |m| b / m as f64)).collect();
    distinct(parts, context.orders.lowest.max(2.0 * context.scene.resolution()))
}

/// Strongest lines that stand between two others one turn of a shaft away on either side, given the orders of the
/// shafts: where a shaft modulates a family, one of its sidebands or a part of one may group more lines.
fn centres(lines: &[Line], shafts: &[f64]) -> Vec<f64> {
    let stands = |order: f64, bin: f64| lines.iter().any(|l| (l.order - order).abs() <= CENTRE_BINS * bin.max(l.bin));
    let is_between = |line: &Line, own: f64| [-own, own].into_iter().all(|side| stands(line.order + side, line.bin));
    let mut centres: Vec<&Line> = lines.iter().filter(|l| shafts.iter().any(|own| is_between(l, *own))).collect();
    centres.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    centres.into_iter().take(CENTRES).map(|line| line.order).collect()
}

/// Lines of every run and channel searched.
fn lines(context: &Context) -> Vec<Vec<Vec<Line>>> {
    let spectra = context.orders;
    let of_run = |r: usize| {
        let known = known(context, r);
        let range = Range { lowest: spectra.lowest, highest: spectra.highest, known: &known };
        spectra.levels[r][..context.scene.searched].iter().map(|levels| search::lines(levels, &range)).collect()
    };
    (0..context.scene.runs.len()).map(of_run).collect()
}

/// Lines of every run and channel searched in families, most powerful first.
pub fn grouped(context: &Context) -> Vec<Vec<Vec<Family>>> {
    in_families(context, &lines(context))
}

fn in_families(context: &Context, lines: &[Vec<Vec<Line>>]) -> Vec<Vec<Vec<Family>>> {
    let scene = context.scene;
    let spectra = context.orders;
    let orders = Orders {
        teeth: scene.mesh_order(),
        gear_order: scene.gear_order,
        lowest: spectra.lowest,
        highest: spectra.highest,
        mesh: true,
    };
    let of_run = |(r, channels): (usize, &Vec<Vec<Line>>)| {
        let known = known(context, r);
        channels.iter().map(|lines| families::group(lines, &orders, &known)).collect()
    };
    lines.iter().enumerate().map(of_run).collect()
}

/// Whether an order of a run, within a half width, carries no base: the pair has lines there, a family found before,
/// or the foot of either.
pub fn known<'a>(context: &'a Context, run: usize) -> impl Fn(f64, f64) -> bool + 'a {
    let scene = context.scene;
    let explained = scene.explained(&scene.runs[run].angle, context.orders.highest);
    move |order: f64, half: f64| {
        explained.at(order, half) || context.taken[0].near(order, half) || context.at_foot(order)
    }
}

fn distinct(mut bases: Vec<f64>, lowest: f64) -> Vec<f64> {
    bases.retain(|base| *base > lowest);
    bases.sort_by(f64::total_cmp);
    bases.dedup_by(|a, b| *a - *b < SAME_BASE_SHARE * *b);
    bases
}

fn make(context: &Context, kind: Kind, base: f64, mut places: Vec<Place>) -> Candidate {
    let spectra = context.orders;
    let fits = |p: &Place| p.order > spectra.lowest && p.order < spectra.highest;
    // On a shaft's order nothing can be told from the shaft.
    let of_shaft = |order: f64| {
        if let Some(gearing) = &context.scene.gearing {
            let half = context.scene.beside_a_shaft();
            let owned = &gearing.owned;
            return owned.at(order, half);
        }
        let own = context.scene.gear_order;
        let on_gear = (order / own).round() * own;
        let is_near = (order - on_gear).abs() <= 0.2 * own;
        context.hides(spectra, order.round(), order) || is_near && context.hides(spectra, on_gear, order)
    };
    places.retain(|p| fits(p) && !of_shaft(p.order) && !context.at_foot(p.order));
    Candidate { kind, base, domain: Domain::Orders, places, locked: false, alternatives: 1.0 }
}

/// `j o` to the number `most`.
pub fn harmonics(context: &Context, base: f64, most: usize) -> Candidate {
    let place = |j: usize| Place { order: j as f64 * base, spacing: j as f64 * base, label: format!("{j} o") };
    make(context, Kind::Passage, base, (1..=most).map(place).collect())
}

/// `j o +- n o_s`.
pub fn modulated(context: &Context, base: f64, shaft: Shaft) -> Candidate {
    let own = context.scene.shaft_order(shaft as usize);
    let mut places = Vec::new();
    for j in 1..=HARMONICS.0 {
        for n in SIDEBANDS {
            let order = j as f64 * base + f64::from(n) * own;
            let label = match n {
                0 => format!("{j} o"),
                n => format!("{j} o {} {} {}", if n < 0 { "-" } else { "+" }, n.abs(), shaft.word()),
            };
            places.push(Place { order, spacing: j as f64 * base, label });
        }
    }
    make(context, Kind::ModulatedPassage(shaft), base, places)
}

/// `k z1 +- j o` and `j o`.
pub fn about_mesh(context: &Context, base: f64) -> Candidate {
    let z = context.scene.mesh_order();
    let mut places = Vec::new();
    for j in (1..=HARMONICS.1).filter(|j| *j as f64 * base < 0.5 * z) {
        let spacing = j as f64 * base;
        places.push(Place { order: spacing, spacing, label: format!("{j} o") });
        for k in 1..=MESH {
            for (side, sign) in [(-1.0, "-"), (1.0, "+")] {
                let label = format!("{k} mesh {sign} {j} o");
                places.push(Place { order: k as f64 * z + side * spacing, spacing: side * spacing, label });
            }
        }
    }
    make(context, Kind::AboutMesh, base, places)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BIN: f64 = 0.01;

    fn line(order: f64, amplitude: f64) -> Line {
        Line { order, amplitude, over_floor_db: 30.0, ln_probability: -100.0, bin: BIN }
    }

    #[test]
    fn golden_the_strongest_lines_between_two_sidebands_of_one_shaft_are_bases() {
        let gear = 0.37;
        let mut lines = vec![line(6.70, 3.0), line(5.71, 9.0), line(7.70, 8.0), line(13.40, 1.0)];
        assert_eq!(centres(&lines, &[1.0, gear]), [6.70], "the weaker line is the one between");
        lines.extend([line(13.40 - gear, 0.5), line(13.40 + gear, 0.5)]);
        assert_eq!(centres(&lines, &[1.0, gear]), [6.70, 13.40], "of the gear as well, strongest first");
        lines[1].order = 5.70 + 2.0 * BIN;
        assert_eq!(centres(&lines, &[1.0, gear]), [13.40], "a sideband two bins off is none");
        lines = (0..12).map(|i| line(20.5 + f64::from(i), 1.0 + f64::from(i))).collect();
        assert_eq!(centres(&lines, &[1.0, gear]), [30.5, 29.5, 28.5, 27.5], "four at most, none at an end");
    }
}
