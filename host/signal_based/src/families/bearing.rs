//! Several orders of neither shaft read together as one bearing: whole rolling elements, one ratio.
//!
//! With the ring that stands still outside, per turn of its shaft: outer passage `N/2 (1 - r)`, inner `N/2 (1 + r)`,
//! cage `(1 - r)/2`, element (spin) `(1 - r^2)/(2 r)`, twice that per turn where it strikes both rings. Two
//! independent bases fix `N` and `r`; a third checks them. Slip lowers all by the same share of up to 2 %, which the
//! ratio takes in. A single base fits some `N` and `r` always: no bearing is read from it. Source: Randall, Antoni
//! 2011; the law's check on records is in `reference/field-loop.md`.

use crate::candidate::Shaft;

/// Rolling elements of ordinary bearings.
pub const ELEMENTS: std::ops::RangeInclusive<u32> = 7..=24;
/// Ratio of element to pitch diameter times the cosine of the contact angle.
pub const RATIOS: (f64, f64) = (0.12, 0.36);
/// Relative distance within which a base fits: with twice that, some bearing would fit any two bases.
const MAX_BASE_ERROR_SHARE: f64 = 5e-4;
/// Multiples of the cage's order that a base may be.
const MULTIPLES: std::ops::RangeInclusive<u32> = 1..=3;

/// What of a bearing a base is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Passage on the ring that stands still.
    Outer,
    /// Passage on the ring that turns.
    Inner,
    /// Cage.
    Cage,
    /// Rolling element, both rings.
    Element,
}

impl Part {
    const ALL: [Part; 4] = [Part::Outer, Part::Inner, Part::Cage, Part::Element];

    /// Order per turn of the bearing's shaft.
    pub fn order(self, elements: u32, ratio: f64) -> f64 {
        let n = f64::from(elements);
        match self {
            Part::Outer => 0.5 * n * (1.0 - ratio),
            Part::Inner => 0.5 * n * (1.0 + ratio),
            Part::Cage => 0.5 * (1.0 - ratio),
            Part::Element => (1.0 - ratio * ratio) / ratio,
        }
    }

    /// The ratio that puts this part at `order`.
    fn ratio(self, elements: u32, order: f64) -> f64 {
        let n = f64::from(elements);
        match self {
            Part::Outer => 1.0 - 2.0 * order / n,
            Part::Inner => 2.0 * order / n - 1.0,
            Part::Cage => 1.0 - 2.0 * order,
            Part::Element => 0.5 * ((order * order + 4.0).sqrt() - order),
        }
    }

    /// In words.
    pub fn word(self) -> &'static str {
        match self {
            Part::Outer => "outer-ring passage",
            Part::Inner => "inner-ring passage",
            Part::Cage => "cage",
            Part::Element => "rolling element",
        }
    }
}

/// A bearing that explains several bases.
#[derive(Debug, Clone, PartialEq)]
pub struct Bearing {
    /// Shaft that it carries.
    pub shaft: Shaft,
    /// Rolling elements.
    pub elements: u32,
    /// Ratio.
    pub ratio: f64,
    /// For each base that it explains: index, part, multiple.
    pub parts: Vec<(usize, Part, u32)>,
    /// Largest relative distance of an explained base.
    pub worst: f64,
    /// Other readings (elements) that explain as many bases.
    pub others: usize,
}

/// The bearing that explains most of `bases` (orders of the pinion), at least two different parts of it; none where
/// several numbers of elements do.
pub fn read(bases: &[f64], gear_order: f64) -> Option<Bearing> {
    let mut all: Vec<Bearing> = Vec::new();
    // A rig without gears has one shaft.
    for shaft in Shaft::PAIR_SHAFTS.into_iter().filter(|shaft| *shaft == Shaft::Pinion || gear_order != 1.0) {
        let own = [1.0, gear_order][shaft as usize];
        for elements in ELEMENTS {
            for (i, base) in bases.iter().enumerate() {
                for part in Part::ALL {
                    for multiple in MULTIPLES.filter(|m| *m == 1 || part == Part::Cage) {
                        let ratio = part.ratio(elements, base / own / f64::from(multiple));
                        all.extend(explained(bases, own, shaft, elements, ratio, i));
                    }
                }
            }
        }
    }
    let most = all.iter().map(distinct_parts).max()?;
    all.retain(|b| distinct_parts(b) == most);
    all.sort_by(|a, b| a.worst.total_cmp(&b.worst));
    let best = all.first()?.clone();
    let is_other = |b: &&Bearing| b.elements != best.elements || b.shaft != best.shaft;
    let mut others: Vec<(u32, Shaft)> = all.iter().filter(is_other).map(|b| (b.elements, b.shaft)).collect();
    others.sort_unstable();
    others.dedup();
    Some(Bearing { others: others.len(), ..best })
}

fn distinct_parts(bearing: &Bearing) -> usize {
    let mut parts: Vec<u32> = bearing.parts.iter().map(|p| p.1 as u32).collect();
    parts.sort_unstable();
    parts.dedup();
    parts.len()
}

fn explained(bases: &[f64], own: f64, shaft: Shaft, elements: u32, ratio: f64, from: usize) -> Option<Bearing> {
    if !(RATIOS.0..=RATIOS.1).contains(&ratio) {
        return None;
    }
    let mut bearing = Bearing { shaft, elements, ratio, parts: Vec::new(), worst: 0.0, others: 0 };
    for (i, base) in bases.iter().enumerate() {
        let off =
            |part: Part, multiple: u32| (base / own / f64::from(multiple) / part.order(elements, ratio) - 1.0).abs();
        let fits = Part::ALL
            .into_iter()
            .flat_map(|part| MULTIPLES.filter(move |m| *m == 1 || part == Part::Cage).map(move |m| (part, m)))
            .map(|(part, m)| (off(part, m), part, m))
            .filter(|(off, _, _)| *off < MAX_BASE_ERROR_SHARE)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((off, part, multiple)) = fits {
            bearing.parts.push((i, part, multiple));
            bearing.worst = bearing.worst.max(off);
        }
    }
    (bearing.parts.iter().any(|p| p.0 == from) && distinct_parts(&bearing) >= 2).then_some(bearing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_two_bases_fix_elements_and_ratio() {
        let bearing = read(&[Part::Outer.order(9, 0.27), Part::Inner.order(9, 0.27)], 0.4).expect("a bearing");
        assert_eq!((bearing.elements, bearing.shaft), (9, Shaft::Pinion));
        assert!((bearing.ratio - 0.27).abs() < 1e-3);
        let on_gear = [Part::Outer.order(11, 0.22), Part::Cage.order(11, 0.22)].map(|o| 0.31 * o);
        let bearing = read(&on_gear, 0.31).expect("a bearing");
        assert_eq!((bearing.elements, bearing.shaft, bearing.others), (11, Shaft::Gear, 0));
    }

    #[test]
    fn theory_one_base_or_unrelated_bases_are_no_bearing() {
        assert_eq!(read(&[2.10], 0.4), None);
        assert_eq!(read(&[3.5814, 3.5814 * 2.0], 0.4).filter(|b| b.others == 0), None);
    }
}
