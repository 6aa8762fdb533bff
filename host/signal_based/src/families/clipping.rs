//! Clipping: samples that stand still at the end of the range.
//!
//! No family of lines: it is seen in the samples. What decides: several neighbours of one code at the very extreme of
//! a channel, or as many single samples of it with hardly one in the last five hundredth of the range before it; a
//! signal that is not limited has one or two at its extreme, and more and more beside it.

use crate::clipping_detector::{EMPTY_MARGIN_SHARE, MIN_PILE_COUNT, TIMES};
use crate::scene::Scene;

/// Where a channel may be limited.
pub const SIDES: [Side; 3] = [Side::Above, Side::Below, Side::Both];

/// End of the range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The largest values.
    Above,
    /// The least.
    Below,
    /// Either, at one magnitude.
    Both,
}

impl Side {
    /// How far a sample reaches towards the end of the range.
    fn reach(self, x: f64) -> f64 {
        match self {
            Self::Above => x,
            Self::Below => -x,
            Self::Both => x.abs(),
        }
    }

    /// The sample behind a limit at `level`.
    pub fn limited(self, x: f64, level: f64) -> f64 {
        match self {
            Self::Above => x.min(level),
            Self::Below => x.max(-level),
            Self::Both => x.clamp(-level, level),
        }
    }
}

/// Farthest that a channel reaches to a side, all runs.
pub fn farthest(scene: &Scene, channel: usize, side: Side) -> f64 {
    let samples = scene.runs.iter().flat_map(|run| &run.signals[channel]);
    samples.map(|x| side.reach(*x)).fold(0.0, f64::max)
}

/// Share of that reach which a limit has to cut off before this channel is called limited: the least pairs of
/// neighbours lie beyond it then, or a pile would.
pub fn least_share(scene: &Scene, channel: usize, side: Side) -> Option<f64> {
    let beyond = |w: &[f64]| {
        // Neighbours at opposite ends are no pair.
        let is_one_end = side != Side::Both || w[0] * w[1] > 0.0;
        is_one_end.then(|| side.reach(w[0]).min(side.reach(w[1])))
    };
    let mut pairs: Vec<f64> =
        scene.runs.iter().flat_map(|run| run.signals[channel].windows(2).filter_map(beyond)).collect();
    let middle = MIN_PILE_COUNT.min(pairs.len()).checked_sub(1)?;
    let of_pairs = *pairs.select_nth_unstable_by(middle, |a, b| b.total_cmp(a)).1;
    let level = of_pairs.max(pile(scene, channel, side));
    let farthest = farthest(scene, channel, side);
    (level > 0.0 && farthest > 0.0).then_some(1.0 - level / farthest)
}

/// The highest level at which a limit piles up enough samples with few before it.
fn pile(scene: &Scene, channel: usize, side: Side) -> f64 {
    let of_run = |signal: &Vec<f64>| {
        let (low, high) = signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let mut reached: Vec<f64> = signal.iter().map(|x| side.reach(*x)).collect();
        reached.sort_by(|a, b| b.total_cmp(a));
        let before = |level: f64| reached.partition_point(|x| *x > level - EMPTY_MARGIN_SHARE * (high - low));
        let piles = |i: &usize| *i > TIMES * (before(reached[*i]) - i);
        (MIN_PILE_COUNT..reached.len()).find(piles).map_or(0.0, |i| reached[i])
    };
    scene.runs.iter().map(|run| of_run(&run.signals[channel])).fold(0.0, f64::max)
}

/// Index in the record and number of samples at a limit of every channel that is limited, all runs.
pub fn limited(scene: &Scene) -> Vec<(usize, usize)> {
    let count = |c: usize| scene.runs.iter().map(|run| run.at_limit[c]).sum::<usize>();
    let all = scene.channels.iter().enumerate().map(|(c, channel)| (channel.index, count(c)));
    all.filter(|(_, count)| *count >= MIN_PILE_COUNT).collect()
}
