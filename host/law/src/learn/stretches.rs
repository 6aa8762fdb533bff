//! Stretches of whole turns whose speed hardly changes.

use crate::analysis::angle::Angle;

/// Fewest turns of the pinion in a stretch: two halves of two.
pub const FEWEST_TURNS: usize = 4;
/// Most turns; longer ones give no finer place, and several tell the scatter.
const MOST_TURNS: usize = 8;
/// Share by which a turn's speed may differ from that of the stretch's first.
pub const SPEED_TOLERANCE_SHARE: f64 = 0.03;

/// A stretch on the grid of equal angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// First turn, counted from the grid's beginning.
    pub first: usize,
    /// Turns of the pinion, an even number.
    pub turns: usize,
    /// Mean speed of the pinion, Hz.
    pub speed_hz: f64,
    /// Its beginning and end, s.
    pub time_s: [f64; 2],
}

/// All stretches of a run, one behind the other.
pub fn stretches(angle: &Angle) -> Vec<Stretch> {
    let time = |turn: usize| angle.map.time_at(angle.from_turn + turn as f64);
    let speed = |turn: usize| 1.0 / (time(turn + 1) - time(turn));
    let mut found = Vec::new();
    let mut first = 0;
    while first + FEWEST_TURNS <= angle.turns {
        let like = |turn: &usize| (speed(*turn) / speed(first) - 1.0).abs() < SPEED_TOLERANCE_SHARE;
        let turns = (first..(first + MOST_TURNS).min(angle.turns)).take_while(like).count() / 2 * 2;
        if turns < FEWEST_TURNS {
            first += 1;
            continue;
        }
        let time_s = [time(first), time(first + turns)];
        found.push(Stretch { first, turns, speed_hz: turns as f64 / (time_s[1] - time_s[0]), time_s });
        first += turns;
    }
    found
}
