//! Clipping: samples that stand still at the end of the range.
//!
//! No family of lines: it is seen in the samples. What decides: several neighbours of one code at the very extreme of a channel; a signal that is not limited has one or two there.

use crate::kinematic::scene::Scene;

/// Pairs of neighbours at an extreme from which a channel is limited.
const LEAST_PAIRS: usize = 8;

/// Index in the record and number of limited pairs of every channel that is limited, all runs.
pub fn limited(scene: &Scene) -> Vec<(usize, usize)> {
    let pairs = |c: usize| scene.runs.iter().map(|run| run.at_limit[c]).sum::<usize>();
    let all = scene.channels.iter().enumerate().map(|(c, channel)| (channel.index, pairs(c)));
    all.filter(|(_, pairs)| *pairs >= LEAST_PAIRS).collect()
}
