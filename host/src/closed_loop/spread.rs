//! Standard errors by leaving out speeds, as a check of those that least squares gives.

use super::base_fit::Base;
use super::candidate::Candidate;
use super::frame::Frame;
use super::judge::columns;
use super::least_squares::Data;
use super::probability::Probability;
use nalgebra::DVector;

/// Standard errors by leaving out blocks.
pub struct Spread {
    /// Of every unknown.
    pub sigma: Vec<f64>,
    /// Number of blocks less one.
    degrees: f64,
}

impl Spread {
    /// Whether the spread of unknown `i` is beyond what `sigma` leaves to chance.
    pub fn contradicts(&self, i: usize, sigma: f64) -> bool {
        let ratio = (self.sigma[i] / sigma.max(1e-300)).powi(2);
        self.degrees > 0.0
            && Probability::chi_square_above(self.degrees * ratio, self.degrees).value() < LEAST_AGREEMENT
    }
}

/// Probability by chance below which blocks disagree.
const LEAST_AGREEMENT: f64 = 0.01;

/// Spread of every unknown when each speed of `runs` is left out in turn: what the least-squares covariance cannot know, a law that
/// does not hold from speed to speed, shows here. Runs of one speed share what the model has wrong there. Standard error by the jackknife.
pub fn jackknife(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate]) -> Spread {
    let frame = Frame::new(data, &columns(base, terms));
    let blocks = base.speeds(runs);
    let all: Vec<DVector<f64>> = blocks
        .iter()
        .map(|left_out| {
            let kept: Vec<usize> = runs.iter().copied().filter(|r| !left_out.contains(r)).collect();
            frame.systems.estimate(&kept, None).x
        })
        .collect();
    let n = all.len() as f64;
    let of = |i: usize| {
        let mean = all.iter().map(|x| x[i]).sum::<f64>() / n;
        ((n - 1.0) / n * all.iter().map(|x| (x[i] - mean).powi(2)).sum::<f64>()).sqrt()
    };
    Spread { sigma: (0..all.first().map_or(0, DVector::len)).map(of).collect(), degrees: n - 1.0 }
}
