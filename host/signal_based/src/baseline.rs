//! The declared model and the calibrated one: mesh harmonics behind an unknown path, constant or moving with the speed.
//!
//! *Declared*: every harmonic `k z1` has one complex amplitude per run and channel. *Calibrated*: it may move with
//! the speed ([`super::basis::Basis`]); that takes in path resonances crossed in a run-up or a wander, a delay of the
//! tach (a phase linear in speed) and its angle zero. Which functions, is chosen line by line on the fitted turns
//! alone ([`Choice`]); where the speed runs up, poles of the path are fitted that all lines and channels share
//! ([`pole_search`]). Every function of every line counts as two unknowns.

use super::amplitudes::Weighted;
use super::basis::{FittedLine, State};
use super::basis_selection::Choice;
use super::pole_search;
use super::scene::{Scene, SceneRun};
use super::speed_sweep::Course;
use rayon::prelude::*;

/// Samples by run and channel.
pub type Grids = Vec<Vec<Vec<f64>>>;

/// Both models, fitted.
pub struct Baseline {
    /// How amplitudes may move, per run.
    pub choices: Vec<Choice>,
    /// What constant amplitudes leave.
    pub declared: Grids,
    /// What amplitudes that move with the speed leave.
    pub calibrated: Grids,
    /// Calibrated mesh lines by run and channel.
    pub lines: Vec<Vec<Vec<FittedLine>>>,
    /// Real unknowns of the two.
    pub unknowns: [usize; 2],
}

/// Unknowns of fitted lines.
pub fn unknowns(lines: &[FittedLine]) -> usize {
    2 * lines.iter().map(|line| line.basis.len()).sum::<usize>()
}

impl Baseline {
    /// Fits both on the fitted turns.
    pub fn of(scene: &Scene) -> Self {
        let orders = mesh_orders(scene);
        let mut baseline = Self {
            choices: Vec::new(),
            declared: Vec::new(),
            calibrated: Vec::new(),
            lines: Vec::new(),
            unknowns: [0, 0],
        };
        for run in &scene.runs {
            let weighted = Weighted::new(run);
            let choice = choice(run, &weighted, &orders);
            let fitted = |choice: Option<&Choice>| -> Vec<(Vec<f64>, Vec<FittedLine>)> {
                let of_channel = |samples: &Vec<f64>| {
                    let mut rest = samples.clone();
                    let lines = weighted.fit(&mut rest, &orders, choice, &[]);
                    (rest, lines)
                };
                run.samples.par_iter().map(of_channel).collect()
            };
            let (declared, constant): (Vec<_>, Vec<_>) = fitted(None).into_iter().unzip();
            let (calibrated, lines): (Vec<_>, Vec<_>) = fitted(Some(&choice)).into_iter().unzip();
            let count = |lines: &[Vec<FittedLine>]| lines.iter().map(|lines| unknowns(lines)).sum::<usize>();
            baseline.unknowns[0] += count(&constant);
            baseline.unknowns[1] += count(&lines);
            baseline.declared.push(declared);
            baseline.calibrated.push(calibrated);
            baseline.lines.push(lines);
            baseline.choices.push(choice);
        }
        baseline
    }

    /// Most functions of speed that a mesh line of each run has.
    pub fn functions(&self) -> Vec<usize> {
        let most = |run: &Vec<Vec<FittedLine>>| run.iter().flatten().map(|line| line.basis.len()).max().unwrap_or(0);
        self.lines.iter().map(most).collect()
    }

    /// Mean amplitude over the run's speed of the calibrated mesh line nearest to `order`.
    pub fn nearest_mesh(&self, scene: &Scene, run: usize, channel: usize, order: f64) -> f64 {
        let lines = &self.lines[run][channel];
        if scene.gearing.is_some() {
            let apart = |line: &&FittedLine| (line.order - order).abs();
            let nearest = lines.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            return nearest.map_or(0.0, |line| line.at(State::steady(scene.runs[run].angle.speed.mean_hz)).norm());
        }
        let k = ((order / scene.mesh_order()).round().max(1.0) as usize).min(lines.len());
        lines
            .get(k.wrapping_sub(1))
            .map_or(0.0, |line| line.at(State::steady(scene.runs[run].angle.speed.mean_hz)).norm())
    }

    /// Largest mean amplitude of a mesh line in a run and channel.
    pub fn strongest_mesh(&self, scene: &Scene, run: usize, channel: usize) -> f64 {
        let orders = mesh_orders(scene);
        orders.iter().map(|&order| self.nearest_mesh(scene, run, channel, order)).fold(0.0, f64::max)
    }
}

/// Orders of the mesh harmonics that every run holds.
pub fn mesh_orders(scene: &Scene) -> Vec<f64> {
    if let Some(gearing) = &scene.gearing {
        return gearing.fitted.clone();
    }
    let z = scene.mesh_order();
    (1..=(scene.highest_order / z) as usize).map(|k| k as f64 * z).collect()
}

/// The functions of speed that a run's lines may have.
fn choice(run: &SceneRun, weighted: &Weighted, orders: &[f64]) -> Choice {
    // Over whole turns of the gear its sidebands cancel: they are no course of the mesh line.
    let block = (1.0 / run.angle.slower_order()).round().max(1.0) as usize;
    let held = run.split.held_out.iter().map(|stretch| stretch.turns).max().unwrap_or(0);
    let choice = Choice::new(weighted.states(), weighted.weight_of_turn(), block, held);
    if !run.runs_up() {
        return choice;
    }
    let courses: Vec<Course> = run
        .samples
        .par_iter()
        .flat_map_iter(|samples| orders.iter().map(move |&order| (samples, order)))
        .map(|(samples, order)| choice.sweep.course(order, &weighted.sums(samples, order)))
        .collect();
    let poles = pole_search::found(&choice.sweep, &courses);
    choice.with_poles(poles)
}
