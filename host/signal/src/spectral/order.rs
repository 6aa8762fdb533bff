//! Order spectra and time-synchronous averages in f64: the reference for the node's order tracking.
//!
//! The shaft's angle follows from the tach edges by a natural cubic spline of *time over angle* (knots are
//! equally spaced, so the spline is one tridiagonal solve); the signal is read at equal angles by a
//! Kaiser-windowed sinc ([`Kaiser`], -100 dB error up to 0.8 of Nyquist). The angle grid must be at least as
//! dense as the samples, or it would alias: [`resample_by_angle`] only ever raises the rate, callers then
//! look at the orders they want.

use super::{Kaiser, Spectrum, Window, amplitude_spectrum};

/// Newton's steps at most: the curve is straight to a few per cent, and each squares the error.
const NEWTON_STEPS: usize = 8;
/// Error of an inverse, of the pulses so far.
const INVERSION_ERROR: f64 = 1e-12;

/// Time as a smooth function of shaft angle, from equally spaced tach pulses.
#[derive(Debug, Clone)]
pub struct AngleMap {
    first_turn: f64,
    pulses_per_rev: f64,
    times: Vec<f64>,
    /// Second derivatives by pulse number at the knots.
    curvature: Vec<f64>,
}

impl AngleMap {
    /// Map through `edges_s` (strictly ascending, at least two), the first at `first_turn` turns.
    ///
    /// `None` with fewer than two edges.
    pub fn new(edges_s: &[f64], pulses_per_rev: u32, first_turn: f64) -> Option<Self> {
        (edges_s.len() >= 2 && pulses_per_rev > 0).then(|| Self {
            first_turn,
            pulses_per_rev: f64::from(pulses_per_rev),
            times: edges_s.to_vec(),
            curvature: natural_spline(edges_s),
        })
    }

    /// The same map in turns of a shaft that turns `ratio` times as fast and passes its angle 0 together with this one.
    pub fn geared(mut self, ratio: f64) -> Self {
        self.first_turn *= ratio;
        self.pulses_per_rev /= ratio;
        self
    }

    /// Turns at the first and the last edge.
    pub fn range(&self) -> (f64, f64) {
        (self.first_turn, self.first_turn + (self.times.len() - 1) as f64 / self.pulses_per_rev)
    }

    /// Time, s, at which the shaft stands at `turns`; straight on beyond the edges.
    pub fn time_at(&self, turns: f64) -> f64 {
        let position = (turns - self.first_turn) * self.pulses_per_rev;
        let i = (position.floor().max(0.0) as usize).min(self.times.len() - 2);
        self.within(i, position - i as f64).0
    }

    /// Time `u` pulses after edge `i`, and seconds per pulse there; straight on outside the interval.
    fn within(&self, i: usize, u: f64) -> (f64, f64) {
        let slope = self.times[i + 1] - self.times[i];
        let (m0, m1) = (self.curvature[i], self.curvature[i + 1]);
        if u < 0.0 {
            let slope = slope - (2.0 * m0 + m1) / 6.0;
            return (self.times[i] + u * slope, slope);
        }
        if u > 1.0 {
            let slope = slope + (m0 + 2.0 * m1) / 6.0;
            return (self.times[i + 1] + (u - 1.0) * slope, slope);
        }
        let v = 1.0 - u;
        let time = v * self.times[i] + u * self.times[i + 1] + ((v * v * v - v) * m0 + (u * u * u - u) * m1) / 6.0;
        (time, slope + ((1.0 - 3.0 * v * v) * m0 + (3.0 * u * u - 1.0) * m1) / 6.0)
    }

    /// Turns of the shaft at `time_s`: the inverse of [`AngleMap::time_at`], to 1e-12 of a pulse.
    pub fn turns_at(&self, time_s: f64) -> f64 {
        self.inverse(self.times.partition_point(|t| *t <= time_s).saturating_sub(1), time_s)
    }

    /// [`AngleMap::turns_at`] of each of the times `first_s + i * step_s`, in turn.
    pub fn turns_along(&self, first_s: f64, step_s: f64) -> impl Iterator<Item = f64> {
        let mut edge = 0;
        (0_u64..).map(move |i| {
            let time_s = first_s + i as f64 * step_s;
            while edge + 2 < self.times.len() && self.times[edge + 1] <= time_s {
                edge += 1;
            }
            self.inverse(edge, time_s)
        })
    }

    /// Turns at `time_s`, whose last edge before it is `edge`.
    fn inverse(&self, edge: usize, time_s: f64) -> f64 {
        let i = edge.min(self.times.len() - 2);
        let mut u = (time_s - self.times[i]) / (self.times[i + 1] - self.times[i]);
        for _ in 0..NEWTON_STEPS {
            let (time, slope) = self.within(i, u);
            let change = (time_s - time) / slope;
            u += change;
            if change.abs() < INVERSION_ERROR * (1.0 + i as f64) {
                break;
            }
        }
        self.first_turn + (i as f64 + u) / self.pulses_per_rev
    }

    /// Shaft speed, Hz, at the middle of each pulse interval.
    pub fn speeds_hz(&self) -> Vec<f64> {
        self.times.windows(2).map(|w| 1.0 / ((w[1] - w[0]) * self.pulses_per_rev)).collect()
    }
}

/// Second derivatives of the natural cubic spline through `y` at unit spacing.
pub fn natural_spline(y: &[f64]) -> Vec<f64> {
    let n = y.len();
    let mut m = vec![0.0; n];
    if n < 3 {
        return m;
    }
    // Thomas algorithm for m[i-1] + 4 m[i] + m[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1]).
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let pivot = 4.0 - upper[i - 1];
        upper[i] = 1.0 / pivot;
        m[i] = (6.0 * (y[i - 1] - 2.0 * y[i] + y[i + 1]) - m[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        m[i] -= upper[i] * m[i + 1];
    }
    m
}

/// The signal at `samples_per_turn` equal angles over `turns` whole turns from `from_turn`.
///
/// Points outside the record read as zero-extended signal: choose turns inside it. The grid should hold at least
/// as many samples per turn as the signal does (`rate / speed`), otherwise high frequencies fold.
pub fn resample_by_angle(
    signal: &[f64],
    rate_hz: f64,
    map: &AngleMap,
    from_turn: f64,
    turns: usize,
    samples_per_turn: usize,
) -> Vec<f64> {
    let kernel = Kaiser::tabulated();
    (0..turns * samples_per_turn)
        .map(|i| kernel.interpolate(signal, rate_hz * map.time_at(from_turn + i as f64 / samples_per_turn as f64)))
        .collect()
}

/// Peak-amplitude spectrum over orders of the map's shaft, from all whole turns between its edges.
///
/// `None` where there is no whole turn. Resolution is one order over the number of turns.
pub fn order_spectrum(signal: &[f64], rate_hz: f64, map: &AngleMap, window: Window) -> Option<Spectrum> {
    let (samples, turns, per_turn) = whole_turns(signal, rate_hz, map)?;
    debug_assert_eq!(samples.len(), turns * per_turn);
    Some(amplitude_spectrum(&samples, per_turn as f64, window))
}

/// Time-synchronous average: mean over all whole turns, as samples over one turn from the map's angle 0.
///
/// Returns the average and the number of turns; `None` where there is no whole turn.
pub fn synchronous_average(signal: &[f64], rate_hz: f64, map: &AngleMap) -> Option<(Vec<f64>, usize)> {
    let (samples, turns, per_turn) = whole_turns(signal, rate_hz, map)?;
    let mut average = vec![0.0; per_turn];
    for (i, x) in samples.iter().enumerate() {
        average[i % per_turn] += x / turns as f64;
    }
    Some((average, turns))
}

/// All whole turns from the first angle 0 onwards, dense enough not to fold.
fn whole_turns(signal: &[f64], rate_hz: f64, map: &AngleMap) -> Option<(Vec<f64>, usize, usize)> {
    let (first, last) = map.range();
    let from = (first - 1e-9).ceil();
    let turns = (last + 1e-9 - from).floor();
    if turns < 1.0 {
        return None;
    }
    let slowest = map.speeds_hz().into_iter().fold(f64::INFINITY, f64::min);
    let per_turn = ((rate_hz / slowest).ceil() as usize).next_power_of_two();
    Some((resample_by_angle(signal, rate_hz, map, from, turns as usize, per_turn), turns as usize, per_turn))
}
