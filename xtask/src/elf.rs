//! Sizes of an ELF image, as `size` counts them: enough of ELF32 to read section headers, nothing more.

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

const SHF_WRITE: u32 = 1;
const SHF_ALLOC: u32 = 2;
const SHT_NOBITS: u32 = 8;

/// Reads the section headers of a little-endian ELF32 file.
pub fn sizes(path: &Path) -> Result<Sizes, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    parse(&bytes).ok_or_else(|| format!("{}: not a little-endian ELF32 file", path.display()))
}

fn parse(bytes: &[u8]) -> Option<Sizes> {
    if bytes.get(..6)? != [0x7f, b'E', b'L', b'F', 1, 1] {
        return None;
    }
    let table = word(bytes, 0x20)? as usize;
    let entry = half(bytes, 0x2e)? as usize;
    let count = half(bytes, 0x30)? as usize;
    let mut sizes = Sizes::default();
    for i in 0..count {
        let header = bytes.get(table + i * entry..)?;
        let (kind, flags, size) = (word(header, 4)?, word(header, 8)?, u64::from(word(header, 20)?));
        if flags & SHF_ALLOC == 0 {
            continue;
        }
        match (flags & SHF_WRITE != 0, kind == SHT_NOBITS) {
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
}
