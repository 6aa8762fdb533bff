//! From ADC codes to the two rates of the products: the mesh bands' continuously, the wideband records' now and then.
//!
//! Two half-band cascades start from the ADC rate. The one to the mesh bands always runs; its first stages are the cheap
//! ones. The one to the law's rate has its steep stages next to the ADC, so it only runs while a wideband record or a
//! measurement of rise times is under way, with filters that start empty and settle before the first sample counts.
//!
//! Time is counted, not accumulated: output n of a cascade describes the instant of ADC sample
//! `(n + 1) 2^k - 1 - delay`, so the tick of every sample is exact however long the stream runs.

use crate::config::Sensor;
use crate::decimate::Cascade;
use crate::units::{Hertz, TicksPerSecond};

/// Samples of a wideband record.
pub const WIDE_POINTS: usize = 4096;
/// ADC codes filtered at a time.
pub const CHUNK: usize = 128;

/// One cascade with the time of its samples.
#[derive(Clone, Debug)]
struct Path {
    cascade: Cascade,
    /// Tick of the first ADC sample.
    origin: u64,
    period_ticks: u32,
    outputs: u64,
}

impl Path {
    fn new() -> Self {
        Self { cascade: Cascade::new(0), origin: 0, period_ticks: 1, outputs: 0 }
    }

    fn restart(&mut self, origin: u64, period_ticks: u32, stages: u8) {
        self.cascade.restart(stages);
        (self.origin, self.period_ticks, self.outputs) = (origin, period_ticks, 0);
    }

    /// Filters in place; settled outputs and the number of the first of them.
    fn process<'a>(&mut self, samples: &'a mut [f32]) -> (&'a [f32], u64) {
        let count = self.cascade.process(samples);
        let first = self.outputs;
        self.outputs += count as u64;
        let unsettled = u64::from(self.cascade.settling_outputs()).saturating_sub(first).min(count as u64);
        (samples.get(unsettled as usize..count).unwrap_or_default(), first + unsettled)
    }

    /// Tick that output `number` describes.
    fn tick_of(&self, number: u64) -> u64 {
        let newest = ((number + 1) << self.cascade.stages()) - 1;
        let since = newest as i64 - i64::from(self.cascade.delay_samples());
        self.origin.saturating_add_signed(since * i64::from(self.period_ticks))
    }

    fn is_settled(&self) -> bool {
        self.outputs > u64::from(self.cascade.settling_outputs())
    }
}

/// Filters and the time of their outputs.
#[derive(Clone, Debug)]
pub struct Stream {
    started: bool,
    mesh: Path,
    wide: Path,
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
        Self { started: false, mesh: Path::new(), wide: Path::new(), wide_runs: false }
    }

    /// Forgets everything; the next code was captured at tick `origin`. The wideband path stops.
    pub fn restart(&mut self, origin: u64, period_ticks: u32, mesh_stages: u8) {
        self.started = false;
        self.wide_runs = false;
        self.mesh.restart(origin, period_ticks, mesh_stages);
    }

    /// Whether codes have come since the restart.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Corrects the origin before the first code.
    pub fn set_origin(&mut self, origin: u64) {
        self.mesh.origin = origin;
    }

    /// Whether the filters of the mesh bands have forgotten the time before the restart.
    pub fn is_settled(&self) -> bool {
        self.mesh.is_settled()
    }

    /// Starts the wideband path with the code captured at tick `origin`.
    pub fn start_wide(&mut self, origin: u64, stages: u8) {
        self.wide_runs = true;
        self.wide.restart(origin, self.mesh.period_ticks, stages);
    }

    /// Stops the wideband path.
    pub fn stop_wide(&mut self) {
        self.wide_runs = false;
    }

    /// Whether the wideband path runs.
    pub fn wide_runs(&self) -> bool {
        self.wide_runs
    }

    /// Takes at most [`CHUNK`] codes. Settled samples of both paths are handed on with the tick of the first; those of the
    /// mesh bands with their period as well.
    pub fn push(
        &mut self,
        codes: &[u16],
        sensor: &Sensor,
        wide: impl FnOnce(&[f32], u64),
        mesh: impl FnOnce(&[f32], u64, u32),
    ) {
        let mut samples = [0.0f32; CHUNK];
        let zero = f32::from(sensor.zero_code);
        for (sample, &code) in samples.iter_mut().zip(codes) {
            *sample = (f32::from(code) - zero) * sensor.acceleration_per_code.0;
        }
        let count = codes.len().min(CHUNK);
        self.started |= count > 0;
        if self.wide_runs {
            let mut copy = samples;
            let (settled, number) = self.wide.process(&mut copy[..count]);
            if !settled.is_empty() {
                wide(settled, self.wide.tick_of(number));
            }
        }
        let (settled, number) = self.mesh.process(&mut samples[..count]);
        if !settled.is_empty() {
            let period = self.mesh.period_ticks.saturating_mul(1 << self.mesh.cascade.stages());
            mesh(settled, self.mesh.tick_of(number), period);
        }
    }

    /// Stages and rate of the mesh bands.
    pub fn mesh_format(&self, clock: TicksPerSecond) -> (u8, Hertz) {
        let stages = self.mesh.cascade.stages();
        (stages, Hertz(clock.rate(self.mesh.period_ticks).0 / (1u32 << stages) as f32))
    }
}
