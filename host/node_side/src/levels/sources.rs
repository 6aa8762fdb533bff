//! Where values of the sound machine come from: a record that the virtual node plays, or what a node said and
//! `monitor --record` kept.

use super::observe::Observations;
use crate::record::Record;
use crate::virtual_node::frames::Received;
use crate::virtual_node::setup::configuration;
use crate::virtual_node::signal::Signal;
use crate::virtual_node::simulation;
use crate::{Error, Result};
use rayon::prelude::*;
use std::path::Path;

/// Values of a record folder (all runs of one channel) or of a captured link.
///
/// # Errors
/// What cannot be read, a record without tach or tooth counts, a captured link without a message of a node.
pub fn observe(path: &Path, channel: &str) -> Result<Observations> {
    if path.is_dir() { of_record(&Record::read(path)?, channel) } else { of_link(path) }
}

fn of_record(record: &Record, channel: &str) -> Result<Observations> {
    let of_run = |run: usize| {
        let signal = Signal::of_record(record, run, (channel, None), 0.0, None)?;
        let image = signal.image(&configuration(&signal, None)?)?;
        Ok(of_bytes(&simulation::run(&image.bytes)?.link))
    };
    let runs: Vec<Observations> =
        (0..record.declaration.runs.len()).into_par_iter().map(of_run).collect::<Result<_>>()?;
    let mut all = Observations::default();
    runs.into_iter().for_each(|run| all.extend(run));
    Ok(all)
}

fn of_link(path: &Path) -> Result<Observations> {
    let bytes = crate::budget::read(path)?;
    let received = Received::decode(&bytes);
    if received.messages().next().is_none() {
        return Err(Error::invalid(path.display(), "is no record folder and holds no message of a node"));
    }
    Ok(of_bytes(&bytes))
}

fn of_bytes(link: &[u8]) -> Observations {
    let mut observed = Observations::default();
    Received::decode(link).messages().for_each(|message| observed.take(message));
    observed
}
