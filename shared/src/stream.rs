//! From ADC codes to two records: wideband at the law's rate, mesh-band at the lowest rate that carries the harmonics.
//!
//! Time is counted, not accumulated: output n of a cascade describes the instant of ADC sample
//! `(n + 1) 2^k - 1 - delay`, so a record's first tick is exact however long the stream runs.

use crate::config::Sensor;
use crate::decimate::Cascade;
use crate::mesh_band::POINTS;
use crate::units::{Hertz, TicksPerSecond};

/// Samples of a wideband record.
pub const WIDE_POINTS: usize = 4096;
/// ADC codes filtered at a time.
pub const CHUNK: usize = 128;

/// What a chunk completed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Progress {
    /// The wideband record is full.
    pub wide_complete: bool,
    /// The mesh-band record is full.
    pub mesh_complete: bool,
}

/// Filters and records.
#[derive(Clone, Debug)]
pub struct Stream {
    origin: u64,
    started: bool,
    period_ticks: u32,
    to_wide: Cascade,
    to_mesh: Cascade,
    wide_outputs: u64,
    mesh_outputs: u64,
    wide: [f32; WIDE_POINTS],
    wide_count: usize,
    wide_from: u64,
    mesh: [f32; POINTS],
    mesh_count: usize,
    mesh_from: u64,
    snapshot: [i16; WIDE_POINTS],
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
            origin: 0,
            started: false,
            period_ticks: 1,
            to_wide: Cascade::new(0),
            to_mesh: Cascade::new(0),
            wide_outputs: 0,
            mesh_outputs: 0,
            wide: [0.0; WIDE_POINTS],
            wide_count: 0,
            wide_from: 0,
            mesh: [0.0; POINTS],
            mesh_count: 0,
            mesh_from: 0,
            snapshot: [0; WIDE_POINTS],
        }
    }

    /// Forgets everything; the next code was captured at tick `origin`.
    pub fn restart(&mut self, origin: u64, period_ticks: u32, stages: u8, mesh_stages: u8) {
        self.origin = origin;
        self.started = false;
        self.period_ticks = period_ticks;
        self.to_wide.restart(stages);
        self.to_mesh.restart(mesh_stages);
        (self.wide_outputs, self.mesh_outputs) = (0, 0);
        (self.wide_count, self.mesh_count) = (0, 0);
    }

    /// Whether codes have come since the restart.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Corrects the origin before the first code.
    pub fn set_origin(&mut self, origin: u64) {
        self.origin = origin;
    }

    /// Whether all filters have forgotten the time before the restart.
    pub fn is_settled(&self) -> bool {
        self.wide_outputs > u64::from(self.to_wide.settling_outputs())
            && self.mesh_outputs > u64::from(self.mesh_settling())
    }

    fn mesh_settling(&self) -> u32 {
        self.to_mesh.settling_outputs() + (self.to_wide.settling_outputs() >> self.to_mesh.stages())
    }

    /// Takes at most [`CHUNK`] codes.
    pub fn push(&mut self, codes: &[u16], sensor: &Sensor) -> Progress {
        let mut samples = [0.0f32; CHUNK];
        let zero = f32::from(sensor.zero_code);
        for (sample, &code) in samples.iter_mut().zip(codes) {
            *sample = (f32::from(code) - zero) * sensor.acceleration_per_code.0;
        }
        let count = codes.len().min(CHUNK);
        self.started |= count > 0;
        let wide = self.to_wide.process(&mut samples[..count]);
        let settling = u64::from(self.to_wide.settling_outputs());
        let mut progress = Progress::default();
        for &sample in &samples[..wide] {
            let number = self.wide_outputs;
            self.wide_outputs += 1;
            if number < settling || self.wide_count == WIDE_POINTS {
                continue;
            }
            if self.wide_count == 0 {
                self.wide_from = number;
            }
            self.wide[self.wide_count] = sample;
            self.wide_count += 1;
            progress.wide_complete |= self.wide_count == WIDE_POINTS;
        }
        let mesh = self.to_mesh.process(&mut samples[..wide]);
        let settling = u64::from(self.mesh_settling());
        for &sample in &samples[..mesh] {
            let number = self.mesh_outputs;
            self.mesh_outputs += 1;
            if number < settling || self.mesh_count == POINTS {
                continue;
            }
            if self.mesh_count == 0 {
                self.mesh_from = number;
            }
            self.mesh[self.mesh_count] = sample;
            self.mesh_count += 1;
            progress.mesh_complete |= self.mesh_count == POINTS;
        }
        progress
    }

    /// Tick described by the first sample of the wideband record.
    pub fn wide_first_tick(&self) -> u64 {
        let stages = self.to_wide.stages();
        self.tick_of(((self.wide_from + 1) << stages) - 1, self.to_wide.delay_samples())
    }

    /// Rate, stages from the ADC and first tick of the mesh-band record.
    pub fn mesh_format(&self, clock: TicksPerSecond) -> (Hertz, u8, u64) {
        let stages = self.to_wide.stages() + self.to_mesh.stages();
        let rate = Hertz(clock.rate(self.period_ticks).0 / (1u32 << stages) as f32);
        let delay = self.to_wide.delay_samples() + (self.to_mesh.delay_samples() << self.to_wide.stages());
        (rate, stages, self.tick_of(((self.mesh_from + 1) << stages) - 1, delay))
    }

    fn tick_of(&self, newest_sample: u64, delay_samples: u32) -> u64 {
        let since = newest_sample as i64 - i64::from(delay_samples);
        self.origin.saturating_add_signed(since * i64::from(self.period_ticks))
    }

    /// The wideband record.
    pub fn wide(&self) -> &[f32; WIDE_POINTS] {
        &self.wide
    }

    /// The wideband record as work space.
    pub fn wide_mut(&mut self) -> &mut [f32; WIDE_POINTS] {
        &mut self.wide
    }

    /// Starts the next wideband record.
    pub fn clear_wide(&mut self) {
        self.wide_count = 0;
    }

    /// The mesh-band record as work space.
    pub fn mesh_mut(&mut self) -> &mut [f32; POINTS] {
        &mut self.mesh
    }

    /// Starts the next mesh-band record.
    pub fn clear_mesh(&mut self) {
        self.mesh_count = 0;
    }

    /// Keeps the wideband record in 16 bit; returns the scale, m/s^2 per unit.
    pub fn keep_snapshot(&mut self) -> f32 {
        let largest = self.wide.iter().fold(0.0f32, |largest, sample| largest.max(sample.abs()));
        let scale = if largest > 0.0 { largest / 32_767.0 } else { 1.0 };
        for (kept, sample) in self.snapshot.iter_mut().zip(&self.wide) {
            *kept = (sample / scale) as i16;
        }
        scale
    }

    /// The kept snapshot.
    pub fn snapshot(&self) -> &[i16; WIDE_POINTS] {
        &self.snapshot
    }
}
