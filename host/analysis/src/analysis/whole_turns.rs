//! Edges of a wheel of several marks, as a shaft with inertia would have made them with perfect marks.
//!
//! A wheel's marks are uneven, and where a channel samples its voltage every edge is off by a share of a sample; the
//! angle takes both over, and at the tenth mesh harmonic both are phase: lines at every order of that shaft, and
//! noise beneath everything. The mean of the edges of one whole turn about each edge has neither (uneven marks
//! cancel, exactly once their mean departures are taken off, jitter falls with the root of the marks); what the mean
//! takes off a changing speed is put back by a mean of what it left. Cost: the speed between one turn and the next is
//! smooth, so a shaft that truly turns unevenly within its turn shows as modulation of the mesh by that shaft, where
//! the unevenness of the marks would have hidden it. Limit: a wander at an order `v` of the shaft is followed but for
//! `(1 - sinc v)^2`: 0.002 % at 0.05, 0.4 % at 0.2. A single mark has nothing to average and is left alone.

/// Fewest turns over which means are taken.
const FEWEST_TURNS: usize = 4;

/// Edges of a wheel of `pulses` marks by means over whole turns: as many, at the same marks. A single mark and too
/// few turns are left as they are.
pub fn smoothed(edges_s: &[f64], pulses: u32) -> Vec<f64> {
    let pulses = pulses as usize;
    if pulses < 2 || edges_s.len() < FEWEST_TURNS * pulses {
        return edges_s.to_vec();
    }
    let even = evened(edges_s, &averaged(edges_s, pulses), pulses);
    averaged(&even, pulses)
}

/// Edges with each mark's mean departure from smooth ones taken off, which is a share of the turn: where the speed
/// changes, uneven marks do not quite cancel in a mean.
fn evened(edges: &[f64], smooth: &[f64], pulses: usize) -> Vec<f64> {
    let period = |i: usize| {
        let from = i.saturating_sub(pulses / 2).min(smooth.len() - 1 - pulses);
        smooth[from + pulses] - smooth[from]
    };
    let departure = |i: usize| (edges[i] - smooth[i]) / period(i);
    let of_mark = |mark: usize| {
        let turns = (mark..edges.len()).step_by(pulses);
        turns.clone().map(departure).sum::<f64>() / turns.count() as f64
    };
    let marks: Vec<f64> = (0..pulses).map(of_mark).collect();
    edges.iter().enumerate().map(|(i, edge)| edge - marks[i % pulses] * period(i)).collect()
}

/// Edges by means over whole turns, and what the means take off a changing speed put back.
fn averaged(edges_s: &[f64], pulses: usize) -> Vec<f64> {
    let extended = extended(edges_s, pulses);
    let mean = means(&extended, pulses);
    let left: Vec<f64> = extended.iter().zip(&mean).map(|(edge, mean)| edge - mean).collect();
    let put_back = means(&left, pulses);
    (pulses..pulses + edges_s.len()).map(|i| mean[i] + put_back[i]).collect()
}

/// One more turn on each side, the same marks on the parabola through the three turns next to it.
fn extended(edges: &[f64], pulses: usize) -> Vec<f64> {
    let count = edges.len();
    let ahead = |i: usize| 3.0 * edges[i] - 3.0 * edges[i + pulses] + edges[i + 2 * pulses];
    let behind = |i: usize| {
        let i = count - pulses + i;
        3.0 * edges[i] - 3.0 * edges[i - pulses] + edges[i - 2 * pulses]
    };
    let before = (0..pulses).map(ahead);
    before.chain(edges.iter().copied()).chain((0..pulses).map(behind)).collect()
}

/// Means over one turn about each value, half a mark's weight at the ends where their number is even; shorter ones at
/// the ends of the run.
fn means(values: &[f64], pulses: usize) -> Vec<f64> {
    let half = pulses / 2;
    let mut sums = vec![0.0];
    // Sums of departures from a straight line: sums of times would lose digits.
    let slope = (values[values.len() - 1] - values[0]) / (values.len() - 1) as f64;
    let line = |i: usize| values[0] + slope * i as f64;
    for (i, x) in values.iter().enumerate() {
        sums.push(sums[i] + x - line(i));
    }
    let sum = |from: usize, to: usize| sums[to] - sums[from];
    let mean = |i: usize| {
        let reach = half.min(i).min(values.len() - 1 - i);
        let (from, to) = (i - reach, i + reach + 1);
        let departure = if pulses.is_multiple_of(2) && reach == half {
            0.5 * (sum(from, to - 1) + sum(from + 1, to)) / pulses as f64
        } else {
            sum(from, to) / (to - from) as f64
        };
        line(i) + departure
    };
    (0..values.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    /// Times of a shaft's marks whose speed rises and wanders.
    fn truth(pulses: u32, turns: u32) -> Vec<f64> {
        (0..pulses * turns)
            .map(|i| {
                let turn = f64::from(i) / f64::from(pulses);
                0.1 * turn - 1e-4 * turn * turn + 5e-4 * (TAU * 0.03 * turn).sin()
            })
            .collect()
    }

    #[test]
    fn theory_uneven_marks_cancel_and_jitter_falls_with_their_number() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for pulses in [2, 8, 13, 60] {
            let truth = truth(pulses, 40);
            let uneven: Vec<f64> = (0..pulses).map(|i| 1e-4 * (TAU * 0.37 * f64::from(i * i)).sin()).collect();
            let mean = uneven.iter().sum::<f64>() / f64::from(pulses);
            let marks = |i: usize| truth[i] + uneven[i % pulses as usize] - mean;
            let edges: Vec<f64> = (0..truth.len()).map(marks).collect();
            let error = |edges: &[f64]| {
                let square = |(a, b): (&f64, &f64)| (a - b).powi(2);
                (smoothed(edges, pulses).iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64).sqrt()
            };
            assert!(error(&edges) < 2e-7, "{pulses} uneven marks: {:e}", error(&edges));
            let jittered: Vec<f64> =
                truth.iter().map(|t| t + 1e-6 * Distribution::<f64>::sample(&StandardNormal, &mut random)).collect();
            let expected = 1e-6 * (2.5 / f64::from(pulses)).sqrt().min(1.3);
            assert!(error(&jittered) < expected + 2e-7, "{pulses} marks: {:e}", error(&jittered));
        }
    }

    #[test]
    fn theory_uneven_marks_leave_nothing_at_the_shafts_orders_though_the_speed_wanders() {
        let (pulses, turns) = (8_u32, 200_u32);
        // A speed that wanders by a percent over 20 turns, and marks uneven by thousandths of a turn.
        let truth = |turn: f64| 0.1 * turn + 0.1 * 0.01 * 20.0 / TAU * (TAU * turn / 20.0).sin();
        let uneven = |i: u32| 2e-3 * (TAU * 0.37 * f64::from(i % pulses * (i % pulses))).sin();
        let edges: Vec<f64> =
            (0..pulses * turns).map(|i| truth(f64::from(i) / f64::from(pulses) + uneven(i))).collect();
        let found = smoothed(&edges, pulses);
        let off: Vec<f64> = found.iter().enumerate().map(|(i, t)| t - truth(i as f64 / f64::from(pulses))).collect();
        let beside = |order: f64| {
            let turn = |i: usize| TAU * order * i as f64 / f64::from(pulses);
            let hann = |i: usize| 1.0 - (TAU * (i as f64 + 0.5) / off.len() as f64).cos();
            let [cos, sin] = [f64::cos, f64::sin]
                .map(|wave| off.iter().enumerate().map(|(i, x)| hann(i) * x * wave(turn(i))).sum::<f64>());
            cos.hypot(sin) / off.len() as f64 * 2.0 / 0.1
        };
        // Without taking the marks' departures off: 2e-7 of a turn and more.
        for order in [0.95, 1.05, 1.95, 2.05] {
            assert!(beside(order) < 2e-8, "order {order}: {:e} turns", beside(order));
        }
    }

    #[test]
    fn theory_a_single_mark_is_left_alone() {
        let edges = truth(1, 20);
        assert_eq!(smoothed(&edges, 1), edges);
    }
}
