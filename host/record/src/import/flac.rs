//! FLAC files by the crate `claxon`; samples are integers, scaled to +-1 as those of a WAV file.

use super::signals::{Signal, Signals};
use crate::budget::VALUES;
use crate::{Error, Result};
use std::path::Path;

pub(super) fn read(path: &Path, bytes: &[u8], stem: &str) -> Result<Signals> {
    let refuse = |error: claxon::Error| Error::invalid(path.display(), format!("FLAC data is broken ({error})"));
    let mut reader = claxon::FlacReader::new(bytes).map_err(refuse)?;
    let info = reader.streaminfo();
    let count = (info.channels as usize).max(1);
    if let Some(samples) = info.samples {
        VALUES.check(path.display(), samples as f64 * count as f64, "cut the file into parts")?;
    }
    let scale = 2.0_f64.powi(info.bits_per_sample as i32 - 1);
    let mut channels = vec![Vec::new(); count];
    for (i, sample) in reader.samples().enumerate() {
        // A stream may be longer than it says.
        if i.is_multiple_of(1 << 20) {
            VALUES.check(path.display(), i as f64, "cut the file into parts")?;
        }
        channels[i % count].push(f64::from(sample.map_err(refuse)?) / scale);
    }
    if info.samples.is_some_and(|samples| samples != channels[0].len() as u64) {
        return Err(Error::invalid(path.display(), "FLAC data is truncated"));
    }
    let named = channels.into_iter().enumerate();
    let name = |c: usize| if count == 1 { stem.to_string() } else { format!("{stem} {c}") };
    let signal = |(c, values)| Signal { largest: Some(1.0), ..Signal::unnamed(name(c), values) };
    Ok(Signals {
        signals: named.map(signal).collect(),
        rate_hz: Some(f64::from(info.sample_rate)),
        remarks: vec!["integer FLAC samples are scaled to +-1 of full scale".to_string()],
        cut: None,
    })
}
