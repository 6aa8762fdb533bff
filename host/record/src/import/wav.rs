//! WAV files; integer samples are scaled to +-1, so the channel's unit is its full scale.

use super::Columns;
use crate::{Error, Result};
use std::path::Path;

pub(super) fn read(path: &Path, bytes: &[u8], stem: &str) -> Result<Columns> {
    let refuse = |error: hound::Error| Error::invalid(path.display(), format!("WAV data is broken ({error})"));
    let mut reader = hound::WavReader::new(bytes).map_err(refuse)?;
    let spec = reader.spec();
    let values: Vec<f64> = match spec.sample_format {
        hound::SampleFormat::Float => {
            reader.samples::<f32>().map(|s| s.map(f64::from)).collect::<std::result::Result<_, _>>().map_err(refuse)?
        }
        hound::SampleFormat::Int => {
            let scale = 2.0_f64.powi(i32::from(spec.bits_per_sample) - 1);
            let samples = reader.samples::<i32>().map(|s| s.map(|v| f64::from(v) / scale));
            samples.collect::<std::result::Result<_, _>>().map_err(refuse)?
        }
    };
    let count = usize::from(spec.channels).max(1);
    let channels = (0..count).map(|c| values.iter().skip(c).step_by(count).copied().collect()).collect();
    let names = (0..count).map(|c| if count == 1 { stem.to_string() } else { format!("{stem} {c}") }).collect();
    let remarks = match spec.sample_format {
        hound::SampleFormat::Int => vec!["integer WAV samples are scaled to +-1 of full scale".to_string()],
        hound::SampleFormat::Float => Vec::new(),
    };
    let largest = (spec.sample_format == hound::SampleFormat::Int).then_some(1.0);
    Ok(Columns { names, channels, rate_hz: Some(f64::from(spec.sample_rate)), remarks, largest })
}
