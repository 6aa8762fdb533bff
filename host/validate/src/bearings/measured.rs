//! The labelled records of two public collections, by the names of their files.
//!
//! `cwru/` (bearing data centre of Case Western Reserve University: 6205, 12 kHz, label and load in the name) and
//! `paderborn/` (Lessmeier and others 2016: 6203, 64 kHz, speed and bearing code in the name). Speeds are nominal:
//! neither has a tachometer.

use super::{Damage, Labelled};
use crate::import::{self, ImportOptions, Reading, TachChoice, Unit};
use crate::machine::bearing::Bearing;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Speeds of the loads 0 to 3 of the first collection, rpm.
const CWRU_RPM: [f64; 4] = [1797.0, 1772.0, 1750.0, 1730.0];
/// Speeds of the second by the first part of a name, rpm.
const PADERBORN_RPM: [(&str, f64); 2] = [("N09", 900.0), ("N15", 1500.0)];

/// Every labelled record of a data folder, by name.
///
/// # Errors
/// No such folder; a record that cannot be read.
pub fn all(data: &Path) -> Result<Vec<Labelled>> {
    let mut all = Vec::new();
    for (folder, ending) in [("cwru", "mat"), ("paderborn", "csv")] {
        for path in files(&data.join(folder), ending)? {
            all.extend(labelled(&path, folder)?);
        }
    }
    if all.is_empty() {
        return Err(Error::invalid(data.display(), "holds no labelled record (cwru/*.mat, paderborn/*.csv)"));
    }
    Ok(all)
}

fn files(folder: &Path, ending: &str) -> Result<Vec<PathBuf>> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(Vec::new()) };
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let paths = paths.collect::<std::io::Result<Vec<PathBuf>>>();
    let mut paths = paths.map_err(|error| Error::invalid(folder.display(), error))?;
    paths.retain(|path| path.extension().is_some_and(|own| own == ending));
    paths.sort();
    Ok(paths)
}

fn labelled(path: &Path, folder: &str) -> Result<Option<Labelled>> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let Some((damage, rpm)) = label(&name) else { return Ok(None) };
    let (designation, rate_hz, unit) =
        if folder == "cwru" { ("6205", 12_000.0, Unit::Gravity) } else { ("6203", 64_000.0, Unit::Unknown) };
    let options = ImportOptions {
        title: name.clone(),
        rate_hz: Some(rate_hz),
        units: vec![unit],
        reading: Reading { no_time: true, ..Reading::default() },
        float: true,
        no_gears: true,
        tach: TachChoice::Nominal(rpm / 60.0),
        ..ImportOptions::default()
    };
    let (record, _) = import::import(&[path.to_owned()], &options)?;
    let bearing = Bearing {
        name: designation.into(),
        shaft: "shaft".into(),
        designation: Some(designation.into()),
        ..Bearing::default()
    };
    Ok(Some(Labelled { name, record, bearing, damage }))
}

/// Damage and speed, rpm, from a name; none where it is no labelled record.
fn label(name: &str) -> Option<(Damage, f64)> {
    let of = |code: &str| match code.get(..2) {
        Some("OR" | "KA") => Some(Damage::Outer),
        Some("IR" | "KI") => Some(Damage::Inner),
        Some("no" | "K0") => Some(Damage::Sound),
        Some(code) if code.starts_with('B') => Some(Damage::Element),
        _ => None,
    };
    if let Some((_, rpm)) = PADERBORN_RPM.into_iter().find(|(speed, _)| name.starts_with(speed)) {
        return Some((of(name.split('_').nth(3)?)?, rpm));
    }
    let load: usize = name.rsplit('_').next()?.parse().ok()?;
    Some((of(name)?, *CWRU_RPM.get(load)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_labels_are_read_from_names() {
        assert_eq!(label("OR007@6_1"), Some((Damage::Outer, 1772.0)));
        assert_eq!(label("B021_0"), Some((Damage::Element, 1797.0)));
        assert_eq!(label("normal_0"), Some((Damage::Sound, 1797.0)));
        assert_eq!(label("N09_M07_F10_KI14_1"), Some((Damage::Inner, 900.0)));
        assert_eq!(label("N15_M07_F10_K001_1"), Some((Damage::Sound, 1500.0)));
        assert_eq!(label("LICENSE"), None);
    }
}
