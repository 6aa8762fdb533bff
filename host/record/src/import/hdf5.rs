//! HDF5 files, MATLAB 7.3 files among them: real numeric arrays of all groups.
//!
//! Read by the crate `hdf5-reader` (pure Rust, no C library; bounds and cycles checked), with its limits set to ours.
//! An array's name is its path. Rates, units, CF's `scale_factor` and `add_offset` are attributes of an array, or of
//! a group for what lies in it ([`super::variables`]). MATLAB stores its arrays turned and its texts as numbers: both
//! are told by `MATLAB_class`. Links to other files are not followed. Not read: compound (complex), text, arrays of
//! three dimensions; they are counted in a remark.

use super::signals::Signals;
use super::variables::{Variable, is_factor, is_start, is_unit, rate_of, signals};
use crate::budget::{FILE, VALUES};
use crate::{Error, Result, text};
use hdf5_reader::group::Group;
use hdf5_reader::messages::datatype::Datatype;
use hdf5_reader::{Dataset, Hdf5File, OpenOptions};
use std::path::Path;

/// Groups within groups that are looked into.
const MAX_GROUP_DEPTH: usize = 16;
/// Arrays and groups that are looked at.
const MOST_OBJECTS: usize = 10_000;

/// Whether the content is HDF5, at the start or behind MATLAB's user block.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
    [0, 512, 1024, 2048, 4096].iter().any(|at| bytes.get(*at..).is_some_and(|rest| rest.starts_with(MAGIC)))
}

pub(super) fn read(path: &Path, bytes: Vec<u8>, stem: &str) -> Result<Signals> {
    let most = FILE.most as usize;
    let options = OpenOptions::default().with_max_read_bytes(most).with_max_chunk_bytes(most / 4);
    let refuse = |error: hdf5_reader::error::Error| broken(path, &error);
    let file = Hdf5File::from_vec_with_options(bytes, options).map_err(refuse)?;
    let mut found = Found { path, variables: Vec::new(), values: 0, objects: 0, skipped: 0 };
    found.group(&file.root_group().map_err(refuse)?, "", 0)?;
    signals(path, found.variables, found.skipped, stem)
}

/// What cannot be read: damage, or a form of HDF5 that the crate does not know.
fn broken(path: &Path, what: &dyn std::fmt::Display) -> Error {
    let what = what.to_string();
    let of = [
        ("filter id 32000", "compressed by lzf"),
        ("layout class 3", "a virtual dataset, which points into other files"),
        ("external", "raw data in an external file"),
        ("unsupported", "a form of HDF5 that is not read"),
    ];
    let what = match of.iter().find(|(sign, _)| what.contains(sign)) {
        Some((_, form)) => format!(
            "holds {form} ({what}); write the arrays anew, plain or with gzip: h5py's create_dataset(NAME, data=..., \
             compression='gzip'), or h5repack -f GZIP=4"
        ),
        None => format!("HDF5 data is broken ({what})"),
    };
    Error::invalid(path.display(), what)
}

/// Arrays found on the way through the groups.
struct Found<'a> {
    path: &'a Path,
    variables: Vec<Variable>,
    values: usize,
    objects: usize,
    skipped: usize,
}

impl Found<'_> {
    fn refuse(&self, what: impl std::fmt::Display) -> Error {
        broken(self.path, &what)
    }

    fn group(&mut self, group: &Group, name: &str, depth: usize) -> Result<()> {
        let (groups, datasets) = group.members().map_err(|error| self.refuse(error))?;
        self.objects += groups.len() + datasets.len();
        if depth > MAX_GROUP_DEPTH || self.objects > MOST_OBJECTS {
            return Err(self.refuse("groups within groups without end"));
        }
        for attribute in group.attributes().map_err(|error| self.refuse(error))? {
            self.said(name, &attribute);
        }
        for dataset in &datasets {
            self.dataset(dataset, name)?;
        }
        // MATLAB keeps what cells refer to in a group of its own.
        for inner in groups.iter().filter(|inner| inner.name() != "#refs#" && inner.name() != "#subsystem#") {
            self.group(inner, &joined(name, inner.name()), depth + 1)?;
        }
        Ok(())
    }

    /// Keeps an attribute of a group that is a rate or a unit.
    fn said(&mut self, of: &str, attribute: &hdf5_reader::Attribute) {
        let name = text::name(&attribute.name);
        let shown = joined(of, &name);
        let variable = Variable { folder: of.to_owned(), name, shown, ..Variable::default() };
        if let Some(value) = number(attribute).filter(|value| rate_of(&attribute.name, *value).is_some()) {
            self.variables.push(Variable { rows: 1, columns: 1, values: vec![value], ..variable });
        } else if is_unit(&attribute.name) {
            self.variables.push(Variable { text: attribute.read_string().ok(), ..variable });
        }
    }

    fn dataset(&mut self, dataset: &Dataset, folder: &str) -> Result<()> {
        let name = joined(folder, dataset.name());
        let (rows, columns) = match dataset.shape() {
            [] => (1, 1),
            [rows] => (*rows, 1),
            // Row by row of the file is column by column of what it is turned to.
            [columns, rows] => (*rows, *columns),
            _ => (0, 0),
        };
        let class = dataset.attribute("MATLAB_class").ok().and_then(|class| class.read_string().ok());
        let is_text = class.is_some_and(|class| class.starts_with("char"));
        let count = rows.checked_mul(columns).and_then(|count| usize::try_from(count).ok()).unwrap_or(usize::MAX);
        if count == 0 || is_text || !is_number(dataset.dtype()) {
            self.skipped += 1;
            return Ok(());
        }
        self.values = self.values.saturating_add(count);
        VALUES.check(self.path.display(), self.values as f64, "save fewer arrays or shorter ones")?;
        let mut values = numbers(dataset).map_err(|error| self.refuse(error))?;
        if values.len() != count {
            return Err(self.refuse("an array has another length than its shape says"));
        }
        let attributes = dataset.attributes();
        let of =
            |key: &str| attributes.iter().find(|attribute| attribute.name.eq_ignore_ascii_case(key)).and_then(number);
        let (factor, offset) = (of("scale_factor"), of("add_offset"));
        if factor.is_some() || offset.is_some() {
            let (factor, offset) = (factor.unwrap_or(1.0), offset.unwrap_or(0.0));
            values.iter_mut().for_each(|x| *x = factor * *x + offset);
        }
        let rate_hz = attributes.iter().find_map(|attribute| rate_of(&attribute.name, number(attribute)?));
        if let Some(rate) = rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
            let what = format!("array {} states a sampling rate of {rate} Hz", text::quoted(&name));
            return Err(Error::invalid(self.path.display(), what));
        }
        let unit = attributes
            .iter()
            .filter(|attribute| is_unit(&attribute.name))
            .find_map(|attribute| attribute.read_string().ok());
        let start_s = attributes.iter().filter(|attribute| is_start(&attribute.name)).find_map(number);
        let note = attributes.iter().filter(|attribute| is_factor(&attribute.name)).find_map(|attribute| {
            let value = number(attribute)?;
            let (array, own) = (text::quoted(&name), text::quoted(&attribute.name));
            Some(format!("array {array}: its attribute {own} = {value} is not applied to the numbers"))
        });
        self.variables.push(Variable {
            folder: folder.to_owned(),
            name: text::name(dataset.name()),
            shown: text::name(&name),
            rows: rows as usize,
            columns: columns as usize,
            values,
            text: None,
            unit,
            rate_hz,
            start_s,
            note,
        });
        Ok(())
    }
}

/// The one number of an attribute.
fn number(attribute: &hdf5_reader::Attribute) -> Option<f64> {
    attribute.read_as_f64().ok()
}

fn joined(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_string() } else { format!("{folder}/{name}") }
}

fn is_number(kind: &Datatype) -> bool {
    match kind {
        Datatype::FixedPoint { size, .. } => [1, 2, 4, 8].contains(size),
        Datatype::FloatingPoint { size, .. } => [2, 4, 8].contains(size),
        _ => false,
    }
}

fn numbers(dataset: &Dataset) -> std::result::Result<Vec<f64>, hdf5_reader::error::Error> {
    macro_rules! read {
        ($type:ty) => {
            dataset.read_array::<$type>()?.iter().map(|x| *x as f64).collect()
        };
    }
    Ok(match dataset.dtype() {
        Datatype::FixedPoint { size: 1, signed: true, .. } => read!(i8),
        Datatype::FixedPoint { size: 1, .. } => read!(u8),
        Datatype::FixedPoint { size: 2, signed: true, .. } => read!(i16),
        Datatype::FixedPoint { size: 2, .. } => read!(u16),
        Datatype::FixedPoint { size: 4, signed: true, .. } => read!(i32),
        Datatype::FixedPoint { size: 4, .. } => read!(u32),
        Datatype::FixedPoint { signed: true, .. } => read!(i64),
        Datatype::FixedPoint { .. } => read!(u64),
        Datatype::FloatingPoint { size: 2, .. } => {
            let bytes = dataset.read_native_bytes()?;
            bytes.chunks_exact(2).map(|pair| half(u16::from_ne_bytes([pair[0], pair[1]]))).collect()
        }
        Datatype::FloatingPoint { size: 4, .. } => read!(f32),
        _ => read!(f64),
    })
}

/// A float of 16 bits (IEEE 754 binary16).
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff) / 1024.0);
    sign * match exponent {
        0 => fraction * 2.0_f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction) * 2.0_f64.powi(exponent - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::half;

    #[test]
    fn theory_halves_are_what_the_standard_says() {
        let pairs = [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 2.0_f64.powi(-24)),
            (0x3555, 0.333_251_953_125),
        ];
        for (bits, value) in pairs {
            assert_eq!(half(bits), value, "{bits:#x}");
        }
        assert!(half(0x7c00).is_infinite() && half(0x7e00).is_nan());
    }
}
