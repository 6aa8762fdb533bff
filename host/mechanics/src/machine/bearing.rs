//! A rolling bearing as its owner declares it: by designation, by dimensions or by its four orders.
//!
//! The same `[[bearing]]` table stands in `machines/*.toml` and in `record.toml`. Only ratios of dimensions count, so
//! that a bearing turns into four orders per turn of its shaft; the outer ring stands. Kinematics without slip
//! (Harris, Rolling Bearing Analysis, ch. 8; Randall and Antoni 2011, eq. 1 to 4): real passages are lower by up to 2
//! %, of one share for the bearing.

use super::bearing_table;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Fewest and most rolling elements taken for possible.
const ELEMENTS: std::ops::RangeInclusive<u32> = 3..=200;
/// Contact angle, degrees: from radial to just short of thrust bearings, whose cage turns at half the shaft's speed.
const CONTACT_DEG: std::ops::RangeInclusive<f64> = 0.0..=89.0;
/// Relative distance within which four stated orders belong to one bearing.
const ORDER_TOLERANCE_SHARE: f64 = 0.03;

/// A declared bearing: exactly one of `designation`, dimensions (`elements` with both diameters) and `orders`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bearing {
    /// Name in reports, unique in a machine.
    pub name: String,
    /// Shaft that its inner ring turns with: `pinion`, `gear`, or a shaft's name of a gear train.
    pub shaft: String,
    /// Designation, such as `6205`; suffixes after a blank, dash or slash are ignored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub designation: Option<String>,
    /// Rolling elements of one row.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elements: Option<u32>,
    /// Pitch diameter, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_diameter_m: Option<f64>,
    /// Diameter of a rolling element (mean of a tapered one), m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element_diameter_m: Option<f64>,
    /// Contact angle, degrees; absent: 0 with dimensions, the table's with a designation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_angle_deg: Option<f64>,
    /// The four orders as a catalogue states them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orders: Option<BearingOrders>,
}

/// Orders of a bearing per turn of its shaft, without slip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BearingOrders {
    /// Elements that pass a point of the outer ring (BPFO).
    pub outer: f64,
    /// Elements that pass a point of the inner ring (BPFI).
    pub inner: f64,
    /// Turns of the cage (FTF).
    pub cage: f64,
    /// Turns of an element about itself (BSF); a spot on it strikes twice as often.
    pub element: f64,
}

impl BearingOrders {
    /// Of `elements` rolling elements, their diameter over the pitch diameter times the contact angle's cosine being
    /// `ratio` (0 to 1).
    pub fn of(elements: u32, ratio: f64) -> Self {
        let n = f64::from(elements);
        Self {
            outer: 0.5 * n * (1.0 - ratio),
            inner: 0.5 * n * (1.0 + ratio),
            cage: 0.5 * (1.0 - ratio),
            element: 0.5 * (1.0 - ratio * ratio) / ratio,
        }
    }

    /// Rolling elements: outer and inner passage together.
    pub fn elements(&self) -> f64 {
        self.outer + self.inner
    }
}

impl Bearing {
    /// Its orders per turn of its shaft, without slip.
    ///
    /// # Errors
    /// None or more than one of designation, dimensions and orders; values out of range; a designation that the table
    /// lacks.
    pub fn orders(&self) -> Result<BearingOrders> {
        let refuse = |why: String| Error::invalid(format!("bearing {}", crate::text::name(&self.name)), why);
        let has_dimensions =
            self.elements.is_some() || self.pitch_diameter_m.is_some() || self.element_diameter_m.is_some();
        let ways = [self.designation.is_some(), has_dimensions, self.orders.is_some()];
        if ways.iter().filter(|is| **is).count() != 1 {
            let why = "needs exactly one of: designation; elements, pitch_diameter_m and element_diameter_m; orders";
            return Err(refuse(why.into()));
        }
        if let Some(orders) = self.orders {
            return consistent(orders).map_err(refuse);
        }
        let stated_deg = self.contact_angle_deg.unwrap_or(0.0);
        if !CONTACT_DEG.contains(&stated_deg) {
            return Err(refuse(format!("contact_angle_deg = {stated_deg} is not within 0 to 89")));
        }
        let row = self.designation.as_deref().map(|own| bearing_table::of(own).ok_or(own));
        let row = row.transpose().map_err(|own| {
            let own = crate::text::name(own);
            let known = bearing_table::designations();
            refuse(format!(
                "designation {own} is not in the table ({known}): state dimensions or the four orders in a \
                 [[bearing]] table of record.toml or of the machine file (book: explanation/bearings)"
            ))
        })?;
        if let Some((_, elements, pitch, element, angle_deg)) = row {
            let angle_deg = self.contact_angle_deg.unwrap_or(*angle_deg);
            return Ok(BearingOrders::of(*elements, element / pitch * angle_deg.to_radians().cos()));
        }
        let (Some(elements), Some(pitch), Some(element)) =
            (self.elements, self.pitch_diameter_m, self.element_diameter_m)
        else {
            return Err(refuse("needs all of elements, pitch_diameter_m and element_diameter_m".into()));
        };
        if !ELEMENTS.contains(&elements) {
            return Err(refuse(format!("elements = {elements} is not within 3 to 200")));
        }
        // Elements side by side on the pitch circle must not overlap.
        let room = pitch * (std::f64::consts::PI / f64::from(elements)).sin();
        if !(pitch > 0.0 && pitch < 100.0 && element > 0.0 && element < room) {
            return Err(refuse(format!(
                "{elements} elements of {element} m do not fit on a pitch circle of {pitch} m: check both diameters"
            )));
        }
        Ok(BearingOrders::of(elements, element / pitch * stated_deg.to_radians().cos()))
    }
}

/// Stated orders that one bearing can have.
fn consistent(orders: BearingOrders) -> std::result::Result<BearingOrders, String> {
    let BearingOrders { outer, inner, cage, element } = orders;
    if ![outer, inner, cage, element].iter().all(|order| order.is_finite() && *order > 0.0 && *order < 1000.0) {
        return Err("orders: each must lie between 0 and 1000 per turn of the shaft".into());
    }
    let elements = (outer + inner).round();
    let ratio = (inner - outer) / (inner + outer);
    if !(ratio > 0.0 && elements >= f64::from(*ELEMENTS.start())) {
        return Err(format!(
            "orders: inner = {inner} must exceed outer = {outer}, their sum is the number of elements"
        ));
    }
    let own = BearingOrders::of(elements as u32, ratio);
    let off = |stated: f64, own: f64| (stated / own - 1.0).abs() > ORDER_TOLERANCE_SHARE;
    if off(outer, own.outer) || off(cage, own.cage) {
        return Err(format!(
            "orders: {outer} and {inner} belong to {elements} elements and a cage of {:.4}, not {cage}",
            own.cage
        ));
    }
    if off(element, own.element) {
        let twice = if off(element, 2.0 * own.element) { "" } else { "; the spin is asked for, not twice it" };
        return Err(format!("orders: element = {element}, where the others give {:.4}{twice}", own.element));
    }
    Ok(orders)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ref_dimensions_of_a_6205_give_its_published_orders() {
        let bearing = Bearing {
            name: "drive end".into(),
            shaft: "pinion".into(),
            elements: Some(9),
            pitch_diameter_m: Some(0.03904),
            element_diameter_m: Some(0.00794),
            ..Bearing::default()
        };
        let orders = bearing.orders().expect("a bearing");
        for (own, published) in [(orders.outer, 3.5848), (orders.inner, 5.4152), (orders.cage, 0.39828)] {
            assert!((own / published - 1.0).abs() < 1e-3, "{own} {published}");
        }
        assert!((2.0 * orders.element / 4.7135 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn fault_a_bearing_declared_twice_or_impossibly_is_refused() {
        let twice = Bearing { designation: Some("6205".into()), elements: Some(9), ..Bearing::default() };
        assert!(twice.orders().is_err());
        assert!(Bearing::default().orders().is_err());
        let crowded = Bearing {
            elements: Some(20),
            pitch_diameter_m: Some(0.04),
            element_diameter_m: Some(0.008),
            ..Bearing::default()
        };
        assert!(crowded.orders().is_err());
        let stated = BearingOrders { outer: 3.585, inner: 5.415, cage: 0.3983, element: 4.7135 };
        let doubled = Bearing { orders: Some(stated), ..Bearing::default() };
        assert!(doubled.orders().expect_err("twice the spin").to_string().contains("not twice it"));
    }
}
