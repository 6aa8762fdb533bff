//! What belongs to a record or to predictions, told from the files themselves.

use crate::{Error, Result};
use std::io::Read;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// What a folder is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// A record: `record.toml` and the files it names.
    Record,
    /// Predictions: float32 arrays and nothing else.
    Predictions,
    /// What a commissioning writes: [`COMMISSIONING`].
    Commissioning,
    /// Files of an acquisition system as `meshband simulate --as` writes them: `runNN` with one of its endings.
    Recordings,
}

/// Files of a commissioning.
pub const COMMISSIONING: [&str; 4] = ["commissioning.json", "report.html", "node.toml", "law.toml"];
/// Endings of recordings.
const RECORDINGS: [&str; 3] = ["wav", "csv", "npy"];

/// Start of a NumPy file with float32 values as [`crate::record::npy::bytes_f32`] writes it.
const FLOAT32: &[u8] = b"'descr': '<f4'";
/// Bytes of a NumPy header that are looked at.
const HEADER: u64 = 128;

/// Files that a machine or record declaration names, as it names them; none where the text is no TOML.
pub(super) fn named(text: &str) -> Vec<PathBuf> {
    let Ok(document) = toml::from_str::<Table>(text) else { return Vec::new() };
    let texts = |table: &Value, keys: [&str; 2]| -> Vec<PathBuf> {
        keys.iter().filter_map(|key| table.get(key)?.as_str().map(PathBuf::from)).collect()
    };
    let tables = document.get("pair").map(|pair| texts(pair, ["pair_stiffness", "total_stiffness"]));
    let array = |table: Option<&Value>| table.and_then(Value::as_array).cloned().unwrap_or_default();
    let of_run = |run: &Value| {
        let beside = array(run.get("beside"));
        let beside: Vec<PathBuf> =
            beside.iter().filter_map(|own| own.get("file")?.as_str().map(PathBuf::from)).collect();
        [texts(run, ["signal", "tach"]), beside].concat()
    };
    array(document.get("run")).iter().flat_map(of_run).chain(tables.into_iter().flatten()).collect()
}

/// Whether a folder has no entry.
pub(super) fn is_empty(folder: &Path) -> Result<bool> {
    Ok(std::fs::read_dir(folder).map_err(Error::file(folder))?.next().is_none())
}

/// Makes sure that a folder holds `content` and nothing else, all of it writable.
///
/// # Errors
/// The first entry that does not belong there.
pub(super) fn replaceable(folder: &Path, content: Content) -> Result<()> {
    let declared = match content {
        Content::Record => {
            let path = folder.join("record.toml");
            let text = std::fs::read_to_string(&path).map_err(|_| {
                Error::invalid(folder.display(), "holds other files and is no record that could be replaced")
            })?;
            let mut files = named(&text);
            files.push("record.toml".into());
            files
        }
        Content::Predictions if folder.join("record.toml").symlink_metadata().is_ok() => {
            return Err(Error::invalid(folder.display(), "is a record; predictions need a folder of their own"));
        }
        Content::Recordings if folder.join("record.toml").symlink_metadata().is_ok() => {
            return Err(Error::invalid(folder.display(), "is a record; recordings need a folder of their own"));
        }
        Content::Commissioning => COMMISSIONING.map(PathBuf::from).to_vec(),
        Content::Predictions | Content::Recordings => Vec::new(),
    };
    for entry in std::fs::read_dir(folder).map_err(Error::file(folder))? {
        let entry = entry.map_err(Error::file(folder))?;
        let (path, name) = (entry.path(), PathBuf::from(entry.file_name()));
        let found = path.symlink_metadata().map_err(Error::file(&path))?;
        let ours = match content {
            Content::Record | Content::Commissioning => declared.contains(&name),
            Content::Recordings => is_recording(&name),
            Content::Predictions => name.extension().is_some_and(|e| e == "npy") && is_float32(&path),
        };
        if !found.is_file() || !ours {
            return Err(Error::invalid(path.display(), "is not this command's own; its folder is not replaced"));
        }
        if found.permissions().readonly() {
            return Err(Error::invalid(path.display(), "is write-protected"));
        }
    }
    Ok(())
}

fn is_recording(name: &Path) -> bool {
    let number = name.file_stem().and_then(|stem| stem.to_str()?.strip_prefix("run"));
    number.is_some_and(|digits| digits.len() >= 2 && digits.bytes().all(|b| b.is_ascii_digit()))
        && name.extension().is_some_and(|e| RECORDINGS.iter().any(|own| e == *own))
}

fn is_float32(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(HEADER).read_to_end(&mut head));
    read.is_ok() && head.windows(FLOAT32.len()).any(|part| part == FLOAT32)
}
