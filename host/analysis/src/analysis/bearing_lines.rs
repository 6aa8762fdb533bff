//! Where the declared bearings' passages stand in the envelope's spectrum: a reading, no verdict.

use super::envelope::Envelope;
use super::lines::WINDOW;
use crate::Result;
use crate::record::Record;
use serde::Serialize;

/// Slip looked through below and above an order, share of it.
const SLIP: (f64, f64) = (0.02, 0.01);

/// A passage and the highest line within its slip.
#[derive(Debug, Clone, Serialize)]
pub struct BearingLine {
    /// Bearing and part.
    pub part: String,
    /// Order of the pinion without slip.
    pub order: f64,
    /// Share of the band's mean power.
    pub amplitude: f64,
}

/// Parts of the declared bearings and their orders of the pinion.
///
/// # Errors
/// A bearing whose orders cannot be told.
pub fn passages(record: &Record, gear_order: f64) -> Result<Vec<(String, f64)>> {
    let mut all = Vec::new();
    for bearing in record.declaration.bearings()? {
        let own = if bearing.shaft == "gear" { gear_order } else { 1.0 };
        let orders = bearing.orders()?;
        let parts = [("cage", orders.cage), ("outer ring", orders.outer), ("inner ring", orders.inner)];
        let name = crate::text::name(&bearing.name);
        let parts = parts.into_iter().chain([("element", 2.0 * orders.element)]);
        all.extend(parts.map(|(part, order)| (format!("{name} {part}"), order * own)));
    }
    Ok(all)
}

/// The passages read in an envelope's finest spectrum.
pub fn read(envelope: &Envelope, passages: &[(String, f64)]) -> Vec<BearingLine> {
    let Some(level) = envelope.levels.iter().min_by_key(|level| level.averages) else { return Vec::new() };
    let of = |(part, order): &(String, f64)| {
        let bin = |share: f64| (order * share / level.density.bin).round() as usize;
        let bins = bin(1.0 - SLIP.0)..=bin(1.0 + SLIP.1).min(level.density.values.len().saturating_sub(1));
        let highest = bins.map(|i| level.density.values[i]).fold(0.0, f64::max);
        BearingLine {
            part: part.clone(),
            order: *order,
            amplitude: (2.0 * highest * WINDOW.enbw_bins() * level.density.bin).sqrt(),
        }
    };
    passages.iter().filter(|(_, order)| *order < envelope.highest_order).map(of).collect()
}
