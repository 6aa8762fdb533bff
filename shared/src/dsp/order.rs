//! Computed order tracking: from evenly timed samples and turn marks to evenly spaced shaft angles.
//!
//! The input is a stream of samples with capture times and the instants at which the pinion passes angle zero (turn
//! marks, from the tach tracker, wrapping timer ticks of the same time base). A turn is resampled once the mark after
//! its end is known: time as a function of angle is the cubic through four marks, so no inversion is needed.
//!
//! Errors:
//! * *Angle.* Cubic through marks one turn apart: at most 0.0234 |t''''| of the true t(angle), in turns. A run-up of
//!   relative rate r per turn gives 0.35 r^3 turns: 4.4e-5 turns at 1 Hz and 5 %/s, 3e-9 at 25 Hz. Mark jitter enters
//!   with a gain of at most 1.25. Torsional vibration within a turn is not seen by one mark per turn.
//! * *Amplitude.* 8-tap Kaiser-windowed sinc (beta 6, 128 phases): error below 1.1e-3 of a line up to a quarter of the
//!   sampling rate, 2.4 % at 0.3, useless above 0.35. Run the input at four times the highest wanted frequency; what
//!   lies above must be absent or fold outside the wanted orders.
//! * *Position.* 2^-16 sample.
//!
//! Cost (Cortex-M4F in QEMU): 22 instructions per sample pushed, 80 per output sample. RAM: 4 bytes per buffered
//! sample; `CAPACITY` must hold three turns at the lowest speed at which the sampling rate is still lowered.

use crate::math;

const TAPS: usize = 8;
/// Taps before the sample an output follows.
const LEADING_TAPS: i32 = TAPS as i32 / 2 - 1;
const PHASES: usize = 128;
/// Outputs that share one fixed-point evaluation of the angle polynomial.
const RUN: usize = 32;

static KERNEL: [[f32; TAPS]; PHASES + 1] = kernel();

const fn sqrt_const(x: f64) -> f64 {
    let mut root = if x > 1.0 { x } else { 1.0 };
    let mut i = 0;
    while i < 60 {
        root = 0.5 * (root + x / root);
        i += 1;
    }
    root
}

const fn bessel_i0(x: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 1.0;
    let mut k = 1;
    while k < 40 {
        let ratio = x / (2 * k) as f64;
        term *= ratio * ratio;
        sum += term;
        k += 1;
    }
    sum
}

const fn kernel() -> [[f32; TAPS]; PHASES + 1] {
    const BETA: f64 = 6.0;
    let mut table = [[0.0f32; TAPS]; PHASES + 1];
    let mut phase = 0;
    while phase <= PHASES {
        let mut taps = [0.0f64; TAPS];
        let mut sum = 0.0;
        let mut j = 0;
        while j < TAPS {
            let x = j as f64 - 3.0 - phase as f64 / PHASES as f64;
            let distance = if x < 0.0 { -x } else { x };
            let edge = 1.0 - (distance / 4.0) * (distance / 4.0);
            let window = if edge > 0.0 { bessel_i0(BETA * sqrt_const(edge)) } else { 0.0 };
            let sinc = if distance < 1e-12 {
                1.0
            } else {
                math::sin_turns_const(0.5 * distance) / (core::f64::consts::PI * distance)
            };
            taps[j] = sinc * window;
            sum += taps[j];
            j += 1;
        }
        // Unit gain for a constant in every phase.
        j = 0;
        while j < TAPS {
            table[phase][j] = (taps[j] / sum) as f32;
            j += 1;
        }
        phase += 1;
    }
    table
}

/// One complete turn, ready to be resampled; valid until the next samples are pushed.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// Buffer index of the turn's start, sample and 2^-16 sample.
    start_q16: i64,
    /// Position = c1 u + c2 u^2 + c3 u^3 for u in turns, 2^-16 sample.
    coefficients_q16: [i64; 3],
    /// Tick of the turn's start.
    pub start_tick: u32,
    /// Duration in ticks.
    pub ticks: u32,
    /// Counts turns, those that were not resampled included; goes on until the marks are forgotten.
    pub number: u32,
    /// Relative change of speed over the turn (positive when it accelerates), from the neighbouring turns.
    pub speed_change: f32,
}

/// Why samples or marks were not taken as a continuation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discontinuity {
    /// The samples do not follow the last ones (lost block or new rate): those before were forgotten.
    Samples,
    /// The marks before this one are no longer covered by the buffer: the turn was dropped.
    Overrun,
    /// Four marks that are not those of one shaft: out of order, or a speed that changes more than eightfold from one
    /// turn to the next, or a turn of many buffers. The turn was dropped.
    Marks,
}

/// Sample buffer with turn marks.
#[derive(Debug, Clone)]
pub struct OrderTracker<const CAPACITY: usize> {
    samples: [f32; CAPACITY],
    /// Index of the oldest sample and number of samples held.
    oldest: usize,
    held: usize,
    oldest_tick: u32,
    period_ticks: u32,
    marks: heapless::Deque<u32, 8>,
    /// Marks that have left the queue.
    passed: u32,
    /// Turns dropped because the buffer was too short or marks came too fast.
    pub turns_dropped: u32,
}

impl<const CAPACITY: usize> Default for OrderTracker<CAPACITY> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const CAPACITY: usize> OrderTracker<CAPACITY> {
    /// An empty buffer.
    pub const fn new() -> Self {
        Self {
            samples: [0.0; CAPACITY],
            oldest: 0,
            held: 0,
            oldest_tick: 0,
            period_ticks: 0,
            marks: heapless::Deque::new(),
            passed: 0,
            turns_dropped: 0,
        }
    }

    /// Forgets samples and marks.
    pub fn reset(&mut self) {
        self.forget_samples();
        self.forget_marks();
    }

    /// Forgets the marks (tach lost); the samples stay.
    pub fn forget_marks(&mut self) {
        self.marks.clear();
        self.passed = 0;
    }

    fn forget_samples(&mut self) {
        self.held = 0;
        self.oldest = 0;
    }

    fn drop_mark(&mut self) {
        self.marks.pop_front();
        self.passed = self.passed.wrapping_add(1);
    }

    /// Appends samples; `first_tick` is the capture time of the first one less the group delay of the filters before.
    ///
    /// A new period or a gap of more than half a period forgets the samples so far; the marks stay, they are the
    /// shaft's. The oldest samples make room when the buffer is full.
    pub fn push_samples(&mut self, samples: &[f32], first_tick: u32, period_ticks: u32) -> Result<(), Discontinuity> {
        let expected = self.oldest_tick.wrapping_add(self.period_ticks.wrapping_mul(self.held as u32));
        let gap = (first_tick.wrapping_sub(expected) as i32).unsigned_abs();
        let continues = self.held == 0 || (period_ticks == self.period_ticks && gap <= period_ticks / 2);
        if !continues {
            self.forget_samples();
        }
        if self.held == 0 {
            self.oldest_tick = first_tick;
            self.period_ticks = period_ticks.max(1);
        }
        for &x in samples {
            if self.held == CAPACITY {
                if let Some(sample) = self.samples.get_mut(self.oldest) {
                    *sample = x;
                }
                self.oldest = self.next(self.oldest);
                self.oldest_tick = self.oldest_tick.wrapping_add(self.period_ticks);
            } else {
                let mut place = self.oldest + self.held;
                if place >= CAPACITY {
                    place -= CAPACITY;
                }
                if let Some(sample) = self.samples.get_mut(place) {
                    *sample = x;
                }
                self.held += 1;
            }
        }
        if continues { Ok(()) } else { Err(Discontinuity::Samples) }
    }

    fn next(&self, place: usize) -> usize {
        if place + 1 == CAPACITY { 0 } else { place + 1 }
    }

    /// Takes the instant at which the pinion passes angle zero. A full queue drops its oldest mark and counts a turn.
    pub fn push_mark(&mut self, tick: u32) {
        if self.marks.is_full() {
            self.drop_mark();
            self.turns_dropped = self.turns_dropped.wrapping_add(1);
        }
        let _ = self.marks.push_back(tick);
    }

    /// The next turn whose samples and neighbouring marks are all there; call until `Ok(None)`.
    ///
    /// The first of the four marks is consumed. [`Discontinuity::Overrun`] when the turn's samples have left the
    /// buffer.
    pub fn next_turn(&mut self) -> Result<Option<Turn>, Discontinuity> {
        let mut ticks = [0u32; 4];
        if self.marks.len() < 4 || self.held == 0 {
            return Ok(None);
        }
        for (tick, mark) in ticks.iter_mut().zip(self.marks.iter()) {
            *tick = *mark;
        }
        if self.still_comes(&ticks) {
            return Ok(None);
        }
        let start_q16 = self.q16(ticks[1].wrapping_sub(self.oldest_tick));
        let [a, b, c] = [ticks[0], ticks[2], ticks[3]].map(|tick| self.q16(tick.wrapping_sub(ticks[1])));
        let ascending = a < 0 && b > 0 && c > b && -a <= 8 * b && c - b <= 8 * b && b >> 16 <= 16 * CAPACITY as i64;
        let refusal = if !ascending {
            Some(Discontinuity::Marks)
        } else if start_q16 >> 16 < TAPS as i64 / 2 {
            Some(Discontinuity::Overrun)
        } else {
            None
        };
        if let Some(reason) = refusal {
            self.drop_mark();
            self.turns_dropped = self.turns_dropped.wrapping_add(1);
            return Err(reason);
        }
        if (start_q16 + b) >> 16 >= self.held as i64 - TAPS as i64 / 2 {
            return Ok(None);
        }
        let second = (a + b) / 2;
        let odd = (b - a) / 2;
        let third = ((c - 4 * second) / 2 - odd) / 3;
        self.drop_mark();
        Ok(Some(Turn {
            number: self.passed,
            start_q16,
            coefficients_q16: [odd - third, second, third],
            start_tick: ticks[1],
            ticks: ticks[2].wrapping_sub(ticks[1]),
            speed_change: -2.0 * second as f32 / (b.max(1)) as f32,
        }))
    }

    /// Whether the marks are in order and the end of the turn just lies ahead of the samples: where most calls end, so
    /// without a division.
    fn still_comes(&self, ticks: &[u32; 4]) -> bool {
        let [first, start, end, last] = *ticks;
        let after = |later: u32, earlier: u32| later.wrapping_sub(earlier) as i32;
        let turn = after(end, start);
        let newest = self.oldest_tick.wrapping_add(self.period_ticks.wrapping_mul(self.held as u32));
        after(start, first) > 0 && after(last, end) > 0 && (0..turn).contains(&after(end, newest))
    }

    /// Signed tick difference in 2^-16 samples.
    fn q16(&self, ticks: u32) -> i64 {
        (i64::from(ticks as i32) << 16) / i64::from(self.period_ticks.max(1))
    }

    /// Writes samples `first`, `first + 1`, ... of the turn cut into `per_turn` equal angles; `out` may be any part
    /// of it.
    pub fn resample(&self, turn: &Turn, first: u32, per_turn: u32, out: &mut [f32]) {
        let per_turn = per_turn.max(1);
        let [c1, c2, c3] = turn.coefficients_q16;
        let step = 1.0 / per_turn as f32;
        let mut index = first;
        for run in out.chunks_mut(RUN) {
            // Start of the run to 2^-16 sample in integers, then single precision relative to it.
            let u_q32 = ((u64::from(index) << 32) / u64::from(per_turn)) as i64;
            let times_u = |x: i64| (x * (u_q32 >> 2)) >> 30;
            let base = turn.start_q16 + times_u(c1 + times_u(c2 + times_u(c3)));
            let u = index as f32 * step;
            let slope = (c1 as f32 + u * (2.0 * c2 as f32 + 3.0 * u * c3 as f32)) * (1.0 / 65536.0);
            let curvature = (c2 as f32 + 3.0 * u * c3 as f32) * (1.0 / 65536.0);
            let base_sample = (base >> 16) as i32;
            let base_fraction = (base & 0xffff) as f32 * (1.0 / 65536.0);
            let path = Path { start: base_fraction, slope, curvature, step };
            let stretch = self.stretch(base_sample);
            if !interpolate_run(stretch, path, run) {
                for (n, y) in run.iter_mut().enumerate() {
                    let (whole, fraction) = path.at(n);
                    *y = self.interpolate(base_sample.wrapping_add(whole), fraction);
                }
            }
            index += run.len() as u32;
        }
    }

    /// The samples from the first tap around this index on that lie in one piece.
    fn stretch(&self, sample: i32) -> &[f32] {
        let first = sample - LEADING_TAPS;
        if first < 0 || first as usize >= self.held {
            return &[];
        }
        let mut place = self.oldest + first as usize;
        if place >= CAPACITY {
            place -= CAPACITY;
        }
        let count = (self.held - first as usize).min(CAPACITY - place.min(CAPACITY));
        self.samples.get(place..place + count).unwrap_or_default()
    }

    /// Value `fraction` beyond the sample of this index, wherever its taps lie; 0 outside the buffer.
    #[cold]
    fn interpolate(&self, sample: i32, fraction: f32) -> f32 {
        let first = sample - LEADING_TAPS;
        if first < 0 || first as usize + TAPS > self.held {
            return 0.0;
        }
        let mut place = self.oldest + first as usize;
        if place >= CAPACITY {
            place -= CAPACITY;
        }
        let mut gathered = [0.0f32; TAPS];
        for x in &mut gathered {
            *x = self.samples.get(place).copied().unwrap_or_default();
            place = self.next(place);
        }
        weigh(&gathered, fraction)
    }
}

/// Places of a run's outputs, samples: start + x (slope + x curvature) with x counting in steps.
#[derive(Clone, Copy)]
struct Path {
    start: f32,
    slope: f32,
    curvature: f32,
    step: f32,
}

impl Path {
    /// Whole samples and fraction of an output.
    #[inline]
    fn at(self, output: usize) -> (i32, f32) {
        let ahead = output as f32 * self.step;
        let place = self.start + ahead * (self.slope + ahead * self.curvature);
        let whole = place as i32;
        (whole, place - whole as f32)
    }
}

/// A run whose taps all lie in one stretch; false, with any outputs, where they do not. Free of type parameters so
/// that it is compiled here, for speed, and not in the binary that picks the sizes.
fn interpolate_run(stretch: &[f32], path: Path, outputs: &mut [f32]) -> bool {
    for (n, y) in outputs.iter_mut().enumerate() {
        let (whole, fraction) = path.at(n);
        let Some(samples) = stretch.get(whole as usize..).and_then(|rest| rest.first_chunk::<TAPS>()) else {
            return false;
        };
        *y = weigh(samples, fraction);
    }
    true
}

/// Windowed sinc `fraction` beyond the middle of the taps.
#[inline]
fn weigh(samples: &[f32; TAPS], fraction: f32) -> f32 {
    let phase = fraction * PHASES as f32;
    let row = (phase as usize).min(PHASES - 1);
    let blend = phase - row as f32;
    let Some(rows) = KERNEL.as_flattened().get(row * TAPS..).and_then(|rest| rest.first_chunk::<{ 2 * TAPS }>()) else {
        return 0.0;
    };
    let (mut early, mut late) = (0.0, 0.0);
    for tap in 0..TAPS {
        early += samples[tap] * rows[tap];
        late += samples[tap] * rows[TAPS + tap];
    }
    early + blend * (late - early)
}
