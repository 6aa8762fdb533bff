//! Wheels with missing marks: 60-2, 36-1, several gaps, told by where pulses had to be put in.
//!
//! A mark that is not there is missing in every turn: over the turns of a sure stretch it is put in at one place of
//! the wheel and nowhere else. Gaps that come again after another number of pulses than is declared are another
//! wheel, which is refused with its number. Lost pulses come anywhere. Needs four turns.

use crate::pulses::{Place, Pulses};

/// Fewest turns of a stretch that tells a wheel.
const LEAST_TURNS: usize = 4;
/// A mark that passes in fewer turns than this share is missing; the others must pass in more than that one.
const MISSING_MARK_SHARE: f64 = 0.2;
const PRESENT_MARK_SHARE: f64 = 0.6;
/// Fewest gaps, and share of them the same number of pulses apart, that are a wheel of their own.
const LEAST_GAPS: usize = 6;
const MIN_EQUAL_GAP_SHARE: f64 = 0.8;

/// Marks that a wheel does not have.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Missing {
    /// Marks, counted from the run's first pulse, ascending; at least one.
    pub marks: Vec<usize>,
}

/// The missing marks of a wheel of `marks` places; `Ok(None)` where there are none.
///
/// # Errors
/// In words: gaps of a wheel with another number of marks.
pub(super) fn find(pulses: &Pulses, marks: usize) -> Result<Option<Missing>, String> {
    let sure = pulses.longest_stretch();
    if let Some((wheel, missing)) = another_wheel(&pulses.measured[sure.clone()], marks) {
        return Err(format!(
            "{missing} of every {wheel} pulses are missing, so the wheel has {wheel} places ({wheel}-{missing}), \
              not {marks}: --pulses {wheel}"
        ));
    }
    if marks < 3 || sure.len() < LEAST_TURNS * marks {
        return Ok(None);
    }
    let mut passed = vec![(0_usize, 0_usize); marks];
    for k in sure {
        let mark = &mut passed[k % marks];
        mark.0 += usize::from(pulses.measured[k]);
        mark.1 += 1;
    }
    let share = |m: &usize| passed[*m].0 as f64 / passed[*m].1.max(1) as f64;
    let missing: Vec<usize> = (0..marks).filter(|m| share(m) < MISSING_MARK_SHARE).collect();
    let told = (0..marks).all(|m| share(&m) < MISSING_MARK_SHARE || share(&m) > PRESENT_MARK_SHARE);
    Ok((told && !missing.is_empty() && missing.len() < marks).then_some(Missing { marks: missing }))
}

/// Places and missing pulses of a wheel whose gaps come after a number of pulses that does not divide `marks`.
fn another_wheel(measured: &[bool], marks: usize) -> Option<(usize, usize)> {
    let begins: Vec<usize> = (1..measured.len()).filter(|&k| measured[k - 1] && !measured[k]).collect();
    if begins.len() < LEAST_GAPS {
        return None;
    }
    let apart: Vec<usize> = begins.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = apart.clone();
    sorted.sort_unstable();
    let wheel = sorted[sorted.len() / 2];
    let same = apart.iter().filter(|a| **a == wheel).count();
    let length = |from: usize| measured[from..].iter().take_while(|m| !**m).count();
    let mut lengths: Vec<usize> = begins.iter().map(|b| length(*b)).collect();
    lengths.sort_unstable();
    let regular = same as f64 >= MIN_EQUAL_GAP_SHARE * apart.len() as f64;
    (regular && wheel > 2 && !marks.is_multiple_of(wheel)).then(|| (wheel, lengths[lengths.len() / 2]))
}

impl Missing {
    /// The lost pulses that are no missing marks.
    pub(super) fn lost_besides(&self, pulses: &Pulses, marks: usize) -> Vec<Place> {
        let mut lost: Vec<Place> = Vec::new();
        let mut last = 0;
        let mut open = false;
        for (k, measured) in pulses.measured.iter().enumerate() {
            if *measured {
                (last, open) = (k, false);
            } else if !self.marks.contains(&(k % marks)) {
                match lost.last_mut().filter(|_| open) {
                    Some(place) => place.pulses += 1,
                    None => lost.push(Place { time_s: pulses.times_s[last], pulses: 1 }),
                }
                open = true;
            }
        }
        lost
    }

    /// By how many marks this run begins later on the wheel than `reference`, where one turn of the gaps alone fits.
    pub(super) fn mark_of(&self, reference: &Missing, marks: usize) -> Option<usize> {
        let turned = |shift: usize| {
            let mut all: Vec<usize> = self.marks.iter().map(|m| (m + shift) % marks).collect();
            all.sort_unstable();
            all
        };
        let mut fits = (0..marks).filter(|shift| turned(*shift) == reference.marks);
        match (fits.next(), fits.next()) {
            (Some(shift), None) => Some(shift),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulses::counted;

    /// Edges of a wheel without some of its marks, at a speed that swings by 2 %; uniform errors of an eighth of the
    /// pitch.
    fn edges(marks: usize, missing: &[usize], turns: usize, start: usize) -> Vec<f64> {
        let mut state = 3_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        (start..start + turns * marks)
            .filter(|k| !missing.contains(&(k % marks)))
            .map(|k| {
                let turn = k as f64 / marks as f64;
                turn + 0.02 * (0.4 * turn).sin() + 0.12 * draw() / marks as f64
            })
            .collect()
    }

    #[test]
    fn theory_wheels_are_told_by_their_gaps() {
        let wheels: [(usize, &[usize]); 9] = [
            (36, &[35]),
            (36, &[34, 35]),
            (60, &[59]),
            (60, &[58, 59]),
            (24, &[11]),
            (12, &[3]),
            (30, &[4, 5]),
            (36, &[0, 12, 13, 30]),
            (60, &[19, 39, 59]),
        ];
        for (marks, missing) in wheels {
            let pulses = counted(&edges(marks, missing, 40, 7));
            let found = find(&pulses, marks).expect("that wheel").expect("missing marks");
            let mut expected: Vec<usize> = missing.iter().map(|m| (m + marks - 7) % marks).collect();
            expected.sort_unstable();
            assert_eq!(found.marks, expected, "{marks}-{}", missing.len());
            assert!(pulses.breaks.is_empty() && found.lost_besides(&pulses, marks).is_empty(), "{marks}-{missing:?}");
        }
    }

    #[test]
    fn fault_a_wheel_declared_by_the_marks_it_has_is_named() {
        for (marks, missing) in [(60, vec![58, 59]), (36, vec![35])] {
            let pulses = counted(&edges(marks, &missing, 40, 7));
            let refused = find(&pulses, marks - missing.len()).expect_err("another wheel");
            assert!(refused.contains(&format!("--pulses {marks}")), "{refused}");
        }
        assert_eq!(find(&counted(&edges(36, &[], 40, 7)), 36), Ok(None));
    }

    #[test]
    fn theory_the_gap_tells_which_mark_a_run_begins_with() {
        let runs = [7, 19].map(|start| {
            find(&counted(&edges(36, &[34, 35], 20, start)), 36).expect("that wheel").expect("missing marks")
        });
        assert_eq!(runs[1].mark_of(&runs[0], 36), Some(12));
    }
}
