//! Dimensions of common rolling bearings by designation.
//!
//! Makers vary the number and the size of the elements of one designation (another cage, another year): a row is one make's, and its
//! orders may be off by some per cent for another. Who knows better declares dimensions or orders.

/// Designation, rolling elements, pitch diameter, m, element diameter, m, contact angle, degrees.
pub type Row = (&'static str, u32, f64, f64, f64);

/// Rows by designation.
/// 6203: Lessmeier and others 2016 (Paderborn); 6205, 6203 of the fan end: Case Western Reserve bearing data centre.
const TABLE: &[Row] = &[("6203", 8, 0.02855, 0.00675, 0.0), ("6205", 9, 0.03904, 0.00794, 0.0)];

/// The row of a designation; what follows a blank, dash or slash, and a suffix of letters, is ignored.
pub fn of(designation: &str) -> Option<&'static Row> {
    let own = designation.trim().to_uppercase();
    let own = own.split(['-', '/', ' ']).next().unwrap_or_default();
    let is_suffix = |rest: &str| !rest.starts_with(|c: char| c.is_ascii_digit());
    TABLE.iter().find(|row| own.strip_prefix(row.0).is_some_and(is_suffix))
}

/// Designations of the table, for an error's remedy.
pub fn designations() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|row| row.0)
}

#[cfg(test)]
mod tests {
    use super::*;

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
