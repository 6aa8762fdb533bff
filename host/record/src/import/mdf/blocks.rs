//! Blocks of an MDF 4 file and the links between them.

use crate::{Error, Result};
use std::path::Path;

/// Bytes of a block's head: name, length, number of links.
const HEAD: u64 = 24;
/// Blocks of one chain; more are a circle.
const MAX_CHAIN_BLOCKS: usize = 100_000;
/// Groups within structures.
pub(super) const MAX_GROUP_DEPTH: usize = 8;

/// A file's bytes, looked at block by block.
pub(super) struct Blocks<'a> {
    pub path: &'a Path,
    bytes: &'a [u8],
}

/// One block.
#[derive(Debug, Clone)]
pub(super) struct Block<'a> {
    /// Two letters, such as `DG`.
    pub name: [u8; 2],
    links: Vec<u64>,
    pub data: &'a [u8],
}

impl Block<'_> {
    /// A link; 0 where there is none.
    pub fn link(&self, index: usize) -> u64 {
        self.links.get(index).copied().unwrap_or(0)
    }

    /// All links.
    pub fn links(&self) -> &[u64] {
        &self.links
    }

    pub fn u8(&self, at: usize) -> Option<u8> {
        self.data.get(at).copied()
    }

    pub fn u16(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(self.data.get(at..at + 2)?.try_into().ok()?))
    }

    pub fn u32(&self, at: usize) -> Option<u32> {
        Some(u32::from_le_bytes(self.data.get(at..at + 4)?.try_into().ok()?))
    }

    pub fn u64(&self, at: usize) -> Option<u64> {
        Some(u64::from_le_bytes(self.data.get(at..at + 8)?.try_into().ok()?))
    }

    pub fn f64(&self, at: usize) -> Option<f64> {
        self.u64(at).map(f64::from_bits)
    }
}

impl<'a> Blocks<'a> {
    pub fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes }
    }

    /// A refusal that says what is broken.
    pub fn refuse(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(self.path.display(), format!("MDF data is broken or truncated ({what})"))
    }

    /// The block at a place, of whatever kind.
    pub fn any(&self, at: u64) -> Result<Block<'a>> {
        let part = |from: u64, to: u64| {
            let range = usize::try_from(from).ok()?..usize::try_from(to).ok()?;
            self.bytes.get(range)
        };
        let outside = || self.refuse(format!("a block at byte {at} lies outside the file"));
        let head = at.checked_add(HEAD).and_then(|end| part(at, end)).ok_or_else(outside)?;
        let number = |from: usize| u64::from_le_bytes(head[from..from + 8].try_into().unwrap_or_default());
        let (length, count) = (number(8), number(16));
        if &head[..2] != b"##" || length < HEAD || count > (length - HEAD) / 8 {
            return Err(self.refuse(format!("no block at byte {at}")));
        }
        let body = at.checked_add(length).and_then(|end| part(at + HEAD, end)).ok_or_else(outside)?;
        let (links, data) = body.split_at(8 * count as usize);
        let links = links.chunks_exact(8).map(|link| u64::from_le_bytes(link.try_into().unwrap_or_default()));
        Ok(Block { name: [head[2], head[3]], links: links.collect(), data })
    }

    /// The block at a place, of the kind that has to be there.
    pub fn at(&self, at: u64, name: &[u8; 2]) -> Result<Block<'a>> {
        let block = self.any(at)?;
        if &block.name != name {
            return Err(self.refuse(format!("no block {} at byte {at}", String::from_utf8_lossy(name))));
        }
        Ok(block)
    }

    /// Blocks of which each links to the next one first.
    pub fn chain(&self, first: u64, name: &[u8; 2]) -> Result<Vec<Block<'a>>> {
        let (mut at, mut found) = (first, Vec::new());
        while at != 0 {
            if found.len() >= MAX_CHAIN_BLOCKS {
                return Err(self.refuse("a chain of blocks has no end"));
            }
            let block = self.at(at, name)?;
            at = block.link(0);
            found.push(block);
        }
        Ok(found)
    }

    /// A text; of a comment in XML the part that is text. `None` where there is no block or nothing in it.
    pub fn text(&self, at: u64) -> Result<Option<String>> {
        if at == 0 {
            return Ok(None);
        }
        let block = self.any(at)?;
        let end = block.data.iter().position(|byte| *byte == 0).unwrap_or(block.data.len());
        let whole = String::from_utf8_lossy(&block.data[..end]).into_owned();
        let own = if &block.name == b"MD" { inner(&whole) } else { whole };
        Ok(Some(own.trim().to_owned()).filter(|own| !own.is_empty()))
    }
}

/// What stands between `<TX>` and `</TX>`.
fn inner(xml: &str) -> String {
    let from = xml.find("<TX").and_then(|at| Some(at + xml[at..].find('>')? + 1));
    let part = from.and_then(|from| Some(&xml[from..from + xml[from..].find("</TX>")?])).unwrap_or_default();
    part.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&apos;", "'").replace("&amp;", "&")
}
