//! HDF5 files, MATLAB 7.3 files among them: real numeric arrays of all groups.
//!
//! Read by the crate `hdf5-reader` (pure Rust, no C library; bounds and cycles checked), with its limits set to ours.
//! An array's name is its path; the longest arrays are channels ([`super::variables`]). A number called a sampling
//! rate is taken from arrays and from attributes of arrays and groups. MATLAB stores its arrays turned and its texts
//! as numbers: both are told by `MATLAB_class`. Links to other files are not followed. Not read: compound (complex),
//! text, arrays of three dimensions; they are counted in a remark.

use super::variables::{Variable, columns, is_rate};
use super::{Columns, Reading, time_axis};
use crate::budget::{FILE, VALUES};
use crate::{Error, Result, text};
use hdf5_reader::group::Group;
use hdf5_reader::messages::datatype::Datatype;
use hdf5_reader::{Dataset, Hdf5File, OpenOptions};
use std::path::Path;

/// Groups within groups that are looked into.
const DEEPEST: usize = 16;
/// Arrays and groups that are looked at.
const MOST_OBJECTS: usize = 10_000;

/// Whether the content is HDF5, at the start or behind MATLAB's user block.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
    bytes.starts_with(MAGIC) || bytes.get(512..).is_some_and(|rest| rest.starts_with(MAGIC))
}

pub(super) fn read(path: &Path, bytes: Vec<u8>, stem: &str, reading: &Reading) -> Result<Columns> {
    let most = FILE.most as usize;
    let options = OpenOptions::default().with_max_read_bytes(most).with_max_chunk_bytes(most / 4);
    let refuse =
        |error: hdf5_reader::error::Error| Error::invalid(path.display(), format!("HDF5 data is broken ({error})"));
    let file = Hdf5File::from_vec_with_options(bytes, options).map_err(refuse)?;
    let mut found = Found { path, variables: Vec::new(), values: 0, objects: 0, skipped: 0 };
    found.group(&file.root_group().map_err(refuse)?, "", 0)?;
    let columns = columns(path, found.variables, found.skipped, stem)?;
    if reading.no_time {
        return Ok(columns);
    }
    let all: Vec<usize> = (0..columns.channels.len()).collect();
    time_axis::take(path, columns, &all)
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
        Error::invalid(self.path.display(), format!("HDF5 data is broken ({what})"))
    }

    fn group(&mut self, group: &Group, name: &str, depth: usize) -> Result<()> {
        let (groups, datasets) = group.members().map_err(|error| self.refuse(error))?;
        self.objects += groups.len() + datasets.len();
        if depth > DEEPEST || self.objects > MOST_OBJECTS {
            return Err(self.refuse("groups within groups without end"));
        }
        for attribute in group.attributes().map_err(|error| self.refuse(error))? {
            self.rate(name, &attribute);
        }
        for dataset in &datasets {
            let own = joined(name, dataset.name());
            dataset.attributes().iter().for_each(|attribute| self.rate(&own, attribute));
            self.dataset(dataset, own)?;
        }
        // MATLAB keeps what cells refer to in a group of its own.
        for inner in groups.iter().filter(|inner| inner.name() != "#refs#" && inner.name() != "#subsystem#") {
            self.group(inner, &joined(name, inner.name()), depth + 1)?;
        }
        Ok(())
    }

    /// Keeps an attribute that is a sampling rate.
    fn rate(&mut self, of: &str, attribute: &hdf5_reader::Attribute) {
        let Some(value) = is_rate(&attribute.name).then(|| attribute.read_as_f64().ok()).flatten() else { return };
        let name = joined(of, &text::name(&attribute.name));
        let values = vec![value];
        self.variables.push(Variable { name, rows: 1, columns: 1, values });
    }

    fn dataset(&mut self, dataset: &Dataset, name: String) -> Result<()> {
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
        let values = numbers(dataset).map_err(|error| self.refuse(error))?;
        if values.len() != count {
            return Err(self.refuse("an array has another length than its shape says"));
        }
        let name = text::name(&name);
        self.variables.push(Variable { name, rows: rows as usize, columns: columns as usize, values });
        Ok(())
    }
}

fn joined(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_string() } else { format!("{folder}/{name}") }
}

fn is_number(kind: &Datatype) -> bool {
    match kind {
        Datatype::FixedPoint { size, .. } => [1, 2, 4, 8].contains(size),
        Datatype::FloatingPoint { size, .. } => [4, 8].contains(size),
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
        Datatype::FloatingPoint { size: 4, .. } => read!(f32),
        _ => read!(f64),
    })
}
