//! ASAM MDF 4 files (`.mf4`): numeric channels of all groups, each with its group's time.
//!
//! Source: the format as ASAM's MDF 4.1 describes it. Read: sorted and unsorted groups, data in lists and compressed
//! (deflate, transposed), integers of any bits, floats, invalid samples (they become no number), structures. Own
//! reader, because the crate `mf4-rs` (3.8.0) reads no compressed data, which is what loggers write. Not read, and
//! counted in a remark: texts, arrays, formulas; refused with the remedy: MDF 3, files that were not closed, the
//! column storage of MDF 4.2. Every announced size is held against the bytes that follow.

mod blocks;
mod channel;
mod conversion;
mod records;

use super::signals::{Signal, Signals};
use super::stamps::{self, Stamps};
use crate::budget::VALUES;
use crate::{Error, Result, text};
use blocks::{Block, Blocks};
use channel::Channel;
use records::Records;
use std::path::Path;

/// Place of the first block.
const HEADER: u64 = 64;
/// Name that a group's time is given, so that it is told as such.
const TIME: &str = "time";

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let major = bytes.get(28..30).map_or(0, |version| u16::from_le_bytes([version[0], version[1]]) / 100);
    bytes.starts_with(b"MDF     ") && major == 4
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Signals> {
    let blocks = Blocks::new(path, bytes);
    let header = blocks.at(HEADER, b"HD")?;
    let mut found = Found { path, signals: Signals::default(), values: 0.0, skipped: 0 };
    let mut groups = Vec::new();
    for data_group in blocks.chain(header.link(0), b"DG")? {
        groups.extend(group_channels(&blocks, &data_group)?);
    }
    let several = groups.len() > 1;
    for (number, group) in groups.iter().enumerate() {
        found.group(number, group, several)?;
    }
    if found.skipped > 0 && found.signals.signals.iter().all(|signal| signal.name == TIME) {
        let what = format!(
            "holds no channel of numbers: {} are texts, arrays or formulas; write physical values: python -m pip \
             install asammdf, then asammdf.MDF(FILE).export('mat')",
            found.skipped
        );
        return Err(Error::invalid(path.display(), what));
    }
    if found.skipped > 0 {
        let what = format!("{} channels that are no numbers (texts, arrays, formulas) were skipped", found.skipped);
        found.signals.remarks.push(what);
    }
    Ok(found.signals)
}

/// Channels of one group, and where its records are.
struct Group {
    name: String,
    channels: Vec<Channel>,
    /// Channels that are no numbers.
    skipped: usize,
    records: Records,
}

/// The groups of a data group, with their records.
fn group_channels(blocks: &Blocks, data_group: &Block) -> Result<Vec<Group>> {
    let chain = blocks.chain(data_group.link(1), b"CG")?;
    let records = Records::of(blocks, data_group, &chain)?;
    let mut groups = Vec::new();
    for (block, records) in chain.iter().zip(records) {
        if records.count() == 0 {
            continue;
        }
        let name = blocks.text(block.link(2))?.unwrap_or_default();
        let (channels, skipped) = Channel::all(blocks, block)?;
        groups.push(Group { name, channels, skipped, records });
    }
    Ok(groups)
}

/// What was found so far.
struct Found<'a> {
    path: &'a Path,
    signals: Signals,
    values: f64,
    skipped: usize,
}

impl Found<'_> {
    fn group(&mut self, number: usize, group: &Group, several: bool) -> Result<()> {
        self.skipped += group.skipped;
        self.values += group.records.count() as f64 * group.channels.len() as f64;
        VALUES.check(self.path.display(), self.values, "save fewer channels or a shorter part")?;
        let folder = format!("{} {}", number + 1, text::name(&group.name));
        let mut own = Vec::new();
        for channel in &group.channels {
            let values = channel.values(&group.records).ok_or_else(|| self.broken(&channel.name))?;
            let name = if channel.is_time { TIME } else { channel.name.as_str() };
            let mut signal = Signal { folder: folder.clone(), ..Signal::new(name, values) };
            signal.unit = if channel.is_time { Some("s".into()) } else { channel.unit.clone() };
            own.push(signal);
        }
        // Messages of a bus come when they come; beside evenly sampled groups they are no reason to refuse.
        let time = own.iter().zip(&group.channels).find(|(_, channel)| channel.is_time).map(|(signal, _)| signal);
        if several && time.is_some_and(|time| !matches!(stamps::look(&time.values), Stamps::Even { .. })) {
            let names: Vec<&str> = own.iter().map(|signal| signal.name.as_str()).filter(|name| *name != TIME).collect();
            let list = text::quoted(&names.into_iter().take(6).collect::<Vec<_>>().join(", "));
            self.signals.remarks.push(format!("group {folder} is not sampled evenly and is left out: {list}"));
            return Ok(());
        }
        self.signals.signals.append(&mut own);
        Ok(())
    }

    fn broken(&self, channel: &str) -> Error {
        let what = format!("MDF data is broken (channel {} lies outside its records)", text::quoted(channel));
        Error::invalid(self.path.display(), what)
    }
}
