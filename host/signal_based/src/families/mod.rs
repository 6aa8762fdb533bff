//! The library of signal-based inference: one file per family, each giving candidates for what a record may hold.
//!
//! A family states its lines, what it is called, and what decides between it and its neighbours. Adding one takes a
//! file here and a line in [`all`].

pub mod alias;
pub mod bearing;
pub mod carried;
pub mod clipping;
pub mod fixed_frequency;
pub mod ghost;
pub mod modulation;
pub mod passage;
pub mod shaft_orders;
pub mod swing;
pub mod tooth;
pub mod train;
pub mod train_tooth;

use super::candidate::{Candidate, TakenOf};
use super::scene::Scene;
use super::spectra::Spectra;
use crate::analysis::skirts::Skirts;

/// Power over the floor from which a shaft's order is taken to stand.
const MIN_FLOOR_RATIO: f64 = 3.0;

/// What families are found from.
pub struct Context<'a> {
    /// The record.
    pub scene: &'a Scene,
    /// Order spectra of the calibrated residual on the fitted turns.
    pub orders: &'a Spectra,
    /// Spectra over frequency of the same stretches.
    pub frequency: &'a Spectra,
    /// Order spectra of what is folded.
    pub folded: &'a Spectra,
    /// Spectra of the course of strength.
    pub strength: &'a Spectra,
    /// Orders spoken for, by domain.
    pub taken: &'a TakenOf,
    /// Feet of the mesh lines and their neighbours in the channels searched: what swings there is no order of its own.
    pub feet: &'a [Skirts],
}

impl Context<'_> {
    /// Whether an order lies on a mesh harmonic or beside it.
    pub fn on_mesh(&self, order: f64) -> bool {
        let is_at = |z: f64| {
            let k = (order / z).round();
            k >= 1.0 && (order - k * z).abs() <= self.scene.resolution()
        };
        self.scene.meshes().into_iter().any(is_at)
    }

    /// Whether an order lies at the foot of a line of the pair.
    pub fn at_foot(&self, order: f64) -> bool {
        self.feet.iter().any(|feet| feet.at(order, self.orders.bin(0)))
    }

    /// Whether an order is a whole one of the pinion, or so near one that stands that it cannot be told from it.
    pub fn on_pinion(&self, order: f64) -> bool {
        self.hides(self.orders, order.round(), order)
    }

    /// Whether a line at an order of a shaft hides another order in a spectrum: it is as near as the window's own
    /// width, or within its main lobe and the shaft's line stands.
    pub fn hides(&self, spectra: &Spectra, shaft_order: f64, order: f64) -> bool {
        let away = (order - shaft_order).abs();
        away <= self.scene.beside_a_shaft() || away <= self.scene.resolution() && self.stands(spectra, shaft_order)
    }

    /// Whether something stands at an order in any channel searched.
    fn stands(&self, spectra: &Spectra, order: f64) -> bool {
        let channels = (0..spectra.levels.len()).flat_map(|run| (0..self.scene.searched).map(move |c| (run, c)));
        let mut readings = channels.filter_map(|(run, channel)| spectra.reading(run, channel, 0, order, 0));
        readings.any(|reading| reading.ratio > MIN_FLOOR_RATIO)
    }
}

/// Every candidate of every family.
pub fn all(context: &Context) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    if context.scene.gearing.is_some() {
        candidates.extend(train::candidates(context));
        candidates.extend(passage::candidates(context));
        candidates.extend(fixed_frequency::candidates(context));
        return candidates;
    }
    candidates.extend(modulation::candidates(context));
    candidates.extend(shaft_orders::candidates(context));
    candidates.extend(tooth::candidates(context));
    candidates.extend(ghost::candidates(context));
    candidates.extend(passage::candidates(context));
    candidates.extend(swing::candidates(context));
    candidates.extend(fixed_frequency::candidates(context));
    candidates.extend(alias::candidates(context));
    candidates
}
