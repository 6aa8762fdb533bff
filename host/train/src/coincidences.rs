//! Lines of different parts that one record cannot tell apart: at the same order exactly, or nearer than the record
//! resolves.
//!
//! Compared are the orders of shafts (to the third), of meshes (to the tenth harmonic) and of first sidebands of
//! every gear about the first three harmonics. Two lines are apart from `LOBE_BINS / turns` orders on.

use super::fraction::Fraction;
use super::kinematics::Train;
use crate::Result;

use serde::Serialize;

/// Bins from the centre of a line to the end of its main lobe (four-term Blackman-Harris), by which two lines are
/// apart.
const LOBE_BINS: f64 = 4.0;
/// Harmonics compared, and those with sidebands.
const HARMONICS: i64 = 10;
const WITH_SIDEBANDS: i64 = 3;
const SHAFT_HARMONICS: i64 = 3;

/// Two lines at one place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coincidence {
    /// One line, in words.
    pub one: String,
    /// The other.
    pub other: String,
    /// Order of the first.
    pub order: f64,
    /// Orders between the two; 0 where they are the same for ever.
    pub apart: f64,
    /// Turns of the input from which a record tells them apart; none where nothing does.
    pub turns: Option<f64>,
}

struct Line {
    order: Fraction,
    words: String,
    /// What it belongs to: lines of one part are no coincidence.
    part: (u8, usize),
}

/// Pairs of lines that a record of `turns` of the input cannot tell apart, the exact ones first, those of low orders
/// first.
///
/// # Errors
/// Orders beyond 128 bits.
pub fn of(train: &Train, turns: f64) -> Result<Vec<Coincidence>> {
    let mut lines = compared(train)?;
    lines.sort_by_key(|line| line.order);
    let reach = LOBE_BINS / turns;
    let mut found = Vec::new();
    for (i, one) in lines.iter().enumerate() {
        for other in &lines[i + 1..] {
            let apart = other.order.minus(one.order)?.value();
            if apart > reach {
                break;
            }
            if one.part != other.part {
                found.push(Coincidence {
                    one: one.words.clone(),
                    other: other.words.clone(),
                    order: one.order.value(),
                    apart,
                    turns: (apart > 0.0).then(|| LOBE_BINS / apart),
                });
            }
        }
    }
    found.sort_by(|a, b| (a.apart > 0.0, a.order).partial_cmp(&(b.apart > 0.0, b.order)).expect("finite orders"));
    Ok(found)
}

fn compared(train: &Train) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    for shaft in (0..train.shafts.len()).filter(|s| train.exact[*s]) {
        for n in 1..=SHAFT_HARMONICS {
            let words = format!("{n} x shaft {shaft}");
            lines.push(Line { order: train.shaft_order(shaft).multiple(n)?, words, part: (0, shaft) });
        }
    }
    for mesh in train.meshes.iter().filter(|mesh| mesh.exact) {
        for k in 1..=HARMONICS {
            let order = mesh.order.multiple(k)?;
            let words = format!("{k} x mesh of stage {}", mesh.stage + 1);
            lines.push(Line { order, words: words.clone(), part: (1, mesh.stage) });
            for &gear in mesh.gears.iter().filter(|_| k <= WITH_SIDEBANDS) {
                let own = &train.gears[gear];
                for side in [-1, 1] {
                    let beside = order.plus(own.rate.magnitude().multiple(side)?)?;
                    let sign = if side < 0 { '-' } else { '+' };
                    let words = format!("{words} {sign} {}", own.role.word());
                    lines.push(Line { order: beside, words, part: (2, gear) });
                }
            }
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::tests::train;
    use super::*;

    #[test]
    fn theory_equal_fractions_coincide_for_ever_and_near_ones_until_a_record_is_long() {
        // 32/80 and 24/72: the third order of the output is the first of the shaft between; ten meshes of stage 2 are
        // three of stage 1 and more.
        let train =
            train("[[stage]]\nkind = \"pair\"\nteeth = [32, 80]\n[[stage]]\nkind = \"pair\"\nteeth = [24, 72]\n");
        let found = of(&train, 2000.0).unwrap();
        let exact: Vec<(&str, &str)> =
            found.iter().filter(|c| c.turns.is_none()).map(|c| (c.one.as_str(), c.other.as_str())).collect();
        let has = |a: &str, b: &str| exact.iter().any(|(x, y)| (*x, *y) == (a, b) || (*x, *y) == (b, a));
        assert!(has("1 x shaft 1", "3 x shaft 2"), "{exact:?}");
        assert!(has("3 x mesh of stage 1", "10 x mesh of stage 2"), "{exact:?}");
        assert!(found.iter().all(|c| c.apart <= LOBE_BINS / 2000.0));
        let short = of(&train, 20.0).unwrap();
        assert!(short.len() > found.len(), "a short record tells less: {} and {}", short.len(), found.len());
    }
}
