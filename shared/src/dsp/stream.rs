//! From ADC codes to the two rates of the products: the mesh bands' continuously, the wideband records' now and then.
//!
//! Two decimators start from the ADC rate. The one to the mesh bands always runs and is the cheaper one. The one to the
//! law's rate has its steep stages next to the ADC, so it only runs while a wideband record or a
//! measurement of rise times is under way, with filters that start empty and settle before the first sample counts.
//!
//! Time is counted, not accumulated: output n of a cascade describes the instant of ADC sample
//! `(n + 1) 2^k - 1 - delay`, so the tick of every sample is exact however long the stream runs.

use crate::config::Sensor;
use crate::decimate::Cascade;
use crate::mesh_decimator::{Decimation, MeshDecimator};
use crate::units::{Hertz, TicksPerSecond};

/// Samples of a wideband record.
pub const WIDE_POINTS: usize = 4096;
/// ADC codes filtered at a time.
pub const CHUNK: usize = 128;

/// What the clock of an output needs to know of its filter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filter {
    pub(crate) ratio: u32,
    pub(crate) delay_samples: u32,
    pub(crate) settling_outputs: u32,
}

/// The time of a filter's outputs.
#[derive(Clone, Debug)]
pub(crate) struct OutputClock {
    /// Tick of the first ADC sample.
    origin: u64,
    period_ticks: u32,
    outputs: u64,
}

impl OutputClock {
    pub(crate) const fn new(origin: u64, period_ticks: u32) -> Self {
        Self { origin, period_ticks, outputs: 0 }
    }

    /// Ticks from one ADC sample to the next.
    pub(crate) fn period_ticks(&self) -> u32 {
        self.period_ticks
    }

    /// Counts outputs; the settled ones and the tick of the first of them.
    pub(crate) fn take<'a>(&mut self, outputs: &'a [f32], filter: Filter) -> (&'a [f32], u64) {
        let first = self.outputs;
        let count = outputs.len() as u64;
        self.outputs += count;
        let unsettled = u64::from(filter.settling_outputs).saturating_sub(first).min(count);
        (outputs.get(unsettled as usize..).unwrap_or_default(), self.tick_of(first + unsettled, filter))
    }

    /// Tick that output `number` describes.
    fn tick_of(&self, number: u64, filter: Filter) -> u64 {
        let newest = (number + 1) * u64::from(filter.ratio) - 1;
        let since = newest as i64 - i64::from(filter.delay_samples);
        self.origin.saturating_add_signed(since * i64::from(self.period_ticks))
    }
}

/// Filters and the time of their outputs.
#[derive(Clone, Debug)]
pub struct Stream {
    started: bool,
    mesh: MeshDecimator,
    mesh_clock: OutputClock,
    wide: Cascade,
    wide_clock: OutputClock,
    wide_runs: bool,
}

impl Default for Stream {
    fn default() -> Self {
        Self::new()
    }
}

impl Stream {
    /// An empty stream without decimation.
    pub fn new() -> Self {
        Self {
            started: false,
            mesh: MeshDecimator::new(Decimation::NONE),
            mesh_clock: OutputClock::new(0, 1),
            wide: Cascade::new(0),
            wide_clock: OutputClock::new(0, 1),
            wide_runs: false,
        }
    }

    /// No code has come yet, and the wideband path stops; [`Stream::restart_mesh`] begins anew.
    pub fn stop(&mut self) {
        self.started = false;
        self.wide_runs = false;
    }

    /// Forgets what the mesh bands' filters hold; the next code was captured at tick `origin`.
    pub fn restart_mesh(&mut self, origin: u64, period_ticks: u32, mesh: Decimation) {
        self.mesh = MeshDecimator::new(mesh);
        self.mesh_clock = OutputClock::new(origin, period_ticks);
    }

    /// Whether codes have come since the restart.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Corrects the origin before the first code.
    pub fn set_origin(&mut self, origin: u64) {
        self.mesh_clock.origin = origin;
    }

    /// Whether the filters of the mesh bands have forgotten the time before the restart.
    pub fn is_settled(&self) -> bool {
        self.mesh_clock.outputs > u64::from(self.mesh.settling_outputs())
    }

    /// Starts the wideband path with the code captured at tick `origin`.
    pub fn start_wide(&mut self, origin: u64, stages: u8) {
        self.wide_runs = true;
        self.wide.restart(stages);
        self.wide_clock = OutputClock::new(origin, self.mesh_clock.period_ticks);
    }

    /// Stops the wideband path.
    pub fn stop_wide(&mut self) {
        self.wide_runs = false;
    }

    /// Takes at most [`CHUNK`] codes. Settled samples of both paths are handed on with the tick of the first; those
    /// of the mesh bands with their period as well.
    pub fn push(
        &mut self,
        codes: &[u16],
        sensor: &Sensor,
        wide: impl FnOnce(&[f32], u64),
        mesh: impl FnOnce(&[f32], u64, u32),
    ) {
        let codes = codes.get(..CHUNK).unwrap_or(codes);
        let (per_code, zero_code) = (sensor.acceleration_per_code.0, sensor.zero_code);
        self.started |= !codes.is_empty();
        if self.wide_runs {
            let mut samples = [0.0f32; CHUNK];
            let zero = f32::from(zero_code);
            for (sample, &code) in samples.iter_mut().zip(codes) {
                *sample = (f32::from(code) - zero) * per_code;
            }
            let count = self.wide.process(samples.get_mut(..codes.len()).unwrap_or_default());
            let filter = Filter {
                ratio: 1 << self.wide.stages(),
                delay_samples: self.wide.delay_samples(),
                settling_outputs: self.wide.settling_outputs(),
            };
            let (settled, tick) = self.wide_clock.take(samples.get(..count).unwrap_or_default(), filter);
            if !settled.is_empty() {
                wide(settled, tick);
            }
        }
        let ratio = self.mesh.decimation().ratio();
        let filter =
            Filter { ratio, delay_samples: self.mesh.delay_samples(), settling_outputs: self.mesh.settling_outputs() };
        let outputs = self.mesh.process(codes, per_code, zero_code);
        if outputs.is_empty() {
            return;
        }
        let (settled, tick) = self.mesh_clock.take(outputs, filter);
        if !settled.is_empty() {
            mesh(settled, tick, self.mesh_clock.period_ticks.saturating_mul(ratio));
        }
    }

    /// Half-band stages and rate of the mesh bands.
    pub fn mesh_format(&self, clock: TicksPerSecond) -> (u8, Hertz) {
        let decimation = self.mesh.decimation();
        (decimation.stages, Hertz(clock.rate(self.mesh_clock.period_ticks).0 / decimation.ratio() as f32))
    }
}
