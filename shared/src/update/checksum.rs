//! CRC-32 (ISO-HDLC) of whole images, four bytes at a time: the loader computes it at every start, at 16 MHz.
//!
//! The same sum as that of frames ([`crate::frame::CRC32`]), by Kounavis and Berry's slicing ("A systematic approach
//! to building high performance, software-based, CRC generators", 2005): three instructions per byte instead of
//! seven, for 4 KiB of tables. Only the loader pays for them; the node, which checks an image once, uses the frames'
//! table.

const POLYNOMIAL: u32 = 0xedb8_8320;

static TABLES: [[u32; 256]; 4] = tables();

const fn tables() -> [[u32; 256]; 4] {
    let mut tables = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 256 {
        let (mut sum, mut bit) = (byte as u32, 0);
        while bit < 8 {
            sum = if sum & 1 != 0 { sum >> 1 ^ POLYNOMIAL } else { sum >> 1 };
            bit += 1;
        }
        tables[0][byte] = sum;
        byte += 1;
    }
    let mut slice = 1;
    while slice < 4 {
        let mut byte = 0;
        while byte < 256 {
            let former = tables[slice - 1][byte];
            tables[slice][byte] = former >> 8 ^ tables[0][former as usize & 0xff];
            byte += 1;
        }
        slice += 1;
    }
    tables
}

/// The sum of all bytes.
pub fn of_image(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks::<4>();
    let look = |slice: usize, byte: u32| TABLES[slice][usize::from(byte as u8)];
    let sum = words.iter().fold(u32::MAX, |sum, word| {
        let mixed = sum ^ u32::from_le_bytes(*word);
        look(3, mixed) ^ look(2, mixed >> 8) ^ look(1, mixed >> 16) ^ look(0, mixed >> 24)
    });
    !rest.iter().fold(sum, |sum, &byte| sum >> 8 ^ look(0, sum ^ u32::from(byte)))
}
