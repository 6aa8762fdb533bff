//! Who owns a line of a spectrum: the first that claims it. A mark beside an owned line would say that two causes made
//! it.

use super::plot::Label;

/// Lines that have an owner, with the width within which no other mark stands.
#[derive(Debug)]
pub struct Owners {
    width: f64,
    owned: Vec<Label>,
}

impl Owners {
    /// Nobody's yet; `width` in the unit of the axis.
    pub fn new(width: f64) -> Self {
        Self { width, owned: Vec::new() }
    }

    /// Marks a line where nobody has: true where it was free.
    pub fn claim(&mut self, x: f64, text: impl Into<String>) -> bool {
        let free = self.owned.iter().all(|label| (label.x - x).abs() > self.width);
        if free {
            self.owned.push(Label { x, text: text.into() });
        }
        free
    }

    /// All marks.
    pub fn labels(self) -> Vec<Label> {
        self.owned
    }
}

/// A line of a drawn spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Amplitude, in the spectrum's unit.
    pub amplitude: f64,
    /// Over the median beside it, dB.
    pub over_floor_db: f64,
}

/// The line at a place of a spectrum of evenly spaced points, ascending; none outside.
pub fn line_at(points: &[(f64, f64)], x: f64) -> Option<Line> {
    /// Points on each side that are the line itself.
    const LINE_POINTS: usize = 2;
    /// Points on each side that its floor is read from.
    const FLOOR_POINTS: usize = 40;
    let at = points.partition_point(|point| point.0 < x);
    if at == 0 || at >= points.len() {
        return None;
    }
    let at = if x - points[at - 1].0 < points[at].0 - x { at - 1 } else { at };
    let part = |half: usize| &points[at.saturating_sub(half)..(at + half + 1).min(points.len())];
    let amplitude = part(LINE_POINTS).iter().map(|point| point.1).fold(0.0, f64::max);
    let mut beside: Vec<f64> = part(FLOOR_POINTS).iter().map(|point| point.1).collect();
    beside.sort_by(f64::total_cmp);
    let floor = beside[beside.len() / 2];
    let over_floor_db = 20.0 * (amplitude.max(f64::MIN_POSITIVE) / floor.max(f64::MIN_POSITIVE)).log10();
    Some(Line { amplitude, over_floor_db })
}

#[cfg(test)]
mod tests {
    use super::{Owners, line_at};

    #[test]
    fn regress_the_mesh_line_is_not_a_bearings_fifth_harmonic_too() {
        let mut owners = Owners::new(0.05);
        assert!(owners.claim(23.0, "1 x mesh"));
        assert!(!owners.claim(23.04, "5 x 4.608"), "within a line's width of the mesh");
        assert!(owners.claim(23.113, "5 x 4.623"), "a line of its own");
        assert_eq!(owners.labels().len(), 2);
    }

    #[test]
    fn ref_a_line_is_read_over_its_own_floor() {
        let points: Vec<(f64, f64)> =
            (0..200).map(|n| (0.1 * f64::from(n), if n == 100 { 10.0 } else { 1.0 })).collect();
        let line = line_at(&points, 10.02).expect("within");
        assert!((line.amplitude - 10.0).abs() < 1e-9 && (line.over_floor_db - 20.0).abs() < 1e-9, "{line:?}");
        assert!(line_at(&points, 25.0).is_none());
    }
}
