//! The pinion speeds that a law is made for, and the speeds at which it is fitted and checked.
//!
//! The paper's range is 1 to 25 Hz; a machine whose nominal speed lies near its end or above it gets a law that
//! reaches a quarter beyond that speed. Fit and check never share a speed but by chance: knots come from a grid in
//! equal ratios, the check's speeds are drawn at random.

use crate::machine::Machine;
use crate::{Error, Result};
use meshband_common::speed::Speed;
use rand::{RngExt, SeedableRng};
use serde::Serialize;
use std::str::FromStr;

/// Speeds the paper checks its equation (10) at, Hz.
pub const PAPER_CHECK_HZ: [f64; 3] = [8.0, 16.0, 22.0];
/// Slowest and fastest pinion that a law may be asked for, Hz.
const POSSIBLE_HZ: [f64; 2] = [0.5, 100.0];
/// Ratio of the domain's end to a nominal speed beyond the paper's range.
const NOMINAL_SPEED_RATIO: f64 = 1.25;
/// Least ratio of the domain's ends.
const LEAST_SPAN: f64 = 1.5;
/// Seed of the random held-out speeds.
const SEED: u64 = 42;
/// Random held-out speeds.
pub const RANDOM_SPEEDS: usize = 50;

/// A range of pinion speeds, Hz.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Domain {
    /// Slowest.
    pub lowest_hz: f64,
    /// Fastest.
    pub highest_hz: f64,
}

impl Domain {
    /// Speeds of the paper's tables.
    pub const PAPER: Self = Self { lowest_hz: 1.0, highest_hz: 25.0 };

    /// The paper's range, reaching beyond the machine's nominal speed where it declares one.
    pub fn of(machine: &Machine) -> Self {
        let needed_hz = machine.nominal.map_or(0.0, |nominal| NOMINAL_SPEED_RATIO * nominal.speed_hz);
        Self { highest_hz: needed_hz.clamp(Self::PAPER.highest_hz, POSSIBLE_HZ[1]), ..Self::PAPER }
    }

    /// `count` speeds in equal ratios, ends included.
    pub fn log_speeds(self, count: usize) -> Vec<f64> {
        let ratio = (self.highest_hz / self.lowest_hz).ln();
        (0..count).map(|i| self.lowest_hz * (ratio * i as f64 / (count - 1) as f64).exp()).collect()
    }

    /// `count` speeds in equal steps, ends included; 25 of the paper's range are the whole ones.
    pub fn even_speeds(self, count: usize) -> Vec<f64> {
        let step = (self.highest_hz - self.lowest_hz) / (count - 1) as f64;
        (0..count).map(|i| self.lowest_hz + step * i as f64).collect()
    }

    /// The three speeds named in tables: the paper's, elsewhere the same shares of the highest.
    pub fn named_speeds(self) -> [f64; 3] {
        PAPER_CHECK_HZ.map(|f| f * (self.highest_hz / Self::PAPER.highest_hz)).map(|f| f.max(self.lowest_hz))
    }

    /// Twice the highest speed, where a law only extrapolates.
    pub fn beyond_hz(self) -> f64 {
        2.0 * self.highest_hz
    }

    /// The speeds of the check: the named ones and [`RANDOM_SPEEDS`] random ones, uniform over the domain.
    pub fn held_out_speeds(self) -> Vec<f64> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(SEED);
        let drawn = (0..RANDOM_SPEEDS).map(|_| random.random_range(self.lowest_hz..self.highest_hz));
        self.named_speeds().into_iter().chain(drawn).collect()
    }
}

impl FromStr for Domain {
    type Err = Error;

    /// `LOW..HIGH`, each a [`Speed`].
    fn from_str(text: &str) -> Result<Self> {
        let [slowest, fastest] = POSSIBLE_HZ;
        let refuse = || {
            let what = format!(
                "`{}` is no range of pinion speeds: LOW..HIGH, as 12Hz..25Hz or 750rpm..1500rpm, from {slowest} to \
                 {fastest} Hz, HIGH at least {LEAST_SPAN} times LOW",
                crate::text::name(text)
            );
            Error::invalid("--speeds", what)
        };
        let (low, high) = text.split_once("..").ok_or_else(refuse)?;
        let number = |text: &str| text.parse::<Speed>().map(|speed| speed.0).map_err(|_| refuse());
        let domain = Self { lowest_hz: number(low)?, highest_hz: number(high)? };
        let possible = domain.lowest_hz >= slowest && domain.highest_hz <= fastest;
        // Not a number is in no range.
        if possible && domain.highest_hz >= LEAST_SPAN * domain.lowest_hz { Ok(domain) } else { Err(refuse()) }
    }
}
