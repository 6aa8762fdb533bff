//! Angle, speed and acceleration from pulse instants: a recursive least-squares parabola with a memory that adapts.
//!
//! State at the latest pulse: position, rate and acceleration relative to an integer reference period. Each pulse
//! corrects them by its prediction error times the gains of the least-squares parabola through the last `n` pulses
//! (expanding-memory gains, Morrison 1969; Zarchan, Tactical and Strategic Missile Guidance, ch. on recursive least
//! squares). The parabola is exact for constant acceleration. The memory `n` grows by one per pulse up to a limit and
//! shrinks while successive errors have the same sign: then the motion is no parabola over `n` pulses. White errors
//! leave it alone (the innovations of the right filter are white; Mehra 1970), so noise makes it long and a wandering
//! speed short.
//!
//! The gate is six times the RMS prediction error, so it holds what the acceleration's own changes do to the next
//! interval. Where a pulse just outside was the only one for its position, the gate is widened for its successors.
//!
//! Instants and positions are 64-bit integers; only differences are `f32`; nothing drifts.

use crate::math;

/// Smallest half-width of the gate, positions.
pub const NARROWEST_GATE: f32 = 0.01;
/// Largest half-width of the gate, positions.
pub const WIDEST_GATE: f32 = 0.15;
/// Shortest memory, pulses: a parabola with one pulse to spare.
const MIN_MEMORY_PULSES: f32 = 4.0;
/// Weight of the newest error in the mean square.
const VARIANCE_WEIGHT: f32 = 0.04;
/// Weight of the newest product of errors in the correlation.
const CORRELATION_WEIGHT: f32 = 0.12;
/// Correlation above which the memory shrinks, and below which it grows.
const MAX_CORRELATION: f32 = 0.4;
const MIN_CORRELATION: f32 = 0.25;
/// RMS error assumed before any is known, positions.
const FIRST_RMS: f32 = 0.0025;
/// Pulses that a widened gate counts as known, so that it closes again soon.
const WIDENED_GATE_PULSES: u8 = 4;
/// Departure from the reference period at which it is chosen anew.
const REBASE: f32 = 0.01;

/// A pulse: instant and position count.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pulse {
    /// Ticks.
    pub instant: u64,
    /// Positions of the wheel, counted on.
    pub position: u64,
}

/// What a pulse says about the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Where it was expected.
    AsBefore,
    /// Farther off than six times the usual error: another pulse than the position's, or the motion changes.
    Unusual,
    /// Far off on the same side again: the motion has changed and the memory starts anew.
    Changed,
}

/// Adaptive parabola through the latest pulses.
#[derive(Clone, Copy, Debug, Default)]
pub struct AngleFilter {
    last: Pulse,
    /// Reference period, ticks per position.
    period: u64,
    /// At the latest pulse: estimated minus counted position, rate minus one and acceleration, in periods.
    offset: f32,
    rate: f32,
    acceleration: f32,
    memory: f32,
    longest: f32,
    /// Mean square of the prediction errors, positions^2.
    variance: f32,
    correlation: f32,
    error: f32,
    /// Pulses since the start, up to 255.
    taken: u8,
}

impl AngleFilter {
    /// A filter whose memory never exceeds `longest` pulses.
    pub fn new(longest: f32) -> Self {
        Self { period: 1, longest, variance: FIRST_RMS * FIRST_RMS, ..Self::default() }
    }

    /// Forgets how large the errors were.
    pub fn reset_gate(&mut self) {
        self.variance = FIRST_RMS * FIRST_RMS;
    }

    /// Starts anew with four pulses on successive positions, the newest at `position`. The gate stays as wide as it
    /// was.
    pub fn start(&mut self, instants: [u64; 4], position: u64) {
        let [a, b, c, d] = instants;
        self.last = Pulse { instant: d, position };
        self.period = ((d - a) / 3).max(1);
        let per = 1.0 / self.period as f32;
        let gaps = [(b - a) as f32 * per, (c - b) as f32 * per, (d - c) as f32 * per];
        // Mean rates belong to the middles of the gaps.
        let rates = gaps.map(|gap| 1.0 / gap);
        self.acceleration = (rates[2] - rates[0]) / (0.5 * gaps[0] + gaps[1] + 0.5 * gaps[2]);
        let mean_age = (0.5 * gaps[0] + 1.5 * gaps[1] + 2.5 * gaps[2]) * (1.0 / 3.0);
        let mean_rate = (rates[0] + rates[1] + rates[2]) * (1.0 / 3.0);
        self.rate = mean_rate - 1.0 + self.acceleration * mean_age;
        self.offset = 0.0;
        self.memory = MIN_MEMORY_PULSES;
        self.variance = self.variance.max(FIRST_RMS * FIRST_RMS);
        self.taken = 0;
        self.correlation = 0.0;
        self.error = 0.0;
    }

    /// Latest pulse taken.
    pub fn last(&self) -> Pulse {
        self.last
    }

    /// Ticks per position at the latest pulse.
    pub fn present_period(&self) -> f32 {
        self.period as f32 / (1.0 + self.rate).max(0.1)
    }

    /// Latest prediction error, positions.
    pub fn error(&self) -> f32 {
        self.error
    }

    /// Half-width of the gate, positions.
    pub fn gate(&self) -> f32 {
        (6.0 * math::sqrt(self.variance)).clamp(NARROWEST_GATE, WIDEST_GATE)
    }

    /// Positions since the latest pulse: whole ones, the nearest, and the estimate's excess over them.
    pub fn steps(&self, instant: u64) -> (u64, f32) {
        let ticks = instant.saturating_sub(self.last.instant);
        let place = self.place(ticks);
        let steps = (place + 0.5).max(0.0) as u64;
        // Exact integers until the last step.
        let exact = (ticks as i64).wrapping_sub((steps as i64).wrapping_mul(self.period as i64));
        let u = ticks as f32 / self.period as f32;
        (steps, exact as f32 / self.period as f32 + self.offset + u * (self.rate + 0.5 * self.acceleration * u))
    }

    /// Positions passed since the latest pulse after some ticks, by the parabola.
    pub fn place(&self, ticks: u64) -> f32 {
        let u = ticks as f32 / self.period as f32;
        self.offset + u * (1.0 + self.rate + 0.5 * self.acceleration * u)
    }

    /// Place some ticks before the latest pulse, by the parabola.
    pub fn place_before(&self, ticks: u64) -> f32 {
        let u = -(ticks as f32) / self.period as f32;
        self.offset + u * (1.0 + self.rate + 0.5 * self.acceleration * u)
    }

    /// A pulse near the track but outside the gate: the next ones may be as far off.
    pub fn widen(&mut self) {
        let gate = self.gate() * (1.4 / 6.0);
        self.variance = gate * gate;
        self.taken = self.taken.min(WIDENED_GATE_PULSES);
    }

    /// Takes a pulse `steps` positions after the latest, `error` as given by [`AngleFilter::steps`].
    pub fn take(&mut self, instant: u64, steps: u64, error: f32) -> Motion {
        let u = (instant - self.last.instant) as f32 / self.period as f32;
        let motion = self.adapt(error);
        let n = self.memory;
        let cube = 1.0 / (n * (n + 1.0) * (n + 2.0));
        let (gain, rate_gain, acceleration_gain) =
            (3.0 * (3.0 * n * (n - 1.0) + 2.0) * cube, 18.0 * (2.0 * n - 1.0) * cube, 60.0 * cube);
        self.offset = error - gain * error;
        self.rate += self.acceleration * u - rate_gain * error / u;
        self.acceleration -= acceleration_gain * error / (u * u);
        self.last = Pulse { instant, position: self.last.position + steps };
        self.error = error;
        if self.rate.abs() > REBASE {
            self.rebase();
        }
        motion
    }

    fn adapt(&mut self, error: f32) -> Motion {
        let floor = 0.3 / self.period as f32;
        let square = error * error;
        let scale = self.variance.max(floor * floor);
        let product = (error * self.error / scale).clamp(-2.0, 2.0);
        self.correlation += CORRELATION_WEIGHT * (product - self.correlation);
        if self.correlation < MIN_CORRELATION {
            self.memory = (self.memory + 1.0).min(self.longest);
        } else if self.correlation > MAX_CORRELATION {
            let excess = (self.correlation - MAX_CORRELATION).min(1.0);
            self.memory = (self.memory * (1.0 - 0.4 * excess)).max(MIN_MEMORY_PULSES);
        }
        let large = square > 36.0 * scale;
        let changed = large && error * self.error > 0.0 && self.error * self.error > 4.0 * scale;
        if changed {
            self.memory = MIN_MEMORY_PULSES;
        }
        self.taken = self.taken.saturating_add(1);
        let weight = VARIANCE_WEIGHT.max(2.0 / (f32::from(self.taken) + 3.0));
        self.variance = scale + weight * (square - scale);
        match (changed, large) {
            (true, _) => Motion::Changed,
            (false, true) => Motion::Unusual,
            (false, false) => Motion::AsBefore,
        }
    }

    /// A new reference period, so that rate and acceleration stay small numbers.
    fn rebase(&mut self) {
        let period = ((self.period as f32 / (1.0 + self.rate).max(0.1) + 0.5) as u64).max(1);
        let ratio = period as f32 / self.period as f32;
        self.rate = (1.0 + self.rate) * ratio - 1.0;
        self.acceleration *= ratio * ratio;
        self.period = period;
    }

    /// Rate in positions per tick after some ticks; the acceleration is believed for one and a half positions.
    pub fn rate(&self, ticks: u64) -> f32 {
        let u = ticks as f32 / self.period as f32;
        (1.0 + self.rate + self.acceleration * u.min(1.5)).max(0.0) / self.period as f32
    }

    /// Acceleration, positions per tick^2.
    pub fn acceleration(&self) -> f32 {
        self.acceleration / (self.period as f32 * self.period as f32)
    }

    /// Relative standard uncertainty of the rate: that of the end slope of a parabola through `n` pulses.
    pub fn uncertainty(&self) -> f32 {
        let n = self.memory;
        let floor = 0.3 / self.period as f32;
        math::sqrt(self.variance.max(floor * floor) * 192.0 / (n * n * n))
    }
}
