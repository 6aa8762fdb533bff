//! MATLAB level 5 MAT-files: numeric arrays, structures and cells, plain or zlib-compressed.
//!
//! Source: MathWorks, "MAT-File Format", level 5. Read: real full arrays of every numeric class, texts, structures
//! and cells with those in them, small data elements, both byte orders. Not read: sparse and complex arrays, objects
//! (tables, timetables); they are counted in a remark. A structure that holds a `Name` and `Data` is the signal of
//! that name.
//!
//! Some exporters store every variable twice, zeros first and data second (matio 1.5.2 as used by at least
//! one bench system). The *last* variable of a name that is not all zeros therefore wins ([`super::variables`]).

pub(super) mod version4;

use super::signals::Signals;
use super::variables::{Variable, signals};
use crate::budget::{self, VALUES};
use crate::{Error, Result, text};
use flate2::read::ZlibDecoder;
use std::path::Path;

const MATRIX: u32 = 14;
const COMPRESSED_DATA: u32 = 15;
/// Classes of arrays.
const CELL: u32 = 1;
const STRUCTURE: u32 = 2;
const TEXT: u32 = 4;
/// Structures within structures that are looked into.
const MAX_STRUCTURE_DEPTH: usize = 8;
/// Elements of structures and cells that are looked at.
const MOST_ELEMENTS: usize = 100_000;

/// Reads all numeric arrays.
pub(super) fn read(path: &Path, bytes: &[u8], stem: &str) -> Result<Signals> {
    let refuse = |what: &str| Error::invalid(path.display(), what);
    let big_endian = match bytes.get(126..128) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err(refuse("has no MAT-file header")),
    };
    let mut found = Found { path, big_endian, variables: Vec::new(), skipped: 0, values: 0, elements: 0 };
    let mut expanded = 0;
    let mut cursor = Cursor { bytes: &bytes[128..], big_endian };
    while !cursor.bytes.is_empty() {
        let element = cursor.element().ok_or_else(|| refuse("is truncated"))?;
        if element.kind != COMPRESSED_DATA {
            found.take(&element)?;
            continue;
        }
        let plain = budget::expand(path, "compressed array", ZlibDecoder::new(element.data), expanded)?;
        expanded += plain.len() as u64;
        let mut inner = Cursor { bytes: &plain, big_endian };
        found.take(&inner.element().ok_or_else(|| refuse("compressed array is truncated"))?)?;
    }
    signals(path, found.variables, found.skipped, stem)
}

/// What was found on the way through the variables.
struct Found<'a> {
    path: &'a Path,
    big_endian: bool,
    variables: Vec<Variable>,
    skipped: usize,
    values: usize,
    elements: usize,
}

impl Found<'_> {
    fn broken(&self) -> Error {
        Error::invalid(self.path.display(), "is truncated inside an array")
    }

    fn take(&mut self, element: &Element) -> Result<()> {
        if element.kind == MATRIX {
            return self.matrix(element.data, "", "", None, 0);
        }
        self.skipped += 1;
        Ok(())
    }

    /// An array in `folder`; `called` where what holds it knows its name.
    fn matrix(&mut self, bytes: &[u8], folder: &str, prefix: &str, called: Option<&str>, depth: usize) -> Result<()> {
        let head = Matrix::read(bytes, self.big_endian).ok_or_else(|| self.broken())?;
        let Some(head) = head else {
            self.skipped += 1;
            return Ok(());
        };
        let name = called.unwrap_or(&head.name).to_owned();
        let shown = format!("{prefix}{name}");
        match head.class {
            STRUCTURE if depth < MAX_STRUCTURE_DEPTH => self.structure(&head, &joined(folder, &name), &shown, depth),
            CELL if depth < MAX_STRUCTURE_DEPTH => self.cells(&head, &joined(folder, &name), &shown, depth),
            TEXT => {
                let text = head.text(self.big_endian);
                self.variables.push(Variable { folder: folder.into(), name, shown, text, ..Variable::default() });
                Ok(())
            }
            6..=15 => {
                let Some(stored) = head.stored(self.big_endian).ok_or_else(|| self.broken())? else {
                    self.skipped += 1;
                    return Ok(());
                };
                // Bytes become numbers of eight bytes: counted before they do.
                self.values += stored.rows * stored.columns;
                VALUES.check(self.path.display(), self.values as f64, "save fewer variables or shorter ones")?;
                let (rows, columns) = (stored.rows, stored.columns);
                let values = stored.values(self.big_endian).ok_or_else(|| self.broken())?;
                self.variables.push(Variable {
                    folder: folder.into(),
                    name,
                    shown,
                    rows,
                    columns,
                    values,
                    ..Variable::default()
                });
                Ok(())
            }
            _ => {
                self.skipped += 1;
                Ok(())
            }
        }
    }

    fn count(&mut self) -> Result<()> {
        self.elements += 1;
        if self.elements > MOST_ELEMENTS {
            return Err(Error::invalid(
                self.path.display(),
                format!("holds more than {MOST_ELEMENTS} fields and cells"),
            ));
        }
        Ok(())
    }

    fn structure(&mut self, head: &Matrix, folder: &str, shown: &str, depth: usize) -> Result<()> {
        let mut cursor = Cursor { bytes: head.rest, big_endian: self.big_endian };
        let length =
            cursor.element().and_then(|element| Cursor { bytes: element.data, big_endian: self.big_endian }.word(0));
        let length = length.filter(|length| (1..=256).contains(length)).ok_or_else(|| self.broken())? as usize;
        let names = cursor.element().ok_or_else(|| self.broken())?;
        let names: Vec<String> = names
            .data
            .chunks(length)
            .map(|name| text::name(&String::from_utf8_lossy(name.split(|b| *b == 0).next().unwrap_or_default())))
            .collect();
        let count = head.dims.iter().product::<usize>();
        for i in 0..count.min(MOST_ELEMENTS) {
            let (folder, shown) = if count > 1 {
                (format!("{folder}({})", i + 1), format!("{shown}({})", i + 1))
            } else {
                (folder.to_owned(), shown.to_owned())
            };
            let first = self.variables.len();
            for name in &names {
                self.count()?;
                let Some(field) = cursor.element() else { return Err(self.broken()) };
                // An empty field is an element without data.
                if field.kind == MATRIX && !field.data.is_empty() {
                    self.matrix(field.data, &folder, &format!("{shown}."), Some(name), depth + 1)?;
                }
            }
            self.name_the_data(first, &folder);
        }
        Ok(())
    }

    /// `Name` and `Data` side by side: the data have that name.
    fn name_the_data(&mut self, first: usize, folder: &str) {
        let own =
            |variable: &Variable, word: &str| variable.folder == folder && variable.name.eq_ignore_ascii_case(word);
        let name = self.variables[first..]
            .iter()
            .find(|variable| own(variable, "name"))
            .and_then(|variable| variable.text.clone());
        let Some(name) = name.filter(|name| !name.is_empty()) else { return };
        let words = ["data", "values", "value", "signal"];
        let data = self.variables[first..].iter_mut().find(|variable| words.iter().any(|word| own(variable, word)));
        if let Some(data) = data {
            data.name = text::name(&name);
            data.shown = text::name(&name);
        }
    }

    fn cells(&mut self, head: &Matrix, folder: &str, shown: &str, depth: usize) -> Result<()> {
        let mut cursor = Cursor { bytes: head.rest, big_endian: self.big_endian };
        for i in 0..head.dims.iter().product::<usize>() {
            self.count()?;
            let Some(cell) = cursor.element() else { return Err(self.broken()) };
            if cell.kind == MATRIX && !cell.data.is_empty() {
                let name = format!("{{{}}}", i + 1);
                self.matrix(cell.data, folder, shown, Some(&name), depth + 1)?;
            }
        }
        Ok(())
    }
}

fn joined(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") }
}

/// The head of an array and what follows it.
struct Matrix<'a> {
    class: u32,
    complex: bool,
    dims: Vec<usize>,
    name: String,
    rest: &'a [u8],
}

impl<'a> Matrix<'a> {
    /// `None` if truncated, `Some(None)` of an object, whose head is another one.
    fn read(bytes: &'a [u8], big_endian: bool) -> Option<Option<Self>> {
        let mut cursor = Cursor { bytes, big_endian };
        let flags = cursor.element()?;
        let flags = Cursor { bytes: flags.data, big_endian }.word(0)?;
        let (class, complex) = (flags & 0xff, flags & 0x0800 != 0);
        if !(1..=15).contains(&class) {
            return Some(None);
        }
        let dimensions = cursor.element()?;
        let name = cursor.element()?;
        let name = text::name(&String::from_utf8_lossy(name.data));
        let dims = Cursor { bytes: dimensions.data, big_endian };
        let dims = (0..dimensions.data.len() / 4)
            .map(|i| dims.word(4 * i).map(|word| word as usize))
            .collect::<Option<Vec<_>>>()?;
        let elements = dims.iter().try_fold(1_usize, |product, n| product.checked_mul(*n))?;
        // No element takes less than a byte: dimensions beyond the data are damage.
        (elements <= bytes.len()).then_some(Some(Self { class, complex, dims, name, rest: cursor.bytes }))
    }

    /// The numbers; `None` if truncated, `Some(None)` if they are complex or of more than two dimensions.
    fn stored(&self, big_endian: bool) -> Option<Option<Stored<'a>>> {
        if self.complex || self.class == 5 {
            return Some(None);
        }
        let [rows, columns] = self.dims[..] else { return Some(None) };
        let data = Cursor { bytes: self.rest, big_endian }.element()?;
        (rows * columns <= data.data.len() || rows * columns == 0).then_some(Some(Stored {
            rows,
            columns,
            kind: data.kind,
            data: data.data,
        }))
    }

    fn text(&self, big_endian: bool) -> Option<String> {
        let data = Cursor { bytes: self.rest, big_endian }.element()?;
        let codes: Vec<u16> = match data.kind {
            1 | 2 | 16 => data.data.iter().map(|b| u16::from(*b)).collect(),
            4 | 17 => {
                let pairs = data.data.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
                pairs.map(|pair| if big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }).collect()
            }
            _ => return None,
        };
        Some(text::name(&String::from_utf16_lossy(&codes)))
    }
}

/// A numeric array as it is stored.
struct Stored<'a> {
    rows: usize,
    columns: usize,
    kind: u32,
    data: &'a [u8],
}

impl Stored<'_> {
    /// Its values as f64; `None` if they are not as many as the dimensions say.
    fn values(self, big_endian: bool) -> Option<Vec<f64>> {
        let values = numbers(self.kind, self.data, big_endian)?;
        (self.rows * self.columns == values.len()).then_some(values)
    }
}

struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

struct Cursor<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn word(&self, at: usize) -> Option<u32> {
        let word: [u8; 4] = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    }

    /// The next data element; the cursor moves behind its padding.
    fn element(&mut self) -> Option<Element<'a>> {
        let first = self.word(0)?;
        if first >> 16 != 0 {
            // Small element: length in the upper half, data in the second word.
            let length = (first >> 16) as usize;
            let data = self.bytes.get(4..4 + length.min(4))?;
            self.bytes = self.bytes.get(8..)?;
            return Some(Element { kind: first & 0xffff, data });
        }
        let length = self.word(4)? as usize;
        let data = self.bytes.get(8..8_usize.checked_add(length)?)?;
        let padded = if first == COMPRESSED_DATA { length } else { length.next_multiple_of(8) };
        self.bytes = &self.bytes[(8 + padded).min(self.bytes.len())..];
        Some(Element { kind: first, data })
    }
}

fn numbers(kind: u32, data: &[u8], big_endian: bool) -> Option<Vec<f64>> {
    macro_rules! read {
        ($type:ty) => {
            data.chunks_exact(size_of::<$type>())
                .map(|c| {
                    let c = c.try_into().expect("chunks have the size of the type");
                    (if big_endian { <$type>::from_be_bytes(c) } else { <$type>::from_le_bytes(c) }) as f64
                })
                .collect()
        };
    }
    Some(match kind {
        1 => read!(i8),
        2 => read!(u8),
        3 => read!(i16),
        4 => read!(u16),
        5 => read!(i32),
        6 => read!(u32),
        7 => read!(f32),
        9 => read!(f64),
        12 => read!(i64),
        13 => read!(u64),
        _ => return None,
    })
}
