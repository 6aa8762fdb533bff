//! Signals of known content: mesh harmonics with shaft sidebands at a given course of the speed, one pulse per turn.

use std::f64::consts::TAU;

/// Amplitude of the first mesh harmonic, m/s^2; harmonic `h` has this over `h`.
pub const FIRST_HARMONIC_M_S2: f64 = 10.0;

/// Acceleration at a shaft angle, turns: five mesh harmonics with 10 % shaft sidebands.
pub fn acceleration(turns: f64, teeth: u16) -> f64 {
    let mesh = TAU * turns * f64::from(teeth);
    let modulation = 1.0 + 0.2 * (TAU * turns).cos();
    (1..=5).map(|h| modulation * FIRST_HARMONIC_M_S2 / f64::from(h) * (f64::from(h) * mesh).cos()).sum()
}

/// A speed that changes linearly, then stays.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// Shaft rate at the start, Hz.
    pub from_hz: f64,
    /// Shaft rate at the end of the change, Hz.
    pub to_hz: f64,
    /// Length of the change, s.
    pub change_s: f64,
    /// Length of the steady part after it, s.
    pub hold_s: f64,
}

impl Course {
    /// Length, s.
    pub fn seconds(&self) -> f64 {
        self.change_s + self.hold_s
    }

    /// Shaft angle, turns.
    pub fn turns(&self, t: f64) -> f64 {
        let changing = t.min(self.change_s);
        let slope = if self.change_s > 0.0 { (self.to_hz - self.from_hz) / self.change_s } else { 0.0 };
        self.from_hz * changing + slope * changing * changing / 2.0 + self.to_hz * (t - changing)
    }

    /// Samples at a rate, and tach edges, one per turn.
    pub fn sample(&self, rate_hz: f64, teeth: u16) -> (Vec<f64>, Vec<f64>) {
        let count = (self.seconds() * rate_hz) as usize;
        let samples = (0..count).map(|n| acceleration(self.turns(n as f64 / rate_hz), teeth)).collect();
        let last = self.turns(self.seconds()) as u32;
        (samples, (1..last).map(|turn| self.time_of(f64::from(turn))).collect())
    }

    /// Instant of an angle, by bisection: the speed never changes its sign.
    fn time_of(&self, turn: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.seconds());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.turns(middle) < turn { low = middle } else { high = middle }
        }
        high
    }
}
