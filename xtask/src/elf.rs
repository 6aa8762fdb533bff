//! Sizes of an ELF image, as `size` counts them, the places in the source from which it can panic, and its code by
//! functions: enough of ELF32 to read section headers and symbols, nothing more.
//!
//! Every panic carries a `core::panic::Location`: pointer and length of the file's name, line, column. Whatever the
//! optimiser proved impossible has lost its location too, so the locations left in the image's constants are the
//! panics left, however much was inlined. A panic without a location (an `unwind` out of a `nounwind` function) would
//! not be found; with `panic = "abort"` there are none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Bytes a linked image needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sizes {
    /// Code and constants, in flash.
    pub text: u64,
    /// Initialised variables, in flash and RAM.
    pub data: u64,
    /// Zeroed variables, in RAM.
    pub bss: u64,
}

impl Sizes {
    /// Bytes of flash the image occupies.
    pub fn flash(self) -> u64 {
        self.text + self.data
    }

    /// Bytes of RAM without the stack.
    pub fn ram(self) -> u64 {
        self.data + self.bss
    }
}

/// A place in the source that can panic.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct PanicSite {
    /// File: relative to the workspace for own code, `crate-version/...` for a dependency, `core/...` for the library.
    pub file: String,
    /// Line in it.
    pub line: u32,
    /// Column in it.
    pub column: u32,
}

impl PanicSite {
    /// Whether the place is in a crate of this workspace.
    pub fn is_own(&self) -> bool {
        self.file.starts_with("shared/") || self.file.starts_with("firmware/")
    }
}

/// The places an image can panic from.
pub fn panic_sites(path: &Path) -> Result<BTreeSet<PanicSite>, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    find_panic_sites(&bytes).ok_or_else(|| format!("{}: not a little-endian ELF32 file", path.display()))
}

fn find_panic_sites(bytes: &[u8]) -> Option<BTreeSet<PanicSite>> {
    let loaded: Vec<(u32, &[u8])> = sections(bytes)?
        .filter(|section| section.flags & SHF_ALLOC != 0 && section.kind != SHT_NOBITS)
        .filter_map(|section| Some((section.address, bytes.get(section.offset..section.offset + section.size)?)))
        .collect();
    let text = |pointer: u32, length: u32| {
        loaded.iter().find_map(|(address, data)| {
            let start = pointer.checked_sub(*address)? as usize;
            data.get(start..start.checked_add(length as usize)?)
        })
    };
    let mut sites = BTreeSet::new();
    for (_, data) in &loaded {
        for at in (0..data.len().saturating_sub(15)).step_by(4) {
            let [pointer, length, line, column] = [0, 4, 8, 12].map(|offset| word(data, at + offset).unwrap_or(0));
            let plausible = (4..400).contains(&length) && (1..100_000).contains(&line) && (1..1000).contains(&column);
            if let Some(name) = plausible.then(|| text(pointer, length)).flatten()
                && name.ends_with(b".rs")
                && name.iter().all(|c| (b' '..0x7f).contains(c))
            {
                sites.insert(PanicSite { file: shorten(&String::from_utf8_lossy(name)), line, column });
            }
        }
    }
    Some(sites)
}

/// A path without what differs from one machine to the next.
fn shorten(path: &str) -> String {
    let path = path.replace('\\', "/");
    if let Some((_, rest)) = path.split_once("/registry/src/") {
        return rest.split_once('/').map_or(rest, |(_, rest)| rest).to_owned();
    }
    path.split_once("/library/").map_or(path.as_str(), |(_, rest)| rest).to_owned()
}

/// A function in an image's symbol table.
#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// First instruction.
    pub address: u32,
    /// Bytes, constants between the instructions included.
    pub size: u32,
}

/// An image's memory and symbols.
#[derive(Debug, Default)]
pub struct Image<'a> {
    /// Addresses and contents of what is loaded, the vector table first.
    pub loaded: Vec<(u32, &'a [u8])>,
    /// Functions.
    pub functions: Vec<Function>,
    /// Where constants begin and where code goes on, ascending.
    pub borders: Vec<(u32, bool)>,
    /// Values of symbols.
    pub names: BTreeMap<&'a str, u32>,
}

impl<'a> Image<'a> {
    /// Reads sections and symbols; `None` for what is no ELF32 image with symbols.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let all: Vec<Section> = sections(bytes)?.collect();
        let contents = |section: &Section| bytes.get(section.offset..section.offset + section.size);
        let mut image = Self::default();
        for section in all.iter().filter(|s| s.flags & SHF_ALLOC != 0 && s.kind != SHT_NOBITS && s.size > 0) {
            image.loaded.push((section.address, contents(section)?));
        }
        image.loaded.sort_by_key(|(address, _)| *address);
        let table = all.iter().find(|section| section.kind == SHT_SYMTAB)?;
        let names = contents(all.get(table.link as usize)?)?;
        for symbol in contents(table)?.chunks_exact(16) {
            let (value, size, kind) = (word(symbol, 4)?, word(symbol, 8)?, symbol[12] & 15);
            let name = names.get(word(symbol, 0)? as usize..)?.split(|&byte| byte == 0).next()?;
            let name = std::str::from_utf8(name).ok()?;
            match name.get(..2) {
                Some("$d") => image.borders.push((value, false)),
                Some("$t") => image.borders.push((value, true)),
                _ => drop(image.names.insert(name, value)),
            }
            if kind == STT_FUNC && size > 0 {
                image.functions.push(Function { address: value & !1, size });
            }
        }
        // Where both stand at one address, code it is.
        image.borders.sort_unstable();
        Some(image)
    }

    /// Value of a symbol.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.names.get(name).copied()
    }

    /// Half-word at an address.
    pub fn half(&self, address: u32) -> Option<u32> {
        self.loaded.iter().find_map(|(start, data)| half(data, address.checked_sub(*start)? as usize)).map(u32::from)
    }

    /// Where code goes on, if there are constants at an address.
    pub fn data_end(&self, address: u32) -> Option<u32> {
        let next = self.borders.partition_point(|(at, _)| *at <= address);
        let (_, is_code) = self.borders.get(next.checked_sub(1)?)?;
        let after = || self.borders[next..].iter().find(|(_, is_code)| *is_code).map_or(u32::MAX, |(at, _)| *at);
        (!is_code).then(after)
    }

    /// The vector table.
    pub fn vectors(&self) -> impl Iterator<Item = u32> {
        words(self.loaded.first().map_or(&[], |(_, data)| data))
    }

    /// Everything outside the vector table that looks like the address of a function.
    pub fn pointers(&self) -> impl Iterator<Item = u32> {
        self.loaded.iter().skip(1).flat_map(|(_, data)| words(data)).filter(|word| word & 1 != 0).map(|word| word & !1)
    }
}

fn words(data: &[u8]) -> impl Iterator<Item = u32> {
    data.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes))
}

struct Section {
    kind: u32,
    flags: u32,
    address: u32,
    offset: usize,
    size: usize,
    link: u32,
}

fn sections(bytes: &[u8]) -> Option<impl Iterator<Item = Section>> {
    if bytes.get(..6)? != [0x7f, b'E', b'L', b'F', 1, 1] {
        return None;
    }
    let table = word(bytes, 0x20)? as usize;
    let entry = half(bytes, 0x2e)? as usize;
    let count = half(bytes, 0x30)? as usize;
    let sections: Option<Vec<Section>> = (0..count)
        .map(|i| {
            let header = bytes.get(table + i * entry..)?;
            Some(Section {
                kind: word(header, 4)?,
                flags: word(header, 8)?,
                address: word(header, 12)?,
                offset: word(header, 16)? as usize,
                size: word(header, 20)? as usize,
                link: word(header, 24)?,
            })
        })
        .collect();
    sections.map(Vec::into_iter)
}

/// What is programmed, with its addresses in flash: of initialised variables the place that start-up copies them from.
pub fn segments(bytes: &[u8]) -> Option<Vec<(u32, &[u8])>> {
    const LOAD: u32 = 1;
    if bytes.get(..6)? != [0x7f, b'E', b'L', b'F', 1, 1] {
        return None;
    }
    let (table, entry, count) = (word(bytes, 0x1c)? as usize, half(bytes, 0x2a)? as usize, half(bytes, 0x2c)? as usize);
    let mut segments = Vec::new();
    for header in (0..count).map(|n| table + n * entry) {
        let (offset, size) = (word(bytes, header + 4)? as usize, word(bytes, header + 16)? as usize);
        if word(bytes, header)? == LOAD && size > 0 {
            segments.push((word(bytes, header + 12)?, bytes.get(offset..offset + size)?));
        }
    }
    Some(segments)
}

const SHF_WRITE: u32 = 1;
const SHF_ALLOC: u32 = 2;
const SHT_SYMTAB: u32 = 2;
const SHT_NOBITS: u32 = 8;
const STT_FUNC: u8 = 2;

/// Reads the section headers of a little-endian ELF32 file.
pub fn sizes(path: &Path) -> Result<Sizes, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    parse(&bytes).ok_or_else(|| format!("{}: not a little-endian ELF32 file", path.display()))
}

fn parse(bytes: &[u8]) -> Option<Sizes> {
    let mut sizes = Sizes::default();
    for section in sections(bytes)?.filter(|section| section.flags & SHF_ALLOC != 0) {
        let size = section.size as u64;
        match (section.flags & SHF_WRITE != 0, section.kind == SHT_NOBITS) {
            (_, true) => sizes.bss += size,
            (true, false) => sizes.data += size,
            (false, false) => sizes.text += size,
        }
    }
    Some(sizes)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_sections_add_up_and_rubbish_is_refused() {
        let mut image = vec![0u8; 0x34 + 4 * 40];
        image[..6].copy_from_slice(&[0x7f, b'E', b'L', b'F', 1, 1]);
        image[0x20] = 0x34;
        image[0x2e] = 40;
        image[0x30] = 4;
        let sections =
            [(1, SHF_ALLOC, 100), (1, SHF_ALLOC | SHF_WRITE, 20), (SHT_NOBITS, SHF_ALLOC | SHF_WRITE, 3), (1, 0, 9)];
        for (i, (kind, flags, size)) in sections.into_iter().enumerate() {
            let at = 0x34 + i * 40;
            for (offset, value) in [(4, kind), (8, flags), (20, size)] {
                image[at + offset..at + offset + 4].copy_from_slice(&u32::to_le_bytes(value));
            }
        }
        assert_eq!(parse(&image), Some(Sizes { text: 100, data: 20, bss: 3 }));
        assert_eq!(parse(&image[..80]), None);
        assert_eq!(parse(b"MZ"), None);
    }

    #[test]
    fn theory_a_location_in_the_constants_is_a_panic_site() {
        let name = b"/home/x/.cargo/registry/src/index-1/cobs-0.5.1/src/dec.rs";
        let mut constants = name.to_vec();
        constants.resize(constants.len().next_multiple_of(4), 0);
        for value in [0x0800_0000, name.len() as u32, 12, 7] {
            constants.extend(u32::to_le_bytes(value));
        }
        // Looks like one, but the text is not where it points.
        for value in [0x0900_0000, name.len() as u32, 13, 7] {
            constants.extend(u32::to_le_bytes(value));
        }
        let mut image = vec![0u8; 0x34 + 40];
        image[..6].copy_from_slice(&[0x7f, b'E', b'L', b'F', 1, 1]);
        (image[0x20], image[0x2e], image[0x30]) = (0x34, 40, 1);
        let start = image.len();
        let header = [(4, 1), (8, SHF_ALLOC), (12, 0x0800_0000), (16, start as u32), (20, constants.len() as u32)];
        for (offset, value) in header {
            image[0x34 + offset..0x34 + offset + 4].copy_from_slice(&u32::to_le_bytes(value));
        }
        image.extend(&constants);
        let found = find_panic_sites(&image).unwrap();
        let expected = PanicSite { file: "cobs-0.5.1/src/dec.rs".into(), line: 12, column: 7 };
        assert_eq!(found.into_iter().collect::<Vec<_>>(), [expected]);
        assert_eq!(shorten("shared/src/tach.rs"), "shared/src/tach.rs");
        assert_eq!(shorten("/rustc/59807/library/core/src/num/mod.rs"), "core/src/num/mod.rs");
        let own = |file: &str| PanicSite { file: file.into(), line: 1, column: 1 }.is_own();
        assert!(own("shared/src/tach.rs") && own("firmware/src/runner.rs") && !own("cobs-0.5.1/src/dec.rs"));
    }
}
