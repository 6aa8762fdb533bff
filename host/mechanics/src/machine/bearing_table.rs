//! Geometry of rolling bearings by designation, as published with measured records.
//!
//! Makers publish boundary dimensions and ratings, not the elements, and vary the elements of one designation: orders
//! may be off by some per cent for another make, more than slip. So a designation is here only where somebody who
//! measured it states elements and both diameters; for any other the owner declares dimensions or the four orders.

/// Designation, rolling elements, pitch diameter, m, element diameter, m, contact angle, degrees.
pub type Row = (&'static str, u32, f64, f64, f64);

/// Rows by designation, each with its source.
const TABLE: &[Row] = &[
    // Lessmeier and others 2016, Condition monitoring of bearing damage (Paderborn University), table of the bearing.
    ("6203", 8, 0.02855, 0.00675, 0.0),
    // Bearing data centre of Case Western Reserve University, drive end: 1.537 and 0.3126 inches.
    ("6205", 9, 0.03904, 0.00794, 0.0),
    // Forbes 2012, inner and outer race bearing fault measurements (Curtin University), MB ER-16K.
    ("ER16K", 9, 0.0385, 0.0079375, 0.0),
    // Wang and others 2020, doi 10.1109/TR.2018.2882682, table 1: LDK UER204.
    ("UER204", 8, 0.03455, 0.00792, 0.0),
];

/// The row of a designation; what follows a blank, dash or slash, and a suffix of letters, is ignored.
pub fn of(designation: &str) -> Option<&'static Row> {
    let own = designation.trim().to_uppercase();
    let own = own.split(['-', '/', ' ']).next().unwrap_or_default();
    let is_suffix = |rest: &str| !rest.starts_with(|c: char| c.is_ascii_digit());
    TABLE.iter().find(|row| own.strip_prefix(row.0).is_some_and(is_suffix))
}

/// Designations of the table, for messages.
pub fn designations() -> String {
    TABLE.iter().map(|row| row.0).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::bearing::BearingOrders;

    /// Orders of the outer and the inner ring as the sources state them beside the geometry. Those of the first
    /// collection are of its fan end's bearing, another 6203.
    const PUBLISHED_ORDERS: &[(&str, f64, f64)] =
        &[("6203", 3.0530, 4.9469), ("6205", 3.5848, 5.4152), ("ER16K", 3.572, 5.428)];

    #[test]
    fn ref_the_geometry_gives_the_published_orders() {
        for (designation, outer, inner) in PUBLISHED_ORDERS {
            let (_, elements, pitch, element, _) = of(designation).expect("a row");
            let orders = BearingOrders::of(*elements, element / pitch);
            assert!((orders.outer / outer - 1.0).abs() < 1e-3, "{designation}: {}", orders.outer);
            assert!((orders.inner / inner - 1.0).abs() < 1e-3, "{designation}: {}", orders.inner);
        }
    }

    #[test]
    fn theory_elements_fit_on_their_pitch_circle() {
        for (designation, elements, pitch, element, _) in TABLE {
            assert!(*element < pitch * (std::f64::consts::PI / f64::from(*elements)).sin(), "{designation}");
        }
    }

    #[test]
    fn theory_suffixes_are_no_other_bearing() {
        for own in ["6205", "6205-2RS", "6205 2Z/C3", "6205zz", " 6205 C3"] {
            assert_eq!(of(own).map(|row| row.0), Some("6205"), "{own}");
        }
        for other in ["62052", "16205", "", "NU6205"] {
            assert!(of(other).is_none(), "{other}");
        }
    }
}
