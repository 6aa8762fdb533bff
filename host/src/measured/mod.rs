//! Published measurements against the model: which lines it leaves unexplained, which effect they point to, and how
//! much of *held-out* data (second half, other channels, other loads) that effect explains.
//!
//! The measurements themselves are not part of the project; every function takes the folder they lie in. Nothing here
//! knows a line in advance: spacings and slips come out of searches on the fitting part. Commands and results: `docs/measured.md`.

pub mod adi;
pub mod comb;
pub mod gear0;
pub mod gfd;
pub mod paderborn;
pub mod paper;

use crate::import::{Columns, read};
use crate::{Error, Result};
use std::path::Path;

/// Reads a measured file, with advice where the data set is not at hand.
fn file(folder: &Path, set: &str, name: &str) -> Result<Columns> {
    let path = folder.join(set).join(name);
    if !path.exists() {
        let what = "is absent; the measured data are not part of the project, see docs/measured.md for their sources";
        return Err(Error::invalid(path.display(), what));
    }
    read(&path)
}
