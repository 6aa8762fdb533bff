//! Bytes as text: UTF-8 with or without a mark, UTF-16 of either byte order, else the Windows code page 1252.
//!
//! Every byte is some sign of code page 1252, so what holds control characters is no text of it: binary data stay
//! refused.

use crate::{Error, Result};
use std::path::Path;

/// Signs of the code page at 0x80 to 0x9f; the others are those of Latin 1.
const SIGNS: &str = "\u{20ac}\u{81}\u{201a}\u{192}\u{201e}\u{2026}\u{2020}\u{2021}\u{2c6}\u{2030}\u{160}\u{2039}\
 \u{152}\u{8d}\u{17d}\u{8f}\u{90}\u{2018}\u{2019}\u{201c}\u{201d}\u{2022}\u{2013}\u{2014}\u{2dc}\u{2122}\u{161}\
 \u{203a}\u{153}\u{9d}\u{17e}\u{178}";
/// Bytes that are looked at to tell UTF-16 without a mark.
const PROBE: usize = 512;

/// The content as text, with a remark where it is not UTF-8.
///
/// # Errors
/// Control characters, or half a sign of UTF-16.
pub(in crate::import) fn decode(path: &Path, bytes: Vec<u8>) -> Result<(String, Option<&'static str>)> {
    let refuse = |what: &str| Error::invalid(path.display(), what);
    let wide = match bytes.as_slice() {
        [0xff, 0xfe, rest @ ..] => Some((rest, false)),
        [0xfe, 0xff, rest @ ..] => Some((rest, true)),
        _ => unmarked(&bytes),
    };
    if let Some((rest, big_endian)) = wide {
        let unit = |pair: &[u8]| {
            let pair = [pair[0], pair[1]];
            if big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
        };
        let units: Vec<u16> = rest.chunks_exact(2).map(unit).collect();
        let text = String::from_utf16(&units).map_err(|_| refuse("is not text (damaged UTF-16)"))?;
        return Ok((text, Some("is UTF-16")));
    }
    match String::from_utf8(bytes) {
        Ok(text) if text.contains('\0') => Err(refuse("is not text")),
        Ok(mut text) => {
            if text.starts_with('\u{feff}') {
                text.drain(..'\u{feff}'.len_utf8());
            }
            Ok((text, None))
        }
        Err(error) => {
            let bytes = error.into_bytes();
            if bytes.iter().any(|b| *b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0c | 0x1a)) {
                return Err(refuse("is not text"));
            }
            let signs: Vec<char> = SIGNS.chars().collect();
            let sign = |b: &u8| if (0x80..0xa0).contains(b) { signs[usize::from(*b - 0x80)] } else { char::from(*b) };
            Ok((bytes.iter().map(sign).collect(), Some("is not UTF-8 and is read as Windows code page 1252")))
        }
    }
}

/// UTF-16 without a mark: every other byte of plain letters and digits is nothing.
fn unmarked(bytes: &[u8]) -> Option<(&[u8], bool)> {
    let probe = &bytes[..bytes.len().min(PROBE) & !1];
    let nothing = |odd: usize| probe.iter().skip(odd).step_by(2).all(|b| *b == 0);
    let something = |odd: usize| !probe.is_empty() && probe.iter().skip(odd).step_by(2).all(|b| *b != 0);
    if nothing(1) && something(0) {
        return Some((bytes, false));
    }
    (nothing(0) && something(1)).then_some((bytes, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(bytes: &[u8]) -> Option<String> {
        decode(Path::new("a"), bytes.to_vec()).ok().map(|decoded| decoded.0)
    }

    #[test]
    fn theory_text_is_told_from_its_bytes() {
        assert_eq!(text(b"m/s\xb2").as_deref(), Some("m/s\u{b2}"));
        assert_eq!(text(b"\xef\xbb\xbfa").as_deref(), Some("a"));
        assert_eq!(text(b"\xff\xfea\0b\0").as_deref(), Some("ab"));
        assert_eq!(text(b"\0a\0b").as_deref(), Some("ab"));
        assert_eq!(text(b"\x80\x01\x99"), None);
        assert_eq!(text(b"abc\0\0def"), None);
    }
}
