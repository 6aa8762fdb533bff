//! Whether anything stands at the orders of the bearings that the owner declares, and at which of them.
//!
//! Each part of each bearing is asked for within the slip of its passage (2 % down; 1 % up, where a thrust makes the
//! contact steeper) by the same probability as any comb, over fewer choices. The part that chance explains least is
//! named; another within three nats whose lines are the same up to turns of the shaft is in question with it. Limit:
//! one part per bearing is named; a cage turns too slowly for a comb of its own.

use super::Impacts;
use super::bands::Band;
use super::combs::{self, Comb, Known};
use super::readings::{self, Reading};
use super::thresholds::{
    DECLARED_SLIP, HIGHEST_ORDER, MIN_ADOPTION_NATS, MIN_HELD_OUT_NATS, MIN_OTHER_LINES_NATS, MIN_RING_NATS,
    PART_MARGIN_NATS,
};
use crate::machine::bearing::BearingOrders;
use crate::record::Record;
use crate::scene::Scene;
use crate::{Error, Result};

/// The word of a rolling element.
const ELEMENT: &str = "rolling element";

/// A declared bearing on a shaft of the scene.
#[derive(Debug, Clone)]
pub struct Declared {
    /// Its name.
    pub name: String,
    /// Index of its shaft.
    pub shaft: usize,
    /// Turns of its shaft per turn of the pinion.
    pub own: f64,
    /// Its orders per turn of its shaft.
    pub orders: BearingOrders,
}

/// The bearings of a record's `[[bearing]]` tables.
///
/// # Errors
/// A bearing that makes no sense, or is on a shaft that the record does not have.
pub fn of_record(record: &Record, scene: &Scene) -> Result<Vec<Declared>> {
    let place = record.folder.join("record.toml");
    let of = |bearing: crate::machine::bearing::Bearing| {
        let shaft = match bearing.shaft.as_str() {
            "pinion" => 0,
            "shaft" if !scene.has_gears() => 0,
            "gear" if scene.has_gears() => 1,
            other => {
                let shafts = if scene.has_gears() { "pinion, gear" } else { "shaft" };
                let [name, other] = [&bearing.name, other].map(crate::text::name);
                let what = format!("bearing {name} is on shaft '{other}', which is none of: {shafts}");
                return Err(Error::invalid(place.display(), what));
            }
        };
        let orders = bearing.orders().map_err(|error| Error::invalid(place.display(), error))?;
        Ok(Declared { name: bearing.name, shaft, own: scene.shaft_order(shaft), orders })
    };
    record.declaration.bearings()?.into_iter().map(of).collect()
}

impl Declared {
    /// Parts and their orders per turn of the pinion: an element strikes twice a turn of its own.
    pub fn parts(&self) -> [(&'static str, f64); 3] {
        let o = &self.orders;
        [("outer ring", o.outer), ("inner ring", o.inner), (ELEMENT, 2.0 * o.element)]
            .map(|(part, order)| (part, order * self.own))
    }
}

/// The part of each declared bearing that stands.
pub fn find(bands: &[Band], known: &Known, declared: &[Declared]) -> Vec<Impacts> {
    let tried = (3 * declared.len()) as f64;
    declared.iter().filter_map(|bearing| of_bearing(bands, known, bearing, tried)).collect()
}

fn of_bearing(bands: &[Band], known: &Known, bearing: &Declared, tried: f64) -> Option<Impacts> {
    let part = |(part, order): (&'static str, f64)| -> Option<(&'static str, Comb)> {
        let range = (order * (1.0 - DECLARED_SLIP.0), order * (1.0 + DECLARED_SLIP.1));
        let comb = combs::best(bands, known, &[range]).filter(|_| 3.0 * range.1 < HIGHEST_ORDER)?;
        Some((part, Comb { nats: comb.nats - tried.ln(), ..comb }))
    };
    let mut all: Vec<(&'static str, Comb)> = bearing.parts().into_iter().filter_map(part).collect();
    all.retain(|(_, comb)| {
        comb.nats >= MIN_ADOPTION_NATS && comb.others >= MIN_OTHER_LINES_NATS && comb.again >= MIN_HELD_OUT_NATS
    });
    // A spot on an element passes the load zone as the cage turns.
    let cage = bearing.own * bearing.orders.cage;
    let is_carried = |comb: &Comb| readings::is_modulated(&bands[comb.band], comb.base, comb.smear, known, cage);
    all.retain(|(part, comb)| *part != ELEMENT || is_carried(comb));
    all.sort_by(|a, b| b.1.nats.total_cmp(&a.1.nats));
    let (name, comb) = all.first()?.clone();
    let band = &bands[comb.band];
    let reading = Reading {
        base: comb.base,
        rival: None,
        modulated_by: readings::modulated_by(band, comb.base, comb.smear, known),
        parts: vec![name],
        shaft: Some(bearing.shaft),
        remark: format!("{:.2} % from its order without slip", 100.0 * (comb.base / order_of(bearing, name) - 1.0)),
    };
    let mut found = Impacts::of(comb, reading, Some(bearing.name.clone()), bands, &known.shafts);
    for (part, other) in &all[1..] {
        if other.nats >= found.comb.nats - PART_MARGIN_NATS && found.explains(other.base) {
            found.reading.parts.push(part);
        } else if !found.explains(other.base) && other.nats >= MIN_RING_NATS {
            found.reading.parts.push(part);
            found.reading.remark += &format!("; order {:.4}, its {part}'s, stands in its own right", other.base);
        } else if !found.explains(other.base) {
            found.reading.remark += &format!("; order {:.4}, its {part}'s, stands as well", other.base);
        }
    }
    Some(found)
}

fn order_of(bearing: &Declared, name: &str) -> f64 {
    bearing.parts().into_iter().find(|(part, _)| *part == name).map_or(f64::NAN, |(_, order)| order)
}
