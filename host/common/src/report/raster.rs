//! A bitmap inside a page: PNG (deflate of `flate2`, its CRC) as a data URI.
//!
//! Why not vector shapes: a map of 100,000 cells is 12 MB of SVG and 100 kB of PNG. Only what a map needs: 8-bit RGB,
//! no filter, one IDAT. Source: PNG specification, third edition (W3C 2025); RFC 4648 for base64.

use crate::{Error, Result};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write;

/// The bitmap of `width` x `height` pixels, first row on top, as a data URI.
///
/// # Errors
/// A compressor that fails, which on memory it does not.
pub fn data_uri(width: u32, height: u32, pixels: impl Iterator<Item = [u8; 3]>) -> Result<String> {
    let mut rows = Vec::with_capacity((width as usize * 3 + 1) * height as usize);
    for (i, pixel) in pixels.enumerate() {
        if i % width as usize == 0 {
            // Filter type of the row: none.
            rows.push(0);
        }
        rows.extend(pixel);
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let compressed = encoder.write_all(&rows).and_then(|()| encoder.finish());
    let compressed = compressed.map_err(|error| Error::impossible("picture", error))?;
    let mut header = Vec::new();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    // Eight bits of red, green and blue; deflate, no filter method but 0, not interlaced.
    header.extend([8, 2, 0, 0, 0]);
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    chunk(&mut png, b"IHDR", &header);
    chunk(&mut png, b"IDAT", &compressed);
    chunk(&mut png, b"IEND", &[]);
    Ok(format!("data:image/png;base64,{}", base64(&png)))
}

fn chunk(png: &mut Vec<u8>, kind: &[u8; 4], content: &[u8]) {
    let mut crc = flate2::Crc::new();
    crc.update(kind);
    crc.update(content);
    png.extend((content.len() as u32).to_be_bytes());
    png.extend(kind);
    png.extend(content);
    png.extend(crc.sum().to_be_bytes());
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for part in bytes.chunks(3) {
        let group = (0..3).fold(0_u32, |group, i| group << 8 | u32::from(part.get(i).copied().unwrap_or(0)));
        for i in 0..4 {
            let digit = char::from(DIGITS[(group >> (18 - 6 * i) & 63) as usize]);
            out.push(if i <= part.len() { digit } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn ref_base64_as_in_rfc_4648() {
        for (text, expected) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }

    #[test]
    fn ref_a_png_holds_its_rows_and_the_known_end() {
        let mut png = Vec::new();
        chunk(&mut png, b"IEND", &[]);
        // The end of every PNG file.
        assert_eq!(png, [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82]);
        let uri = data_uri(2, 1, [[1, 2, 3], [4, 5, 6]].into_iter()).unwrap();
        assert!(uri.starts_with("data:image/png;base64,iVBORw0KGgoAAAANSUhEUg"));
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&[0, 1, 2, 3, 4, 5, 6]).unwrap();
        let mut rows = Vec::new();
        flate2::read::ZlibDecoder::new(encoder.finish().unwrap().as_slice()).read_to_end(&mut rows).unwrap();
        assert_eq!(rows, [0, 1, 2, 3, 4, 5, 6]);
    }
}
