//! `--from` and `--to` of the commands that look at a record.

use clap::Args as ClapArgs;
use meshband_host::Result;
use meshband_host::part::Part;
use meshband_host::record::Record;
use std::path::Path;

/// Seconds of every run that are looked at.
#[derive(ClapArgs)]
pub struct PartArgs {
    /// Second of every run from which it is looked at, 0 for its first sample.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Second of every run up to which it is looked at.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: Option<f64>,
}

impl PartArgs {
    /// The record in `folder`, or the part of it that is asked for.
    ///
    /// # Errors
    /// Those of [`Record::read`], and a part that no run has.
    pub fn read(&self, folder: &Path) -> Result<Record> {
        let part = Part::new(self.from, self.to)?;
        let record = Record::read(folder)?;
        match part {
            Some(part) => record.part(part),
            None => Ok(record),
        }
    }
}
