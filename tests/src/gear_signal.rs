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

/// Shaft angle, turns, of a speed that changes linearly over `seconds`.
pub fn turns(t: f64, seconds: f64, from_hz: f64, to_hz: f64) -> f64 {
    from_hz * t + (to_hz - from_hz) * t * t / (2.0 * seconds)
}

/// Samples and tach edges of such a run.
pub fn run(seconds: f64, rate_hz: f64, from_hz: f64, to_hz: f64, teeth: u16) -> (Vec<f64>, Vec<f64>) {
    let angle = |t: f64| turns(t, seconds, from_hz, to_hz);
    let samples =
        (0..(seconds * rate_hz) as usize).map(|n| acceleration(angle(n as f64 / rate_hz), teeth)).collect::<Vec<_>>();
    let a = (to_hz - from_hz) / (2.0 * seconds);
    let time_of = |turn: f64| {
        if a == 0.0 { turn / from_hz } else { ((from_hz * from_hz + 4.0 * a * turn).sqrt() - from_hz) / (2.0 * a) }
    };
    (samples, (1..).map(f64::from).map(time_of).take_while(|t| *t < seconds).collect())
}
