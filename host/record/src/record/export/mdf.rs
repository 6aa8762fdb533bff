//! A run as an ASAM MDF 4.10 file: one group of doubles whose time is the record's number times the interval.

use super::File;

/// Place of the file's header block, and its length.
const HEADER: usize = 64;
const HEADER_LENGTH: usize = 104;
/// Bytes of a block's head.
const HEAD: usize = 24;
/// Stored as: unsigned integer, double; little-endian.
const UNSIGNED_INTEGER: u8 = 0;
const DOUBLE: u8 = 4;
/// A channel that is its group's time and stored nowhere; a channel of fixed length.
const VIRTUAL_TIME: u8 = 3;
const FIXED_LENGTH: u8 = 0;

/// Blocks as they are appended, leaves before what links to them.
struct Blocks {
    bytes: Vec<u8>,
}

impl Blocks {
    fn new() -> Self {
        let mut bytes = b"MDF     4.10    meshband".to_vec();
        bytes.extend([0; 4]);
        bytes.extend(410_u16.to_le_bytes());
        bytes.resize(HEADER + HEADER_LENGTH, 0);
        Self { bytes }
    }

    /// Appends a block and gives its place.
    fn add(&mut self, name: [u8; 2], links: &[u64], data: &[u8]) -> u64 {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        let at = self.bytes.len() as u64;
        self.bytes.extend(block(name, links, data));
        at
    }

    fn text(&mut self, name: [u8; 2], text: &str) -> u64 {
        let mut data = text.as_bytes().to_vec();
        data.resize((data.len() + 1).next_multiple_of(8), 0);
        self.add(name, &[], &data)
    }

    fn channel(&mut self, channel: &Channel) -> u64 {
        let name = self.text(*b"TX", channel.name);
        let unit = if channel.unit == "unknown" { 0 } else { self.text(*b"TX", channel.unit) };
        let links = [channel.next, 0, name, 0, channel.conversion, 0, unit, 0];
        let mut data = vec![channel.kind, u8::from(channel.kind == VIRTUAL_TIME), channel.stored, 0];
        data.extend(channel.byte.to_le_bytes());
        data.extend(if channel.kind == VIRTUAL_TIME { 0_u32 } else { 64 }.to_le_bytes());
        data.resize(72, 0);
        self.add(*b"CN", &links, &data)
    }
}

/// What is stated of a channel.
struct Channel<'a> {
    name: &'a str,
    unit: &'a str,
    kind: u8,
    stored: u8,
    byte: u32,
    conversion: u64,
    next: u64,
}

fn block(name: [u8; 2], links: &[u64], data: &[u8]) -> Vec<u8> {
    let length = (HEAD + 8 * links.len() + data.len()) as u64;
    let mut bytes = [b'#', b'#', name[0], name[1], 0, 0, 0, 0].to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend((links.len() as u64).to_le_bytes());
    bytes.extend(links.iter().flat_map(|link| link.to_le_bytes()));
    bytes.extend(data);
    bytes
}

pub(super) fn content(file: &File) -> Vec<u8> {
    let mut blocks = Blocks::new();
    let mut next = 0;
    for (c, name) in file.names.iter().enumerate().rev() {
        let byte = 8 * c as u32;
        let channel = Channel { name, unit: file.unit, kind: FIXED_LENGTH, stored: DOUBLE, byte, conversion: 0, next };
        next = blocks.channel(&channel);
    }
    let mut linear = vec![1, 0, 0, 0, 0, 0, 2, 0];
    linear.extend([0.0, 0.0, 0.0, 1.0 / file.rate_hz].into_iter().flat_map(f64::to_le_bytes));
    let conversion = blocks.add(*b"CC", &[0; 4], &linear);
    let time =
        Channel { name: "time", unit: "s", kind: VIRTUAL_TIME, stored: UNSIGNED_INTEGER, byte: 0, conversion, next };
    let first = blocks.channel(&time);
    let mut group = 0_u64.to_le_bytes().to_vec();
    group.extend((file.samples() as u64).to_le_bytes());
    group.extend([0; 8]);
    group.extend((8 * file.signals.len() as u32).to_le_bytes());
    group.extend([0; 4]);
    let group = blocks.add(*b"CG", &[0, first, 0, 0, 0, 0], &group);
    let rows: Vec<u8> = file.rows().flat_map(f64::to_le_bytes).collect();
    let data = blocks.add(*b"DT", &[], &rows);
    let data_group = blocks.add(*b"DG", &[0, group, data, 0], &[0; 8]);
    let comment = "<FHcomment><TX>a run of a meshband record</TX><tool_id>meshband</tool_id>\
                   <tool_vendor>meshband</tool_vendor><tool_version>1</tool_version></FHcomment>";
    let comment = blocks.text(*b"MD", comment);
    let history = blocks.add(*b"FH", &[0, comment], &[0; 16]);
    let header = block(*b"HD", &[data_group, history, 0, 0, 0, 0], &[0; 32]);
    blocks.bytes[HEADER..HEADER + HEADER_LENGTH].copy_from_slice(&header);
    blocks.bytes
}
