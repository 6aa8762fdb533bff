//! MATLAB version 4 files: full real matrices, each behind a head of five integers.
//!
//! Source: MathWorks, "MAT-File Format", level 4. The file has no magic number: its first head has to make sense.

use crate::budget::VALUES;
use crate::import::signals::Signals;
use crate::import::variables::{Variable, signals};
use crate::{Error, Result, text};
use std::path::Path;

/// Bytes of a head.
const HEAD: usize = 20;
/// Longest name.
const LONGEST_NAME: usize = 64;

/// One matrix's head.
struct Head {
    big_endian: bool,
    /// 0 to 5: double, single, int32, int16, uint16, uint8.
    precision: u32,
    /// 0 full, 1 text, 2 sparse.
    kind: u32,
    rows: usize,
    columns: usize,
    complex: bool,
    name: usize,
}

impl Head {
    fn read(bytes: &[u8]) -> Option<Self> {
        let head: &[u8] = bytes.get(..HEAD)?;
        let of = |at: usize, big: bool| {
            let word = [head[at], head[at + 1], head[at + 2], head[at + 3]];
            if big { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
        };
        // A type beyond four digits is one of the other byte order.
        let big_endian = of(0, false) > 9999;
        let kind = of(0, big_endian);
        let (machine, precision, matrix) = (kind / 1000, kind / 10 % 10, kind % 10);
        let name = of(16, big_endian) as usize;
        let sound =
            kind <= 9999 && machine == u32::from(big_endian) && kind / 100 % 10 == 0 && precision <= 5 && matrix <= 2;
        let complex = of(12, big_endian);
        if !sound || complex > 1 || !(2..=LONGEST_NAME).contains(&name) {
            return None;
        }
        let (rows, columns) = (of(4, big_endian) as usize, of(8, big_endian) as usize);
        Some(Self { big_endian, precision, kind: matrix, rows, columns, complex: complex == 1, name })
    }

    fn size(&self) -> usize {
        [8, 4, 4, 2, 2, 1][self.precision as usize]
    }
}

/// Whether bytes begin as a file of version 4.
pub(in crate::import) fn looks_like(bytes: &[u8], called_mat: bool) -> bool {
    let Some(head) = Head::read(bytes) else { return false };
    let name = bytes.get(HEAD..HEAD + head.name).unwrap_or_default();
    let sound =
        name.last() == Some(&0) && name[..head.name - 1].iter().all(|b| b.is_ascii_alphanumeric() || *b == b'_');
    sound && (called_mat || head.rows > 0)
}

pub(in crate::import) fn read(path: &Path, bytes: &[u8], stem: &str) -> Result<Signals> {
    let refuse = |what: &str| Error::invalid(path.display(), what);
    let (mut rest, mut variables, mut skipped, mut count) = (bytes, Vec::new(), 0, 0_usize);
    while !rest.is_empty() {
        let head = Head::read(rest).ok_or_else(|| refuse("is a damaged MATLAB version 4 file"))?;
        let values = head.rows.checked_mul(head.columns);
        let parts = if head.complex { 2 } else { 1 };
        let length = values.and_then(|values| values.checked_mul(head.size() * parts));
        let body = rest.get(HEAD + head.name..).zip(length).and_then(|(body, length)| body.get(..length));
        let body = body.ok_or_else(|| refuse("is a truncated MATLAB version 4 file"))?;
        let name = text::name(&String::from_utf8_lossy(&rest[HEAD..HEAD + head.name - 1]));
        rest = &rest[HEAD + head.name + body.len()..];
        if head.kind == 2 || head.complex {
            skipped += 1;
            continue;
        }
        count += values.unwrap_or(0);
        VALUES.check(path.display(), count as f64, "save fewer variables or shorter ones")?;
        let values: Vec<f64> = body.chunks_exact(head.size()).map(|cell| number(&head, cell)).collect();
        let text = (head.kind == 1).then(|| values.iter().filter_map(|x| char::from_u32(*x as u32)).collect());
        let values = if head.kind == 1 { Vec::new() } else { values };
        variables.push(Variable {
            shown: name.clone(),
            name,
            rows: head.rows,
            columns: head.columns,
            values,
            text,
            ..Variable::default()
        });
    }
    signals(path, variables, skipped, stem)
}

fn number(head: &Head, cell: &[u8]) -> f64 {
    let mut bytes = [0_u8; 8];
    bytes[..cell.len()].copy_from_slice(cell);
    if head.big_endian {
        bytes[..cell.len()].reverse();
    }
    let four = [bytes[0], bytes[1], bytes[2], bytes[3]];
    match head.precision {
        0 => f64::from_le_bytes(bytes),
        1 => f64::from(f32::from_le_bytes(four)),
        2 => f64::from(i32::from_le_bytes(four)),
        3 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        4 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => f64::from(bytes[0]),
    }
}
