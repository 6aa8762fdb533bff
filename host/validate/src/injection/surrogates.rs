//! Backgrounds with nothing in them: the mesh lines as they are, and noise of the record's own colour in place of
//! everything else.
//!
//! What the mesh leaves of every channel is replaced by [`Noise`] with its floor, smoothed over eight rates of the
//! slower shaft: no line, no sideband, no locking and no impulse is left, in whatever view families are read from,
//! while slopes, resonances and what channels have in common stay, and so does the wander of the tach. Limit:
//! stationary, which a machine's background is not quite.

use super::noise::Noise;
use crate::analysis::envelope::not_locked;
use crate::signal_based::baseline::{Baseline, Grids};
use crate::signal_based::residual_spectra::{self, Views};
use crate::signal_based::scene::{Scene, SceneRun};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Width over which a floor is smoothed, rates of the slower shaft: its sidebands are a few bins of so many.
const WIDTH: f64 = 8.0;

/// What surrogates of a record are drawn from.
pub struct Surrogates {
    runs: Vec<OfRun>,
}

struct OfRun {
    noise: Noise,
    /// What is kept of the signal over time, channel by channel.
    kept: Vec<Vec<f64>>,
    /// The mesh at equal angles.
    mesh: Vec<Vec<f64>>,
}

impl Surrogates {
    /// Of a record.
    pub fn of(scene: &Scene, baseline: &Baseline) -> Self {
        Self { runs: scene.runs.iter().zip(&baseline.calibrated).map(|(run, left)| OfRun::of(run, left)).collect() }
    }

    /// A record without an effect, and its views.
    pub fn drawn(&self, scene: &Scene, seed: u64) -> (Scene, Views) {
        let mut surrogate = scene.clone();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut calibrated: Grids = Vec::new();
        for (run, of) in surrogate.runs.iter_mut().zip(&self.runs) {
            for (c, noise) in of.noise.drawn(&mut random).into_iter().enumerate() {
                run.signals[c] = of.kept[c].iter().zip(&noise).map(|(x, noise)| x + noise).collect();
                run.samples[c] = run.on_grid(&run.signals[c], scene.highest_order);
            }
            let left = run.samples.iter().zip(&of.mesh);
            calibrated.push(left.map(|(x, mesh)| x.iter().zip(mesh).map(|(x, m)| x - m).collect()).collect());
        }
        let views = residual_spectra::views(&surrogate, &calibrated, |split| &split.fit, None);
        (surrogate, views)
    }
}

impl OfRun {
    fn of(run: &SceneRun, left: &[Vec<f64>]) -> Self {
        let mesh: Vec<Vec<f64>> =
            run.samples.iter().zip(left).map(|(x, left)| x.iter().zip(left).map(|(x, l)| x - l).collect()).collect();
        let rest: Vec<Vec<f64>> = run
            .signals
            .iter()
            .zip(&mesh)
            .map(|(signal, mesh)| not_locked(signal, run.rate_hz, mesh, &run.angle))
            .collect();
        let kept = run.signals.iter().zip(&rest).map(|(x, rest)| x.iter().zip(rest).map(|(x, r)| x - r).collect());
        let bin_hz = run.rate_hz / run.signals.first().map_or(1, Vec::len) as f64;
        let slower_hz = run.angle.slower_order() * run.angle.speed.mean_hz;
        let noise = Noise::of(&rest, (WIDTH * slower_hz / bin_hz).round() as usize);
        Self { kept: kept.collect(), mesh, noise }
    }
}
