//! Power that repeats with the pinion's turn, free of noise, and the frequency below which 99 % of it lies.
//!
//! Even and odd turns are averaged apart. The product of the two averages' lines has the locked power as its mean:
//! their noise is independent, so a noise floor adds scatter and no bandwidth. The imaginary part is that scatter
//! alone and tells how large it is. Limits: sidebands of the gear's shaft at fractions of the pinion's turn count as
//! noise; they lie beside the mesh lines and move no bandwidth.

use super::stretches::Stretch;
use realfft::RealFftPlanner;

/// Share of the power that the occupied bandwidth holds (ITU-R SM.328).
const SHARE: f64 = 0.99;
/// Share of the sampling rate up to which orders are looked at, as in `analyse`.
const PASS_SHARE: f64 = 0.4;
/// Least power over its own standard error.
const LEAST_SIGNIFICANCE: f64 = 5.0;
/// Share of the band from which a bandwidth is only a lower bound.
const BOUND: f64 = 0.9;

/// Power locked to the pinion of a stretch, or of several.
#[derive(Debug, Clone, Default)]
pub struct LockedPower {
    /// Mean power of order 1, 2, ...
    power: Vec<f64>,
    /// Sum of the squares of the imaginary parts.
    scatter: f64,
}

/// A measured bandwidth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Occupied {
    /// Hz.
    Measured(f64),
    /// The record's band holds no 99 %: a lower bound, Hz.
    AtLeast(f64),
    /// Too little power over the noise.
    Noise,
}

/// Locked power of a stretch of samples at equal angles.
pub fn locked_power(samples: &[f64], per_turn: usize, stretch: &Stretch, rate_hz: f64) -> LockedPower {
    let mut halves = [vec![0.0; per_turn], vec![0.0; per_turn]];
    for turn in 0..stretch.turns {
        let from = (stretch.first + turn) * per_turn;
        for (sum, x) in halves[turn % 2].iter_mut().zip(&samples[from..from + per_turn]) {
            *sum += x;
        }
    }
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(per_turn);
    let scale = 1.0 / (per_turn as f64 * (stretch.turns / 2) as f64);
    let lines = halves.map(|mut half| {
        let mut bins = plan.make_output_vec();
        plan.process(&mut half, &mut bins).expect("buffers have the planned lengths");
        bins
    });
    let orders = ((PASS_SHARE * rate_hz / stretch.speed_hz) as usize).min(per_turn / 2 - 1);
    let products = (1..=orders).map(|k| lines[0][k] * lines[1][k].conj() * (2.0 * scale * scale));
    let (power, scatter) = products.fold((Vec::with_capacity(orders), 0.0), |(mut power, scatter), p| {
        power.push(p.re);
        (power, scatter + p.im * p.im)
    });
    LockedPower { power, scatter }
}

/// Occupied bandwidth of stretches of about the same speed: their lines are put together by frequency, since their
/// last orders differ.
pub fn occupied<'a>(stretches: impl Iterator<Item = (&'a LockedPower, f64)> + Clone) -> Occupied {
    let band_hz = stretches.clone().map(|(p, speed_hz)| p.power.len() as f64 * speed_hz).fold(f64::INFINITY, f64::min);
    let scatter: f64 = stretches.clone().map(|(p, _)| p.scatter).sum();
    let mut lines: Vec<(f64, f64)> = stretches
        .flat_map(|(p, speed_hz)| {
            p.power.iter().zip(1..).map(move |(power, order)| (f64::from(order) * speed_hz, *power))
        })
        .filter(|(hz, _)| *hz <= band_hz)
        .collect();
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let running = lines.iter().scan(0.0, |sum, (hz, power)| {
        *sum += power;
        Some((*hz, *sum))
    });
    let total = running.clone().map(|(_, sum)| sum).fold(0.0, f64::max);
    if total <= LEAST_SIGNIFICANCE * scatter.sqrt() {
        return Occupied::Noise;
    }
    match running.clone().find(|(_, sum)| *sum >= SHARE * total) {
        Some((hz, _)) if hz < BOUND * band_hz => Occupied::Measured(hz),
        _ => Occupied::AtLeast(band_hz),
    }
}
