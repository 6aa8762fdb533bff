//! Damage to bytes and texts of any format: cut, extended, overwritten, exchanged, with numbers that are none.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Numbers and other texts that programs stumble over.
pub const NASTY_TEXTS: &[&str] = &[
    "nan",
    "NaN",
    "inf",
    "-inf",
    "infinity",
    "1e400",
    "-1e400",
    "1e308",
    "-1e308",
    "1e-308",
    "4.9e-324",
    "1e-400",
    "0",
    "-0",
    "-1",
    "+1",
    "00",
    "1.5",
    "0.5",
    ".5",
    "5.",
    "1e",
    "e5",
    "0x10",
    "1_000",
    "1,5",
    "1.000,5",
    "1e300",
    "9e18",
    "1e15",
    "2147483648",
    "4294967296",
    "4294967297",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "10001",
    "65536",
    "١٢",
    "½",
    "∞",
    "−1",
    "",
    " ",
    "-",
    "--",
    ".",
    "..",
    "/",
    "/dev/zero",
    "~",
    "*",
    "%s%n",
    "$(id)",
    "\"",
    "'",
    "\\",
    "\t",
    "a\nb",
    "\u{1b}[31mred",
    "\u{0}",
    "\u{202e}txt",
    "true",
    "null",
    "None",
    "word",
];

/// Damages text or binary bytes in one way; gives the name of the way.
pub fn damage(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) -> String {
    type Way = fn(&mut Vec<u8>, &mut ChaCha8Rng);
    let ways: &[(&str, Way)] = &[
        ("cut", |b, r| b.truncate(r.random_range(0..=b.len()))),
        ("cut by one byte", |b, _| b.truncate(b.len().saturating_sub(1))),
        ("beginning lost", |b, r| drop(b.drain(..r.random_range(0..=b.len().min(300))))),
        ("empty", |b, _| b.clear()),
        ("one bit", |b, r| flip(b, r, 1)),
        ("twenty bits", |b, r| flip(b, r, 20)),
        ("one bit of the first 200 bytes", |b, r| {
            let mut head: Vec<u8> = b.drain(..b.len().min(200)).collect();
            flip(&mut head, r, 1);
            b.splice(0..0, head);
        }),
        ("zeros inside", |b, r| fill(b, r, 0)),
        ("ones inside", |b, r| fill(b, r, 0xff)),
        ("line feeds inside", |b, r| fill(b, r, b'\n')),
        ("random bytes at the end", |b, r| {
            let count = r.random_range(1..2000);
            b.extend((0..count).map(|_| r.random::<u8>()));
        }),
        ("random bytes inside", |b, r| {
            let at = r.random_range(0..=b.len());
            let more: Vec<u8> = (0..r.random_range(1..200)).map(|_| r.random::<u8>()).collect();
            b.splice(at..at, more);
        }),
        ("only random bytes", |b, r| b.iter_mut().for_each(|byte| *byte = r.random())),
        ("twice", |b, _| b.extend_from_within(..)),
        ("halves exchanged", |b, _| {
            let half = b.len() / 2;
            b.rotate_left(half);
        }),
        ("in UTF-16", |b, _| *b = b.iter().flat_map(|&byte| [byte, 0]).collect()),
        ("a byte order mark", |b, _| drop(b.splice(0..0, [0xef, 0xbb, 0xbf]))),
        ("an HTML page", |b, _| *b = b"<!DOCTYPE html><html><body>404 Not Found</body></html>\n".to_vec()),
        ("one long line", |b, _| b.retain(|byte| *byte != b'\n')),
    ];
    let (name, way) = ways[random.random_range(0..ways.len())];
    way(bytes, random);
    name.to_owned()
}

fn flip(bytes: &mut [u8], random: &mut ChaCha8Rng, count: usize) {
    for _ in 0..count.min(8 * bytes.len()) {
        let at = random.random_range(0..bytes.len());
        bytes[at] ^= 1 << random.random_range(0..8);
    }
}

fn fill(bytes: &mut [u8], random: &mut ChaCha8Rng, value: u8) {
    let from = random.random_range(0..=bytes.len());
    let to = (from + random.random_range(0..400)).min(bytes.len());
    bytes[from..to].fill(value);
}

/// Damages a text of lines and cells in one way; gives the name of the way.
pub fn damage_text(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) -> String {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    if lines.is_empty() {
        lines.push(String::new());
    }
    // The first lines carry what the rest is read by.
    let last = if random.random() { lines.len().min(4) } else { lines.len() };
    let at = random.random_range(0..last);
    let made;
    let name = match random.random_range(0..12) {
        0 => {
            lines.remove(at);
            "a line lost"
        }
        1 => {
            lines.insert(at, lines[at].clone());
            "a line twice"
        }
        2 => {
            lines.swap(at, last - 1);
            "two lines exchanged"
        }
        3 => {
            lines[at].push_str(",1");
            "a cell too many"
        }
        4 => {
            lines[at].clear();
            "an empty line"
        }
        5 => {
            lines.iter_mut().for_each(|line| *line = line.replace('.', ","));
            "decimal commas"
        }
        6 => {
            lines.iter_mut().for_each(|line| *line = line.replace(',', ";"));
            "semicolons"
        }
        7 => {
            lines[at].insert(0, '"');
            "an open quote"
        }
        8 => {
            lines[at] = "#".repeat(200_000);
            "a line of 200 kB"
        }
        9 => {
            lines[at].insert_str(0, "0x");
            "a letter in a number"
        }
        _ => {
            let nasty = NASTY_TEXTS[random.random_range(0..NASTY_TEXTS.len())];
            let mut cells: Vec<&str> = lines[at].split(',').collect();
            let chosen = random.random_range(0..cells.len());
            cells[chosen] = nasty;
            lines[at] = cells.join(",");
            made = format!("a cell {nasty:?}");
            &made
        }
    };
    *bytes = (lines.join("\n") + "\n").into_bytes();
    format!("line {}: {name}", at + 1)
}

/// Damages the header of a NumPy file in one way, keeping its length where that is not the damage.
pub fn damage_npy(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) -> String {
    const SHAPES: &[&str] = &[
        "(0, 2)",
        "(2, 0)",
        "()",
        "(1,)",
        "(1, 2)",
        "(2, 2048)",
        "(4096,)",
        "(2048, 2, 1)",
        "(-1, 2)",
        "(99999, 2)",
        "(18446744073709551615, 2)",
        "(9223372036854775807, 9223372036854775807)",
        "(1e3, 2)",
        "(2048, 2",
        "[2048, 2]",
        "(4294967296, 4294967296)",
    ];
    const TYPES: &[&str] =
        &["<i4", ">i2", "<f8", "<f4", "|i1", "|u1", "|O", "<U8", "<c16", "|b1", "<f2", "<i16", "", "<i"];
    let header_end = bytes.iter().position(|&byte| byte == b'\n').map_or(0, |at| at + 1);
    let header = String::from_utf8_lossy(&bytes[10.min(header_end)..header_end]).into_owned();
    let between = |from: &str, to: char, new: &str| {
        let start = header.find(from)? + from.len();
        let end = start + header[start..].find(to)? + usize::from(to == ')');
        Some(format!("{}{new}{}", &header[..start], &header[end..]))
    };
    let (name, new) = match random.random_range(0..6) {
        0 | 1 => {
            let shape = SHAPES[random.random_range(0..SHAPES.len())];
            (format!("shape {shape}"), between("'shape': ", ')', shape))
        }
        2 | 3 => {
            let kind = TYPES[random.random_range(0..TYPES.len())];
            (format!("type {kind:?}"), between("'descr': '", '\'', kind))
        }
        4 => ("Fortran order".to_owned(), Some(header.replace("False", "True "))),
        _ => {
            let at = random.random_range(6..10.min(bytes.len()).max(7));
            if let Some(byte) = bytes.get_mut(at) {
                *byte = random.random();
            }
            return format!("header byte {at}");
        }
    };
    let mut new = new.unwrap_or(header).trim_end().to_owned();
    while (new.len() + 11) % 64 != 0 {
        new.push(' ');
    }
    new.push('\n');
    let mut whole = b"\x93NUMPY\x01\x00".to_vec();
    whole.extend((new.len() as u16).to_le_bytes());
    whole.extend(new.as_bytes());
    whole.extend_from_slice(&bytes[header_end..]);
    *bytes = whole;
    name
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn theory_damage_depends_on_the_seed_alone_and_mostly_changes_the_bytes() {
        type Way = fn(&mut Vec<u8>, &mut ChaCha8Rng) -> String;
        let ways: [(&str, Way); 3] = [("bytes", damage), ("text", damage_text), ("npy", damage_npy)];
        for (name, way) in ways {
            let sound =
                b"\x93NUMPY\x01\x00\x76\x00{'descr': '<i2', 'fortran_order': False, 'shape': (2, 2), }\n1,2\n3.5,4\n";
            let made = |seed| {
                let mut bytes = sound.to_vec();
                let what = way(&mut bytes, &mut ChaCha8Rng::seed_from_u64(seed));
                (what, bytes)
            };
            assert!((0..300).all(|seed| made(seed) == made(seed)));
            let changed = (0..300).filter(|&seed| made(seed).1 != sound).count();
            assert!(changed > 270, "{name}: {changed} of 300");
        }
    }
}
