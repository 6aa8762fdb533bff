//! A reading end: entries in order from a number on, as far as they are written whole.

use super::entry::Entry;
use super::{HEADER, MAX_ENTRY, segment_path, segments};
use crate::error::{Result, at};
use meshband::frame::CRC32;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes read at a time.
const PIECE: usize = 256 << 10;

/// A reader with its place.
#[derive(Debug)]
pub struct Reader {
    folder: PathBuf,
    /// Number of the next entry.
    next: u64,
    /// Segment that holds it: its file and the offset of the entry in it.
    open: Option<(u64, File, u64)>,
    /// Entries that were gone before they were read.
    missed: u64,
}

impl Reader {
    /// Reads from this number on.
    pub fn new(folder: &Path, next: u64) -> Self {
        Self { folder: folder.to_owned(), next, open: None, missed: 0 }
    }

    /// Entries that were given up for the journal's limit before they were read here.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Up to `most` entries with their numbers; none when all were read.
    ///
    /// # Errors
    /// Of the file system.
    pub fn take(&mut self, most: usize) -> Result<Vec<(u64, Entry)>> {
        let mut taken = Vec::new();
        while taken.len() < most {
            if self.open.is_none() && !self.find()? {
                break;
            }
            let before = taken.len();
            self.take_piece(most, &mut taken)?;
            if taken.len() > before {
                continue;
            }
            let Some(following) = self.following()? else { break };
            // Now that there is another segment, this one is complete: whatever came since the look above is read as
            // well.
            self.take_piece(most, &mut taken)?;
            if taken.len() == before {
                self.missed += following.saturating_sub(self.next);
                self.next = self.next.max(following);
                self.open = None;
            }
        }
        Ok(taken)
    }

    /// Opens the segment that holds the next entry, or the first one behind it.
    fn find(&mut self) -> Result<bool> {
        let firsts = segments(&self.folder)?;
        let holding = firsts.iter().rev().find(|&&first| first <= self.next).or(firsts.first());
        let Some(&first) = holding else { return Ok(false) };
        if first > self.next {
            self.missed += first - self.next;
            self.next = first;
        }
        let path = segment_path(&self.folder, first);
        let mut file = at(&path, File::open(&path))?;
        let offset = skip(&path, &mut file, self.next - first)?;
        self.open = Some((first, file, offset));
        Ok(true)
    }

    fn take_piece(&mut self, most: usize, taken: &mut Vec<(u64, Entry)>) -> Result {
        let Some((_, file, offset)) = &mut self.open else { return Ok(()) };
        let bytes = piece(&self.folder, file, *offset)?;
        let mut rest = &bytes[..];
        while taken.len() < most {
            let Some((body, behind)) = split(rest) else { break };
            let Ok(entry) = postcard::from_bytes(body) else { break };
            taken.push((self.next, entry));
            self.next += 1;
            *offset += (rest.len() - behind.len()) as u64;
            rest = behind;
        }
        Ok(())
    }

    fn following(&self) -> Result<Option<u64>> {
        let Some((first, ..)) = &self.open else { return Ok(None) };
        Ok(segments(&self.folder)?.into_iter().find(|other| other > first))
    }
}

/// Number of whole entries of a segment and their bytes.
///
/// # Errors
/// Of the file.
pub fn measure(path: &Path) -> Result<(u64, u64)> {
    let mut file = at(path, File::open(path))?;
    let (mut entries, mut offset) = (0, 0);
    loop {
        let bytes = piece(path, &mut file, offset)?;
        let mut rest = &bytes[..];
        while let Some((_, behind)) = split(rest) {
            entries += 1;
            offset += (rest.len() - behind.len()) as u64;
            rest = behind;
        }
        if rest.len() == bytes.len() {
            return Ok((entries, offset));
        }
    }
}

/// Offset of the entry behind so many.
fn skip(path: &Path, file: &mut File, mut entries: u64) -> Result<u64> {
    let mut offset = 0;
    while entries > 0 {
        let bytes = piece(path, file, offset)?;
        let mut rest = &bytes[..];
        while entries > 0 {
            let Some((_, behind)) = split(rest) else { break };
            entries -= 1;
            offset += (rest.len() - behind.len()) as u64;
            rest = behind;
        }
        if rest.len() == bytes.len() {
            break;
        }
    }
    Ok(offset)
}

fn piece(path: &Path, file: &mut File, offset: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    at(path, file.seek(SeekFrom::Start(offset)))?;
    at(path, file.take(PIECE as u64).read_to_end(&mut bytes))?;
    Ok(bytes)
}

/// The first entry's body and what is behind it; `None` where it is not whole.
fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (header, rest) = bytes.split_at_checked(HEADER)?;
    let length = u32::from_le_bytes(header[..4].try_into().ok()?) as usize;
    let checksum = u32::from_le_bytes(header[4..].try_into().ok()?);
    if length == 0 || length > MAX_ENTRY {
        return None;
    }
    let (body, behind) = rest.split_at_checked(length)?;
    (CRC32.checksum(body) == checksum).then_some((body, behind))
}

#[cfg(test)]
mod tests {
    use super::super::Journal;
    use super::super::entry::{Body, Entry};
    use super::*;

    fn entry(number: u64) -> Entry {
        let body = Body::Frame(number.to_le_bytes().repeat(100));
        Entry {
            node: "n".into(),
            machine: "m".into(),
            unit: [1, 2, 3],
            boot: 1,
            received_us: number as i64,
            time_us: number as i64,
            body,
        }
    }

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("meshband-journal-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        folder
    }

    #[test]
    fn claim_entries_come_once_and_in_order_over_segments_and_restarts() {
        let folder = folder("order");
        let mut journal = Journal::open(&folder, 0).expect("opens");
        let mut reader = Reader::new(&folder, 0);
        let mut seen = Vec::new();
        for number in 0..12_000 {
            journal.append(&[entry(number)]).expect("writes");
            if number % 1000 == 7 {
                seen.extend(reader.take(usize::MAX).expect("reads"));
                journal = Journal::open(&folder, 0).expect("opens again");
            }
        }
        seen.extend(reader.take(usize::MAX).expect("reads"));
        assert!(segments(&folder).expect("lists").len() > 1, "more than one segment");
        assert_eq!(seen.len(), 12_000);
        assert!(seen.iter().enumerate().all(|(at, (number, held))| *number == at as u64 && *held == entry(*number)));
        journal.trim(11_999, u64::MAX).expect("trims");
        assert_eq!(segments(&folder).expect("lists").len(), 1);
        let mut late = Reader::new(&folder, 0);
        let rest = late.take(usize::MAX).expect("reads");
        assert_eq!(rest.len() as u64 + late.missed(), 12_000, "what was given up is counted");
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn fault_a_torn_end_costs_the_torn_entry_alone() {
        let folder = folder("torn");
        let mut journal = Journal::open(&folder, 0).expect("opens");
        journal.append(&[entry(0), entry(1), entry(2)]).expect("writes");
        drop(journal);
        let path = segment_path(&folder, 0);
        let whole = std::fs::read(&path).expect("reads");
        for cut in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..cut]).expect("writes");
            let mut journal = Journal::open(&folder, 0).expect("opens");
            let kept = cut * 3 / whole.len();
            assert_eq!(journal.next(), kept as u64, "cut at {cut}");
            journal.append(&[entry(9)]).expect("writes");
            let held = Reader::new(&folder, 0).take(usize::MAX).expect("reads");
            assert_eq!(held.len(), kept + 1);
            assert_eq!(held[kept].1, entry(9));
        }
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn fault_numbers_do_not_return_after_a_power_cut_behind_a_consumer() {
        let folder = folder("ahead");
        let mut journal = Journal::open(&folder, 0).expect("opens");
        journal.append(&[entry(0)]).expect("writes");
        let mut journal = {
            drop(journal);
            Journal::open(&folder, 40).expect("opens behind a consumer at 40")
        };
        journal.append(&[entry(40)]).expect("writes");
        let held = Reader::new(&folder, 40).take(usize::MAX).expect("reads");
        assert_eq!(held, [(40, entry(40))]);
        let _ = std::fs::remove_dir_all(&folder);
    }
}
