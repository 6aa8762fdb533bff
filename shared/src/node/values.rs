//! Overall values of whole turns and at least a second: acceleration of everything the converter saw, velocity in its
//! band.
//!
//! A record begins at a turn mark, is cut at the sample before the first mark behind a second, and the next one
//! begins there: no sample is left out, so what happens once per turn is in every record. Without a locked tach a
//! record lasts a second by the clock. A new rate goes on with the same record; lost samples, another gain and the
//! filters' start stay in the record's
//! [`Quality`], since a value that cannot be judged must still be seen. A second sensor's codes are of the same
//! instants and are cut at the same ones.

use crate::band_velocity::{BandVelocity, Edges, VelocityBand};
use crate::code_moments::{CodeMoments, CodeValues};
use crate::config::CodeRange;
use crate::math;
use crate::message::Quality;
use crate::units::TicksPerSecond;
use heapless::Deque;

/// Shortest record, s.
pub const SHORTEST_S: f32 = 1.0;
/// A turn that takes longer does not keep a record open, s.
const LONGEST_S: f32 = 8.0;
/// The high-pass has forgotten its start to 0.1 % after this many periods of its edge.
const SETTLING_PERIODS: f32 = 5.0;
/// Above this rate not every code enters the moments, samples per second, but at least 50 000 in a second: draws of the
/// same distribution, so the moments are the same within their scatter; a single peak of few microseconds may be
/// missed.
pub(super) const EVERY_CODE_TO_HZ: f32 = 300_000.0;
/// Up to this rate every second code enters, above it every eighth, samples per second.
const SECOND_CODE_TO_HZ: f32 = 400_000.0;
/// Above that rate and this speed of the pinion, Hz, few codes enter and none the velocity: the mesh bands need the
/// processor.
pub(super) const HIGHEST_SPEED_HZ: f32 = 60.5;
/// Codes from one that enters to the next there.
const FAST_CODE_STEP: usize = 16;
/// Turn marks of one block; what comes faster is no shaft.
const MOST_MARKS: usize = 32;

/// A complete record, in codes and seconds.
#[derive(Clone, Copy, Debug)]
pub struct Values {
    /// Tick of the first sample.
    pub first_tick: u64,
    /// Upper edge of the velocity's band, Hz.
    pub velocity_to_hz: f32,
    /// The sensor or the filters had not settled after a start: nothing here is the machine's.
    pub starting: bool,
    /// Of the first sensor.
    pub first: OfChannel,
    /// Of the second one, where its codes came.
    pub second: Option<OfChannel>,
}

/// What a record holds of one sensor.
#[derive(Clone, Copy, Debug)]
pub struct OfChannel {
    /// Acceleration, in codes.
    pub codes: CodeValues,
    /// RMS velocity, codes times seconds; not a number where no code entered it.
    pub velocity_rms: f32,
    /// What both rest on.
    pub quality: Quality,
}

/// Sums of one sensor.
#[derive(Clone, Debug)]
struct Channel {
    zero_code: u16,
    codes: CodeMoments,
    velocity: BandVelocity,
    squares: f64,
    outputs_ticks: f64,
}

impl Channel {
    fn new(zero_code: u16, range: CodeRange) -> Self {
        let (codes, velocity) = (CodeMoments::about(zero_code, range), BandVelocity::default());
        Self { zero_code, codes, velocity, squares: 0.0, outputs_ticks: 0.0 }
    }

    fn begin(&mut self) {
        self.codes = self.codes.next();
        (self.squares, self.outputs_ticks) = (0.0, 0.0);
    }

    fn add(&mut self, codes: &[u16], period: u32, step: usize) {
        self.codes.add(codes, period, step);
    }

    fn add_velocity(&mut self, band: &VelocityBand, codes: &[u16], period: u32) {
        let (squares, outputs) = self.velocity.push(band, codes, self.zero_code);
        // Outputs before and behind a change of the rate count by the time they stand for.
        let ticks = f64::from(band.codes_per_output().saturating_mul(period));
        self.squares += f64::from(squares) * ticks;
        self.outputs_ticks += f64::from(outputs) * ticks;
    }

    /// Of the codes since the beginning; `None` where none came.
    fn values(&self, of_record: Quality) -> Option<OfChannel> {
        let codes = self.codes.values()?;
        let mean_square = if self.outputs_ticks > 0.0 { self.squares / self.outputs_ticks } else { f64::NAN };
        let quality = Quality { overload: codes.railed > 0, stuck: codes.rms == 0.0, ..of_record };
        Some(OfChannel { codes, velocity_rms: math::sqrt(mean_square as f32), quality })
    }
}

/// The record under way.
#[derive(Clone, Debug)]
pub struct ValueRecord {
    clock: TicksPerSecond,
    settling_s: f32,
    band: VelocityBand,
    period: u32,
    /// Codes from one that enters the moments to the next.
    step: usize,
    /// See [`ValueRecord::follow_speed`].
    beyond: bool,
    first: Channel,
    second: Channel,
    marks: Deque<u64, MOST_MARKS>,
    first_tick: u64,
    /// The record began at a turn mark.
    at_mark: bool,
    turns: u16,
    gap: bool,
    /// Until then the high-pass remembers its start, or what came before a gap.
    settled_at: u64,
    /// Until then a start has not settled.
    started_at: u64,
}

impl ValueRecord {
    /// A record that has not begun, for sensors with these codes of zero acceleration and this range in force.
    pub fn new(clock: TicksPerSecond, edges: Edges, zero_codes: [u16; 2], range: CodeRange) -> Self {
        let [first, second] = zero_codes.map(|zero_code| Channel::new(zero_code, range));
        Self {
            clock,
            settling_s: SETTLING_PERIODS / edges.from_hz,
            band: VelocityBand::new(edges),
            period: 0,
            step: 1,
            beyond: false,
            first,
            second,
            marks: Deque::new(),
            first_tick: 0,
            at_mark: false,
            turns: 0,
            gap: false,
            settled_at: 0,
            started_at: 0,
        }
    }

    /// Begins anew at a tick: another gain, a start.
    pub fn restart(&mut self, tick: u64) {
        for channel in [&mut self.first, &mut self.second] {
            channel.velocity.restart();
            channel.begin();
        }
        self.settled_at = tick + self.ticks(self.settling_s);
        self.started_at = self.settled_at;
        self.marks.clear();
        self.begin(tick, false);
    }

    /// Samples are missing before the next block.
    pub fn note_gap(&mut self, tick: u64) {
        self.gap = true;
        self.settled_at = tick + self.ticks(self.settling_s);
    }

    /// The pinion passes angle zero.
    pub fn push_mark(&mut self, instant: u64) {
        if self.marks.is_full() {
            self.marks.pop_front();
        }
        let _ = self.marks.push_back(instant);
    }

    /// The marks so far are no part of those to come.
    pub fn lose_tach(&mut self) {
        self.marks.clear();
        (self.at_mark, self.turns) = (false, 0);
    }

    /// Above a speed of the pinion, Hz, codes of a short period are too many for all that is to be done.
    pub fn follow_speed(&mut self, speed_hz: f32, period: u32) {
        self.beyond = speed_hz > HIGHEST_SPEED_HZ && self.clock.rate(period).0 > EVERY_CODE_TO_HZ;
    }

    /// Takes a block whose marks are all known, of both sensors (the second one's may be missing); `complete` gets
    /// every record that ends in it. `locked`: the tach has a speed.
    pub fn push(
        &mut self,
        codes: [&[u16]; 2],
        first: u64,
        period: u32,
        locked: bool,
        mut complete: impl FnMut(Values),
    ) {
        let samples = codes[0].len();
        if period != self.period {
            self.period = period;
            let rate_hz = self.clock.rate(period).0;
            self.step = match rate_hz {
                ..=EVERY_CODE_TO_HZ => 1,
                ..=SECOND_CODE_TO_HZ => 2,
                _ => 8,
            };
            self.band.set_rate(rate_hz);
            self.first.velocity.begin_comb();
            self.second.velocity.begin_comb();
        }
        let mut taken = 0;
        while let Some(&mark) = self.marks.front() {
            // The first sample at or behind the mark.
            let place = mark.saturating_sub(first).div_ceil(u64::from(period.max(1))) as usize;
            if place >= samples {
                break;
            }
            self.marks.pop_front();
            self.add(codes.map(|codes| codes.get(taken..place.max(taken)).unwrap_or_default()));
            taken = taken.max(place);
            self.pass_mark(first + place as u64 * u64::from(period), &mut complete);
        }
        self.add(codes.map(|codes| codes.get(taken..).unwrap_or_default()));
        let longest = if locked && self.at_mark { LONGEST_S } else { SHORTEST_S };
        if self.ticks_so_far() >= f64::from(self.clock.0) * f64::from(longest) {
            (self.at_mark, self.turns) = (false, 0);
            self.finish(first + samples as u64 * u64::from(period), false, &mut complete);
        }
    }

    fn pass_mark(&mut self, tick: u64, complete: &mut impl FnMut(Values)) {
        self.turns = if self.at_mark { self.turns.saturating_add(1) } else { 0 };
        // A sample of tolerance: a turn of just a second is long enough.
        let long_enough =
            self.ticks_so_far() + f64::from(self.period) >= f64::from(self.clock.0) * f64::from(SHORTEST_S);
        if long_enough && self.turns > 0 {
            self.finish(tick, true, complete);
        } else if !self.at_mark {
            // What came before the first mark belongs to no whole turn.
            self.begin(tick, true);
        }
    }

    fn ticks_so_far(&self) -> f64 {
        self.first.codes.ticks()
    }

    fn add(&mut self, [first, second]: [&[u16]; 2]) {
        for (channel, codes) in [(&mut self.first, first), (&mut self.second, second)] {
            if codes.is_empty() {
                continue;
            }
            if self.beyond {
                channel.add(codes, self.period, FAST_CODE_STEP);
                continue;
            }
            channel.add(codes, self.period, self.step);
            channel.add_velocity(&self.band, codes, self.period);
        }
    }

    fn finish(&mut self, tick: u64, at_mark: bool, complete: &mut impl FnMut(Values)) {
        let quality = Quality {
            turns: self.turns,
            duration_s: (self.ticks_so_far() / f64::from(self.clock.0)) as f32,
            gap: self.gap,
            settling: self.first_tick < self.settled_at,
            ..Quality::default()
        };
        if let Some(first) = self.first.values(quality) {
            // A sensor that joined within the record lacks what came before.
            let incomplete = self.second.codes.ticks() < self.ticks_so_far();
            let second = self.second.values(Quality { gap: quality.gap || incomplete, ..quality });
            let velocity_to_hz = self.band.upper_hz();
            let starting = self.first_tick < self.started_at;
            complete(Values { first_tick: self.first_tick, velocity_to_hz, starting, first, second });
        }
        self.begin(tick, at_mark);
    }

    fn begin(&mut self, tick: u64, at_mark: bool) {
        self.first.begin();
        self.second.begin();
        (self.first_tick, self.at_mark, self.turns, self.gap) = (tick, at_mark, 0, false);
    }

    fn ticks(&self, seconds: f32) -> u64 {
        (seconds * self.clock.0 as f32) as u64
    }
}
