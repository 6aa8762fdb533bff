//! The likeliest reading of a stretch of edges: which of them count, and how many periods lie between them.
//!
//! A chain goes from edge to edge. Going on to edge j over n periods costs the chance of n - 1 lost pulses, of the
//! edges passed over as too many, and of the interval's departure from n periods (normal, with a broad part for a
//! pulse out of its place). All chains are summed by the number of periods that they count in all, so the share of
//! the sum that counts otherwise than the likeliest chain is the probability that the count is wrong (forward sum
//! and Viterbi path over edge and count).
//!
//! Cost: edges x 8 x 3 x 7 steps. Limit: pulses lost or too many come independently of each other.

/// Numbers of periods to either side of the nearest that are followed.
const SIDE_COUNTS: usize = 3;
const COUNTS: usize = 2 * SIDE_COUNTS + 1;
/// Share of pulses out of their place, and how far they are, periods.
const MOVED_PULSE_SHARE: f64 = 0.01;
const MOVE_PERIODS: f64 = 0.25;
/// Edges in succession that may be too many, anywhere and within this many periods.
const MAX_EXTRA_EDGES: usize = 4;
const MAX_BURST_EDGES: usize = 32;
const BURST_PERIODS: f64 = 4.5;

/// Chance that the angle jumps all the same: the clock, the recording.
const SLIP: f64 = 1e-4;
/// Chance of one more where one is lost or too many already: contacts open and bounce in bursts.
const BURST: f64 = 0.3;

/// How much seldomer an edge too many is at an end of the run than elsewhere.
const END_PROBABILITY_RATIO: f64 = 0.1;

/// How often pulses are lost, and edges are too many, per pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chances {
    pub lost: f64,
    pub extra: f64,
}

/// A stretch of edges; the first one counts.
pub(super) struct Stretch<'a> {
    /// Places of the edges, periods, ascending.
    pub places: &'a [f64],
    /// Standard deviation of an interval of so many periods from an edge.
    pub deviation: &'a dyn Fn(usize, usize) -> f64,
    /// Whether the last edge counts, too.
    pub ends_in_step: bool,
}

/// What was read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reading {
    /// Edges that count behind the first one, each with the periods from the one before.
    pub steps: Vec<(usize, usize)>,
    /// Probability that the sum of the periods is another one.
    pub wrong: f64,
}

/// A state of the chain: the best way there, and the sum of all ways, as logarithms.
#[derive(Clone, Copy)]
struct State {
    best: f64,
    sum: f64,
    /// Edge, count and periods of the best step there.
    from: (usize, usize, usize),
}

const UNREACHED_STATE: State = State { best: f64::NEG_INFINITY, sum: f64::NEG_INFINITY, from: (0, 0, 0) };

/// Reads a stretch of at least two edges.
pub(super) fn read(stretch: &Stretch<'_>, chances: Chances) -> Reading {
    let places = stretch.places;
    let count = places.len();
    let nearest = |edge: usize| (places[edge] - places[0]).round() as isize;
    let mut states = vec![[UNREACHED_STATE; COUNTS]; count];
    states[0][SIDE_COUNTS] = State { best: 0.0, sum: 0.0, from: (0, 0, 0) };
    for i in 0..count - 1 {
        for j in i + 1..count.min(i + 1 + MAX_BURST_EDGES) {
            let apart = places[j] - places[i];
            if j - i > MAX_EXTRA_EDGES && apart > BURST_PERIODS {
                break;
            }
            let passed = burst(j - i - 1, chances.extra);
            let whole = apart.round().max(1.0) as usize;
            for periods in whole.saturating_sub(1).max(1)..=whole + 1 {
                let step = passed + cost(apart, periods, (stretch.deviation)(i, periods), chances);
                let shift = nearest(i) + periods as isize - nearest(j);
                go(&mut states, (i, j), shift, periods, step);
            }
        }
    }
    if stretch.ends_in_step {
        weigh_sums(&mut states[count - 1], stretch);
    }
    let (edge, at) = end(&states, stretch.ends_in_step, chances);
    let total = states[edge].iter().fold(f64::NEG_INFINITY, |sum, state| add(sum, state.sum));
    Reading { steps: path(&states, edge, at), wrong: -(states[edge][at].sum - total).exp_m1() }
}

/// Weighs the counts of a stretch between two edges in step by the angle between them: a shaft does not slip.
fn weigh_sums(states: &mut [State; COUNTS], stretch: &Stretch<'_>) {
    let apart = stretch.places[stretch.places.len() - 1] - stretch.places[0];
    for (at, state) in states.iter_mut().enumerate() {
        let Some(periods) = (apart.round() as usize + at).checked_sub(SIDE_COUNTS) else { continue };
        let sigma = (stretch.deviation)(0, periods);
        let off = (apart - periods as f64) / sigma;
        let fits = ((-0.5 * off * off).exp() / (sigma * std::f64::consts::TAU.sqrt()) + SLIP).ln();
        state.best += fits;
        state.sum += fits;
    }
}

/// Logarithm of the chance of so many faults at one place.
fn burst(count: usize, chance: f64) -> f64 {
    if count == 0 { 0.0 } else { chance.ln() + (count - 1) as f64 * BURST.ln() }
}

/// Logarithm of the chance of edges beyond the end of the chain: seldom is a run's first or last edge no pulse.
fn beyond(count: usize, chances: Chances) -> f64 {
    if count == 0 { 0.0 } else { burst(count, chances.extra) + END_PROBABILITY_RATIO.ln() }
}

/// Logarithm of the likelihood of one step.
fn cost(apart: f64, periods: usize, deviation: f64, chances: Chances) -> f64 {
    let normal = |sigma: f64| {
        let off = (apart - periods as f64) / sigma;
        (-0.5 * off * off).exp() / (sigma * std::f64::consts::TAU.sqrt())
    };
    let broad = deviation.hypot(MOVE_PERIODS);
    let density = (1.0 - MOVED_PULSE_SHARE) * normal(deviation) + MOVED_PULSE_SHARE * normal(broad);
    // Far out both underflow: the broad part's own logarithm goes on.
    let far = MOVED_PULSE_SHARE.ln() - 0.5 * ((apart - periods as f64) / broad).powi(2) - broad.ln();
    burst(periods - 1, chances.lost) + if density > 0.0 { density.ln() } else { far }
}

/// Enters all counts of one step from an edge to another.
fn go(states: &mut [[State; COUNTS]], (i, j): (usize, usize), shift: isize, periods: usize, step: f64) {
    for at in 0..COUNTS {
        let from = states[i][at];
        let Some(there) = at.checked_add_signed(shift).filter(|there| *there < COUNTS) else { continue };
        if from.sum == f64::NEG_INFINITY {
            continue;
        }
        let to = &mut states[j][there];
        to.sum = add(to.sum, from.sum + step);
        if from.best + step > to.best {
            (to.best, to.from) = (from.best + step, (i, at, periods));
        }
    }
}

/// Edge and count at which the likeliest chain ends.
fn end(states: &[[State; COUNTS]], in_step: bool, chances: Chances) -> (usize, usize) {
    let last = states.len() - 1;
    let from = if in_step { last } else { 0 };
    let score = |edge: usize, at: usize| states[edge][at].best + beyond(last - edge, chances);
    let all = (from..=last).flat_map(|edge| (0..COUNTS).map(move |at| (edge, at)));
    all.max_by(|a, b| score(a.0, a.1).total_cmp(&score(b.0, b.1))).unwrap_or((last, SIDE_COUNTS))
}

fn path(states: &[[State; COUNTS]], edge: usize, at: usize) -> Vec<(usize, usize)> {
    let (mut edge, mut at) = (edge, at);
    let mut steps = Vec::new();
    while edge > 0 && states[edge][at].best > f64::NEG_INFINITY {
        let (from, before, periods) = states[edge][at].from;
        steps.push((edge, periods));
        (edge, at) = (from, before);
    }
    steps.reverse();
    steps
}

/// Logarithm of a sum.
fn add(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}
