//! Which turns of a run are fitted, and which are kept for the end.
//!
//! Blocks of whole pinion turns, about a quarter of them held out, inside the run so that whatever moves with the
//! speed is interpolated, a gap of a few turns on either side of each so that no filter or window reaches across. One
//! block where the speed is steady (long stretches resolve close lines), two to six where it is not (a block in the
//! middle of a run-up would leave a whole range of speeds unseen). Limit: a stretch of the same run shares its load
//! and temperature with the rest; it is no second measurement.

use serde::Serialize;

/// Share of the turns held out.
const SHARE: f64 = 0.25;
/// Fastest over slowest turn from which one block is too much at once.
const MAX_SPEED_RATIO: f64 = 1.1;
/// Most blocks then.
const BLOCKS: usize = 6;
/// Turns of the slower shaft that a fitted stretch keeps then: its sidebands must not touch.
const LEAST_STRETCH: f64 = 14.0;
/// Turns of the slower shaft in a gap.
const GAP: f64 = 1.0;
/// Turns of the slower shaft below which nothing can be held out.
pub const FEWEST_TURNS: f64 = 16.0;

/// Turns next to each other, counted from the first of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Stretch {
    /// First turn of the pinion.
    pub from: usize,
    /// Turns of the pinion.
    pub turns: usize,
}

impl Stretch {
    /// Samples of the stretch in a grid of `per_turn` samples.
    pub fn samples(self, per_turn: usize) -> std::ops::Range<usize> {
        self.from * per_turn..(self.from + self.turns) * per_turn
    }
}

/// The split of one run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Split {
    /// Fitted; all of one length.
    pub fit: Vec<Stretch>,
    /// Kept for the end.
    pub held_out: Vec<Stretch>,
    /// Pinion turns left out between the two.
    pub gap_turns: usize,
}

impl Split {
    /// Of `turns` whole turns whose fastest is `fastest_over_slowest` times the slowest; `slower_order` is that of
    /// the slower shaft.
    pub fn new(turns: usize, slower_order: f64, fastest_over_slowest: f64) -> Self {
        if turns as f64 * slower_order < FEWEST_TURNS {
            return Self { fit: vec![Stretch { from: 0, turns }], ..Self::default() };
        }
        let gap = (GAP / slower_order).ceil() as usize;
        let lengths = |blocks: usize| {
            let held = ((SHARE * turns as f64) as usize / blocks).max(1);
            (held, turns.saturating_sub(blocks * (held + 2 * gap)) / (blocks + 1))
        };
        let is_long = |blocks: &usize| lengths(*blocks).1 as f64 * slower_order >= LEAST_STRETCH;
        let moving = (2..=BLOCKS).rev().find(is_long).unwrap_or(1);
        let blocks = if fastest_over_slowest > MAX_SPEED_RATIO { moving } else { 1 };
        let (held, fit) = lengths(blocks);
        let mut split = Self { gap_turns: gap, ..Self::default() };
        let mut from = 0;
        for block in 0..=blocks {
            split.fit.push(Stretch { from, turns: fit });
            from += fit + gap;
            if block < blocks {
                split.held_out.push(Stretch { from, turns: held });
                from += held + gap;
            }
        }
        split
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_stretches_do_not_meet_and_a_quarter_is_held_out() {
        for (turns, order, moves) in [(360, 0.377, 1.02), (400, 0.25, 2.5), (48, 1.0, 1.0), (90, 0.25, 1.5)] {
            let split = Split::new(turns, order, moves);
            let mut all: Vec<Stretch> = split.fit.iter().chain(&split.held_out).copied().collect();
            all.sort_by_key(|s| s.from);
            assert!(all.windows(2).all(|w| w[0].from + w[0].turns + split.gap_turns <= w[1].from), "{split:?}");
            let last = all.last().expect("stretches");
            assert!(last.from + last.turns <= turns, "{split:?} of {turns}");
            let held: usize = split.held_out.iter().map(|s| s.turns).sum();
            assert!((held as f64 / turns as f64 - SHARE).abs() < 0.05, "{held} of {turns}");
            assert!(split.held_out.iter().all(|s| s.from > 0 && s.from + s.turns < turns));
        }
        assert!(Split::new(20, 0.25, 1.0).held_out.is_empty());
    }
}
