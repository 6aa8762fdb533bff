//! Tachometer tracker in the revolution domain: from pulse instants to speed, angle, and how far to trust them.
//!
//! Every pulse belongs to an integer *position* on the wheel. The tracker predicts when positions pass, gives each pulse
//! the nearest position and fits `position(t)` to the accepted pulses: linear while the speed is steady, quadratic
//! (exact for constant acceleration) when the curvature is significant. The window grows while the fit holds and is cut
//! when the newest pulses leave it. Gains therefore count pulses, not seconds, and one setting serves 1000:1 in speed.
//!
//! A pulse at no position is rejected (spurious); a skipped position is counted (missed). Either only *lowers the
//! validity*; the tracker is re-opened by evidence, never by time alone: four pulses whose three gaps agree with one
//! constant acceleration start a new fit, whatever was tracked before. Two of them at a fraction of the tracked period
//! may be noise, so while they fit both hypotheses, the speed is flagged instead of changed.
//!
//! A wheel with adjacent missing teeth has the same equidistant positions; its gap is learned from pulses that follow
//! one wheel-gap and confirmed by the next pulse. Direction is not observable from one track.
//!
//! Precision: instants and positions are 64-bit integers, only residuals against a reference period are `f32`; nothing
//! drifts. Cost: about 20 operations per pulse, a fit over at most 32 pulses about 1500.
//! Prior art: engine decoders (relative gap rejection, re-opening, tooth angle error), RPLL of idsp (test harness).

use crate::config::TachWheel;
use crate::math;
use crate::units::{Hertz, TicksPerSecond, TurnFraction};
use serde::{Deserialize, Serialize};

/// Pulses in the longest fit.
const WINDOW: usize = 32;
/// Positions that may pass without a pulse before tracking starts anew.
const REOPEN_AFTER: u64 = 8;
/// Largest error of a prediction, positions, at which a pulse is still believed.
const WIDEST_GATE: f32 = 0.15;
/// Smallest half-width of the gate, positions.
const NARROWEST_GATE: f32 = 0.01;
/// Agreement of four pulses with one constant acceleration that starts a new fit, positions.
const AGREEMENT: f32 = 0.03;

/// How far a speed can be trusted. Only `Locked` is a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Validity {
    /// No speed: too few pulses, or none for too long.
    #[default]
    None,
    /// Pulses contradict the tracked speed, or the next one is overdue.
    Doubtful,
    /// Tracked, and the latest pulses agree.
    Locked,
}

/// Counters since start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TachCounters {
    /// Pulses accepted.
    pub accepted: u32,
    /// Positions without a pulse, apart from the wheel's own gap.
    pub missed: u32,
    /// Pulses rejected.
    pub spurious: u32,
    /// Fits started anew.
    pub relocks: u32,
}

/// Speed of the pinion at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Pinion rate.
    pub pinion: Hertz,
    /// Relative standard uncertainty.
    pub uncertainty: f32,
    /// Pinion acceleration, Hz/s.
    pub acceleration_hz_per_s: f32,
    /// Time since the latest accepted pulse, s.
    pub age_s: f32,
    /// Trust.
    pub validity: Validity,
    /// Latest prediction error, positions: the quality of wheel and pick-up.
    pub pulse_error: f32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pulse {
    instant: u64,
    position: u64,
}

/// `position = origin.position + c0 + (1 + c1) u + c2 u^2`, u = (t - origin.instant) / period.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    origin: Pulse,
    period: u64,
    c0: f32,
    c1: f32,
    c2: f32,
    /// RMS residual, positions.
    noise: f32,
    /// Standard uncertainty of the slope at the origin, relative.
    slope_uncertainty: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    Acquiring,
    Locked,
    /// Contradicted; this many pulses in a row must agree before the speed counts again.
    Doubtful {
        needed: u8,
    },
}

/// The tracker.
#[derive(Clone, Debug)]
pub struct TachTracker {
    wheel: TachWheel,
    clock: TicksPerSecond,
    shortest_gap: u64,
    longest_gap: u64,
    /// Anchors are kept every this many positions, so that a fit spans whole turns of finely toothed wheels.
    stride: u64,
    lock: Lock,
    /// Newest raw pulses, newest last.
    raw: [u64; 5],
    raw_count: usize,
    /// How many of the newest raw pulses were accepted, as bits.
    raw_accepted: u8,
    anchors: [Pulse; WINDOW],
    anchor_count: usize,
    last: Pulse,
    fit: Fit,
    noise: f32,
    error: f32,
    /// Position (modulo the wheel) of the first tooth after the gap, once confirmed.
    index: Option<u64>,
    index_candidate: Option<u64>,
    counters: TachCounters,
}

impl TachTracker {
    /// A tracker for a validated wheel.
    pub fn new(wheel: TachWheel, clock: TicksPerSecond) -> Self {
        let positions = u64::from(wheel.pulses_per_turn.max(1));
        let ticks = |hz: f32| (clock.0 as f32 / (hz * positions as f32)) as u64;
        Self {
            wheel,
            clock,
            shortest_gap: ticks(wheel.highest.0).max(2) * 9 / 10,
            longest_gap: ticks(wheel.lowest.0) * (1 + u64::from(wheel.missing)) * 3 / 2,
            stride: (positions / 4).max(1),
            lock: Lock::Acquiring,
            raw: [0; 5],
            raw_count: 0,
            raw_accepted: 0,
            anchors: [Pulse::default(); WINDOW],
            anchor_count: 0,
            last: Pulse::default(),
            fit: Fit::default(),
            noise: NARROWEST_GATE,
            error: 0.0,
            index: None,
            index_candidate: None,
            counters: TachCounters::default(),
        }
    }

    /// Takes a pulse at a 64-bit instant. Pulses that go back in time or come faster than the shaft can are rejected.
    pub fn on_pulse(&mut self, instant: u64) {
        if self.raw_count > 0 {
            let newest = self.raw[4];
            if instant < newest.saturating_add(self.shortest_gap) {
                self.counters.spurious = self.counters.spurious.saturating_add(1);
                self.doubt();
                return;
            }
            if instant - newest > self.longest_gap {
                self.start_acquiring();
            }
        }
        self.raw.rotate_left(1);
        self.raw[4] = instant;
        self.raw_count = (self.raw_count + 1).min(5);
        self.raw_accepted <<= 1;
        if self.lock != Lock::Acquiring {
            self.track(instant);
        }
        if self.lock != Lock::Locked {
            self.try_acquire();
        }
    }

    fn track(&mut self, instant: u64) {
        let place = self.fit.place(instant) - (self.last.position - self.fit.origin.position) as f32;
        let steps = (place + 0.5).max(0.0) as u64;
        let error = place - steps as f32;
        let gate = (6.0 * self.noise).clamp(NARROWEST_GATE, WIDEST_GATE);
        if steps > REOPEN_AFTER + u64::from(self.wheel.missing) {
            self.start_acquiring();
            self.raw[4] = instant;
            self.raw_count = 1;
            return;
        }
        if steps == 0 || error.abs() > gate {
            self.counters.spurious = self.counters.spurious.saturating_add(1);
            self.doubt();
            return;
        }
        self.error = error;
        let skipped = steps - 1 - self.wheel_gap(steps).min(steps - 1);
        // Pulses with two or more lost in between are no evidence for the tracked speed.
        self.raw_accepted |= u8::from(skipped < 2);
        self.counters.missed = self.counters.missed.saturating_add(skipped as u32);
        self.counters.accepted = self.counters.accepted.saturating_add(1);
        self.learn_index(steps);
        self.last = Pulse { instant, position: self.last.position + steps };
        self.lock = match self.lock {
            // Two positions lost in a row are more likely another speed.
            Lock::Doubtful { needed } if skipped > 0 => Lock::Doubtful { needed: needed.max(skipped.min(2) as u8) },
            _ if skipped > 0 => Lock::Doubtful { needed: skipped.min(2) as u8 },
            Lock::Doubtful { needed } if needed > 1 || self.rival().is_some() => {
                Lock::Doubtful { needed: needed.saturating_sub(1).max(1) }
            }
            _ => Lock::Locked,
        };
        self.add_anchor();
    }

    /// Positions of the wheel's own gap among the steps since the last pulse.
    fn wheel_gap(&self, steps: u64) -> u64 {
        let missing = u64::from(self.wheel.missing);
        if missing == 0 || steps <= missing {
            return 0;
        }
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        match self.index {
            Some(index) => {
                let to_index = (index + positions - self.last.position % positions) % positions;
                if to_index > 0 && to_index <= steps { missing } else { 0 }
            }
            None => missing,
        }
    }

    /// A gap of exactly the missing teeth, followed by a single step, marks the first tooth; seen twice at the same
    /// place it is believed.
    fn learn_index(&mut self, steps: u64) {
        let missing = u64::from(self.wheel.missing);
        if missing == 0 {
            return;
        }
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        if steps == missing + 1 {
            let place = (self.last.position + steps) % positions;
            if self.index_candidate == Some(place) {
                self.index = Some(place);
            }
            self.index_candidate = Some(place);
        }
    }

    fn doubt(&mut self) {
        match &mut self.lock {
            Lock::Acquiring => {}
            Lock::Doubtful { needed } => *needed = (*needed).max(2),
            Lock::Locked => self.lock = Lock::Doubtful { needed: 2 },
        }
    }

    fn start_acquiring(&mut self) {
        self.lock = Lock::Acquiring;
        self.raw_count = 0;
        self.raw_accepted = 0;
        self.anchor_count = 0;
        self.index = None;
        self.index_candidate = None;
    }

    /// Gap of the newest pulses if three gaps agree with one constant acceleration and not with the tracked speed.
    fn rival(&self) -> Option<u64> {
        if self.raw_count < 4 {
            return None;
        }
        let [_, a, b, c, d] = self.raw;
        let gaps = [(b - a) as f32, (c - b) as f32, (d - c) as f32];
        let widest = if self.lock == Lock::Acquiring { 1.3 } else { 2.5 };
        let ratio = |x: f32, y: f32| x < widest * y && y < widest * x;
        if !(ratio(gaps[0], gaps[1]) && ratio(gaps[1], gaps[2])) {
            return None;
        }
        // Speeds at the middles of the gaps lie on a line.
        let rates = [1.0 / gaps[0], 1.0 / gaps[1]];
        let acceleration = (rates[1] - rates[0]) / (0.5 * (gaps[0] + gaps[1]));
        let predicted = rates[1] + acceleration * 0.5 * (gaps[1] + gaps[2]);
        let agrees = (predicted * gaps[2] - 1.0).abs() < AGREEMENT;
        let gap = d - c;
        let tracked = if self.lock == Lock::Acquiring { 0 } else { self.fit.period };
        // The tracked speed itself is no rival, unless its pulses all come at the wrong angle.
        let same = gap.abs_diff(tracked) as f32 <= 0.02 * tracked as f32 && self.raw_accepted & 0b111 != 0;
        (agrees && !same).then_some(gap)
    }

    fn try_acquire(&mut self) {
        let Some(gap) = self.rival() else { return };
        let accepted = if self.lock == Lock::Acquiring { 0 } else { (self.raw_accepted & 0b1111).count_ones() };
        if accepted > 1 {
            // The tracked speed explains some of these pulses as well: wait for a fourth equal gap.
            let near = |x: u64, y: u64| x.abs_diff(y) as f32 <= AGREEMENT * gap as f32;
            let gaps = [1, 2, 3, 4].map(|n| self.raw[n] - self.raw[n - 1]);
            if self.raw_count < 5 || !gaps.iter().all(|&other| near(other, gap)) {
                return;
            }
        }
        // Two noise pulses can imitate a slightly different speed, hardly one beyond a factor of 1.5: confirm the former.
        let tracked = self.fit.period;
        let similar = self.lock != Lock::Acquiring && gap < tracked + tracked / 2 && tracked < gap + gap / 2;
        self.counters.relocks = self.counters.relocks.saturating_add(1);
        self.counters.accepted = self.counters.accepted.saturating_add(4);
        self.index = None;
        self.index_candidate = None;
        let base = self.last.position + 1;
        for step in 0..4 {
            self.anchors[step as usize] = Pulse { instant: self.raw[1 + step as usize], position: base + step };
        }
        self.anchor_count = 4;
        self.last = self.anchors[3];
        self.fit.period = gap;
        self.noise = 0.5 * NARROWEST_GATE;
        self.lock = match (accepted > 1, similar) {
            (true, _) => Lock::Doubtful { needed: 6 },
            (false, true) => Lock::Doubtful { needed: 2 },
            (false, false) => Lock::Locked,
        };
        self.raw_accepted = 0b1111;
        self.refit();
    }

    fn add_anchor(&mut self) {
        let newest = self.anchors.get(self.anchor_count.saturating_sub(1)).map_or(0, |pulse| pulse.position);
        let stride = self.stride.max(1);
        if self.last.position / stride == newest / stride && self.anchor_count > 4 {
            return;
        }
        if self.anchor_count == WINDOW {
            self.anchors.rotate_left(1);
            self.anchor_count -= 1;
        }
        if let Some(place) = self.anchors.get_mut(self.anchor_count) {
            *place = self.last;
        }
        self.anchor_count += 1;
        self.refit();
        // Cut the window while its newest points all lie on one side of the fit.
        while self.anchor_count > 6 && self.newest_leave_fit() {
            let keep = (self.anchor_count / 2).max(4);
            self.anchors.rotate_left((self.anchor_count - keep).min(WINDOW));
            self.anchor_count = keep;
            self.refit();
        }
    }

    fn newest_leave_fit(&self) -> bool {
        let one_tick = 1.0 / self.fit.period.max(1) as f32;
        let newest = self.anchors.get(self.anchor_count.saturating_sub(3)..self.anchor_count).unwrap_or_default();
        let sum: f32 = newest.iter().map(|pulse| self.fit.residual(pulse)).sum();
        sum.abs() > 5.0 * 1.732 * (self.noise + one_tick)
    }

    fn refit(&mut self) {
        let anchors = self.anchors.get(..self.anchor_count).unwrap_or_default();
        let (Some(first), Some(newest)) = (anchors.first(), anchors.last()) else { return };
        let span = newest.position - first.position;
        let period = ((newest.instant - first.instant) / span.max(1)).max(1);
        self.fit = Fit::new(anchors, period, self.noise);
        // The noise follows the short fit quickly downwards and slowly upwards, so that a changing speed is noticed.
        let short = &anchors[anchors.len().saturating_sub(8)..];
        if short.len() >= 6 {
            let observed = Fit::new(short, period, 0.0).noise;
            let weight = if observed < self.noise { 0.2 } else { 0.1 };
            self.noise += weight * (observed - self.noise);
        }
    }

    /// Speed at an instant; a pulse that is overdue then lowers the validity.
    pub fn speed(&self, now: u64) -> Speed {
        let age = now.saturating_sub(self.last.instant);
        if self.lock == Lock::Acquiring {
            return Speed { age_s: self.clock.seconds(age), ..Speed::default() };
        }
        let per_tach_turn = f32::from(self.wheel.pulses_per_turn);
        let rate = self.clock.0 as f32 / (self.fit.period as f32 * per_tach_turn) * self.wheel.pinion_per_tach;
        let at = (self.last.instant - self.fit.origin.instant) as f32 / self.fit.period as f32;
        let periods = age as f32 / self.fit.period as f32;
        // The acceleration is believed for one and a half positions without a pulse.
        let slope = 1.0 + self.fit.c1 + 2.0 * self.fit.c2 * (at + periods.min(1.5));
        let gate = (6.0 * self.noise).clamp(NARROWEST_GATE, WIDEST_GATE);
        let wheel_gap = f32::from(self.wheel.missing);
        let validity = match self.lock {
            _ if age > self.longest_gap => Validity::None,
            Lock::Acquiring => Validity::None,
            Lock::Locked if periods * slope <= 1.0 + wheel_gap + gate => Validity::Locked,
            _ => Validity::Doubtful,
        };
        Speed {
            pinion: Hertz(rate * slope),
            uncertainty: self.fit.slope_uncertainty,
            acceleration_hz_per_s: 2.0 * self.fit.c2 * rate * (self.clock.0 as f32 / self.fit.period as f32),
            age_s: self.clock.seconds(age),
            validity,
            pulse_error: self.error,
        }
    }

    /// Angle of the tach shaft at an instant, from the first tooth after the gap or from an arbitrary pulse.
    pub fn tach_angle(&self, instant: u64) -> TurnFraction {
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        let index = self.index.unwrap_or(0);
        let whole = (self.fit.origin.position + positions - index) % positions;
        let part = TurnFraction::from_turns(self.fit.place(instant) / positions as f32);
        TurnFraction((((whole << 32) / positions) as u32).wrapping_add(part.0))
    }

    /// Whether the wheel's gap has been found (always for wheels without one).
    pub fn is_indexed(&self) -> bool {
        self.wheel.missing == 0 || self.index.is_some()
    }

    /// Latest accepted pulse: instant and position count.
    pub fn latest_pulse(&self) -> (u64, u64) {
        (self.last.instant, self.last.position)
    }

    /// Counters since start.
    pub fn counters(&self) -> TachCounters {
        self.counters
    }
}

impl Fit {
    /// Least squares over the anchors (at least 2); curvature only where it exceeds 4.5 times its uncertainty.
    fn new(anchors: &[Pulse], period: u64, noise_floor: f32) -> Self {
        let origin = anchors[anchors.len() - 1];
        let mut fit = Fit { origin, period, ..Fit::default() };
        let count = anchors.len() as f32;
        // Centred and scaled abscissa v in about [-1, 1] keeps the normal equations well conditioned in f32.
        let half = ((origin.instant - anchors[0].instant) as f32 / period as f32 * 0.5).max(0.5);
        let (mut s1, mut s2, mut s3, mut s4) = (0.0f32, 0.0, 0.0, 0.0);
        let (mut r0, mut r1, mut r2, mut rr) = (0.0f32, 0.0, 0.0, 0.0);
        for pulse in anchors {
            let u = -((origin.instant - pulse.instant) as f32) / period as f32;
            let v = u / half + 1.0;
            let r = fit.raw_residual(pulse);
            let vv = v * v;
            s1 += v;
            s2 += vv;
            s3 += vv * v;
            s4 += vv * vv;
            r0 += r;
            r1 += r * v;
            r2 += r * vv;
            rr += r * r;
        }
        // Linear part.
        let determinant = count * s2 - s1 * s1;
        let slope = (count * r1 - s1 * r0) / determinant;
        let offset = (r0 - slope * s1) / count;
        // Curvature: the square made orthogonal to the line.
        let q1 = (count * s3 - s1 * s2) / determinant;
        let q0 = (s2 - q1 * s1) / count;
        let qq = s4 - q1 * s3 - q0 * s2;
        let curvature = if qq > 1.0e-6 { (r2 - q1 * r1 - q0 * r0) / qq } else { 0.0 };
        let linear_rest = (rr - slope * r1 - offset * r0).max(0.0);
        let square_rest = (linear_rest - curvature * curvature * qq).max(0.0);
        let freedom = (count - 3.0).max(1.0);
        let noise = math::sqrt(square_rest / freedom);
        let used_noise = noise.max(0.3 * noise_floor.min(NARROWEST_GATE)).max(0.3 / period as f32);
        let curved = curvature * curvature * qq > 20.0 * used_noise * used_noise && anchors.len() >= 4;
        let (a0, a1, a2) =
            if curved { (offset - curvature * q0, slope - curvature * q1, curvature) } else { (offset, slope, 0.0) };
        // From v back to u, v = u / half + 1.
        fit.c2 = a2 / (half * half);
        fit.c1 = (a1 + 2.0 * a2) / half;
        fit.c0 = a0 + a1 + a2;
        fit.noise = if curved { noise } else { math::sqrt(linear_rest / (count - 2.0).max(1.0)) };
        let slope_variance = count / determinant;
        let curved_variance = if curved { (2.0 - q1) * (2.0 - q1) / qq } else { 0.0 };
        fit.slope_uncertainty =
            fit.noise.max(0.3 / period as f32) * math::sqrt(slope_variance + curved_variance) / half;
        fit
    }

    /// Positions since the origin at an instant, by the fit.
    fn place(&self, instant: u64) -> f32 {
        let u = (instant as i64 - self.origin.instant as i64) as f32 / self.period.max(1) as f32;
        u + (self.c0 + u * (self.c1 + u * self.c2))
    }

    /// Position minus elapsed reference periods, both exact integers until the last step.
    fn raw_residual(&self, pulse: &Pulse) -> f32 {
        let positions = pulse.position as i64 - self.origin.position as i64;
        let ticks = pulse.instant as i64 - self.origin.instant as i64;
        (positions * self.period as i64 - ticks) as f32 / self.period as f32
    }

    /// Position minus fit.
    fn residual(&self, pulse: &Pulse) -> f32 {
        let u = (pulse.instant as i64 - self.origin.instant as i64) as f32 / self.period.max(1) as f32;
        self.raw_residual(pulse) - (self.c0 + u * (self.c1 + u * self.c2))
    }
}
