//! The order-domain products of one channel in one piece: turn marks and samples in, mesh bands and averages out.
//!
//! [`OrderTracker`] finds complete turns; each is resampled twice, for the mesh bands ([`MeshZoom`]) and for the
//! synchronous average. A lost block, a new rate or a lost turn interrupts the record in progress, never the
//! averages, so no product mixes what is not contiguous.
//!
//! Input rate: at least four times the highest wanted mesh harmonic, or the resampling loses amplitude. The grid of
//! the mesh bands goes with it ([`OrderChain::set_samples_per_pitch`]): fine enough that half the input rate does not
//! fold into a band.
//!
//! Cost (Cortex-M4F in QEMU): 22 instructions per input sample, about 80 per angle resampled and as much again per
//! angle of the mesh bands. RAM: the sum of its parts; 55 KiB for 8192 samples, 256 points, 5 harmonics and a
//! 1024-point average.

use crate::order::{Discontinuity, OrderTracker, Turn};
use crate::shaft_lines::ShaftLines;
use crate::tsa::SynchronousAverage;
use crate::zoom::{MeshZoom, ZoomConfig, ZoomError};

/// Angles resampled in one go.
const STRETCH: usize = 128;

/// What a call to [`OrderChain::process`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Turns resampled.
    pub turns: u32,
    /// Mesh-band records completed.
    pub records: u32,
    /// Turns lost because their samples had left the buffer.
    pub lost: u32,
}

/// Order tracker, mesh bands and synchronous average of one channel.
#[derive(Debug, Clone)]
pub struct OrderChain<const CAPACITY: usize, const POINTS: usize, const HARMONICS: usize, const AVERAGE: usize> {
    tracker: OrderTracker<CAPACITY>,
    zoom: MeshZoom<POINTS, HARMONICS>,
    shafts: ShaftLines,
    average: SynchronousAverage<AVERAGE>,
    /// Turns an average takes; further ones are left out until it is reset. 0 is no limit.
    average_turns: u32,
    /// Of the record in progress and of the latest complete one.
    span: Span,
    record: Span,
    interruptions: u32,
    /// A turn was resampled since the latest interruption.
    runs: bool,
}

/// The turns of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Span {
    /// Tick at which the first turn began.
    pub first_tick: u32,
    /// Whole turns.
    pub turns: u32,
    /// Their duration, ticks.
    pub ticks: u64,
    /// Duration of the fastest turn, ticks.
    pub shortest: u32,
    /// Duration of the slowest turn, ticks.
    pub longest: u32,
}

impl Span {
    /// Mean shaft rate, Hz; 0 without turns.
    pub fn mean_hz(&self, ticks_per_second: u32) -> f32 {
        if self.ticks == 0 {
            return 0.0;
        }
        // One division in double precision keeps every digit of the speed.
        (f64::from(self.turns) * f64::from(ticks_per_second) / self.ticks as f64) as f32
    }

    fn add(&mut self, turn: &Turn) {
        if self.turns == 0 {
            *self = Self { first_tick: turn.start_tick, shortest: u32::MAX, ..Self::default() };
        }
        self.turns += 1;
        self.ticks += u64::from(turn.ticks);
        self.shortest = self.shortest.min(turn.ticks);
        self.longest = self.longest.max(turn.ticks);
    }
}

impl<const CAPACITY: usize, const POINTS: usize, const HARMONICS: usize, const AVERAGE: usize>
    OrderChain<CAPACITY, POINTS, HARMONICS, AVERAGE>
{
    /// Without a configuration: all zero bytes, for statics. [`OrderChain::configure`] makes it useful.
    pub const IDLE: Self = Self {
        tracker: OrderTracker::new(),
        zoom: MeshZoom::IDLE,
        shafts: ShaftLines::IDLE,
        average: SynchronousAverage::new(),
        average_turns: 0,
        span: Span { first_tick: 0, turns: 0, ticks: 0, shortest: 0, longest: 0 },
        record: Span { first_tick: 0, turns: 0, ticks: 0, shortest: 0, longest: 0 },
        interruptions: 0,
        runs: false,
    };

    /// Checks the mesh-band configuration and starts empty.
    pub fn new(config: ZoomConfig) -> Result<Self, ZoomError> {
        let mut chain = Self::IDLE;
        chain.configure(config, AVERAGE, 0)?;
        Ok(chain)
    }

    /// Checks the mesh-band configuration and starts anew, with averages of this many samples per turn over this many
    /// turns (0 is without end).
    pub fn configure(&mut self, config: ZoomConfig, points: usize, turns: u32) -> Result<(), ZoomError> {
        self.zoom.configure(config)?;
        self.tracker.reset();
        self.average.set_points(points);
        self.average_turns = turns;
        self.span = Span::default();
        Ok(())
    }

    /// Sets the grid of the mesh bands, see [`MeshZoom::set_samples_per_pitch`].
    pub fn set_samples_per_pitch(&mut self, samples: usize) {
        if samples != self.zoom.samples_per_pitch() {
            self.interrupt();
            self.zoom.set_samples_per_pitch(samples);
        }
    }

    /// Appends samples, see [`OrderTracker::push_samples`]; call [`OrderChain::process`] before the buffer has turned
    /// over.
    pub fn push_samples(&mut self, samples: &[f32], first_tick: u32, period_ticks: u32) {
        if self.tracker.push_samples(samples, first_tick, period_ticks).is_err() {
            self.interrupt();
        }
    }

    /// Takes the instant at which the pinion passes angle zero.
    pub fn push_mark(&mut self, tick: u32) {
        self.tracker.push_mark(tick);
    }

    /// Tach lost or speed not to be believed: marks and the record in progress are forgotten.
    pub fn lose_tach(&mut self) {
        self.tracker.forget_marks();
        self.interrupt();
        self.shafts.reset();
    }

    fn interrupt(&mut self) {
        self.zoom.interrupt();
        self.shafts.interrupt();
        self.span = Span::default();
        self.interruptions = self.interruptions.wrapping_add(1);
        self.runs = false;
    }

    /// Resamples all complete turns.
    pub fn process(&mut self) -> Progress {
        let mut progress = Progress::default();
        loop {
            match self.tracker.next_turn() {
                Ok(None) => return progress,
                Err(Discontinuity::Overrun | Discontinuity::Samples | Discontinuity::Marks) => {
                    // Turns that a gap has taken along are one interruption.
                    if self.runs {
                        self.interrupt();
                    }
                    progress.lost += 1;
                }
                Ok(Some(turn)) => {
                    self.runs = true;
                    self.span.add(&turn);
                    let per_turn = self.zoom.samples_per_turn();
                    let pitch_ticks = turn.ticks as f32 / f32::from(self.zoom.config().teeth.max(1));
                    self.shafts.begin_turn(turn.number);
                    let mut angles = [0.0f32; STRETCH];
                    let mut first = 0;
                    while first < per_turn {
                        let count = (per_turn - first).min(STRETCH as u32);
                        let angles = angles.get_mut(..count as usize).unwrap_or_default();
                        self.tracker.resample(&turn, first, per_turn, angles);
                        let shafts = &mut self.shafts;
                        if self.zoom.push_with(angles, |low| shafts.push(low, pitch_ticks)) > 0 {
                            progress.records += 1;
                            self.record = core::mem::take(&mut self.span);
                        }
                        first += count;
                    }
                    if self.average_turns == 0 || self.average.turns() < self.average_turns {
                        let (tracker, points) = (&self.tracker, self.average.points() as u32);
                        self.average.add_turn(|first, out| tracker.resample(&turn, first, points, out));
                    }
                    progress.turns += 1;
                }
            }
        }
    }

    /// The mesh bands.
    pub fn mesh_bands(&self) -> &MeshZoom<POINTS, HARMONICS> {
        &self.zoom
    }

    /// Orders of both shafts.
    pub fn shafts(&mut self) -> &mut ShaftLines {
        &mut self.shafts
    }

    /// Turns of the latest complete mesh-band record.
    pub fn record(&self) -> &Span {
        &self.record
    }

    /// Starts the mesh-band averages anew.
    pub fn reset_mesh_bands(&mut self) {
        self.zoom.reset();
    }

    /// The synchronous average in progress; reset it after use.
    pub fn average(&mut self) -> &mut SynchronousAverage<AVERAGE> {
        &mut self.average
    }

    /// Records interrupted so far (lost samples, new rate, lost turns, lost tach).
    pub fn interruptions(&self) -> u32 {
        self.interruptions
    }
}
