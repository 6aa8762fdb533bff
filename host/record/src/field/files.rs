//! A field-like run as files of an acquisition system: float samples, the tachometer's voltage as the last channel.
//!
//! One file per run. `wav`: 32-bit float, which players call clipped beyond 1 and measuring systems write all the
//! same. `csv`: header with names, first column the time. `npy`: float32, samples x channels. Units are the channels'
//! own, which WAV and NumPy files do not state.

use super::declaration::{Channel, FileUnit};
use super::run::FieldRun;
use crate::record::npy;
use crate::{Error, Result};
use std::fmt::Write;

/// Standard acceleration of gravity, m/s2.
const GRAVITY: f64 = 9.80665;

/// Format of the files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// RIFF WAVE, 32-bit float.
    Wav,
    /// Text, comma-separated.
    Csv,
    /// NumPy, float32.
    Npy,
}

impl Format {
    /// Ending of the files' names.
    pub fn ending(self) -> &'static str {
        match self {
            Format::Wav => "wav",
            Format::Csv => "csv",
            Format::Npy => "npy",
        }
    }
}

/// Acceleration in m/s2 as a number in the channel's file.
fn in_file(channel: &Channel, acceleration_m_s2: f64) -> f64 {
    let own = match channel.unit {
        FileUnit::Acceleration => acceleration_m_s2,
        FileUnit::Gravity => acceleration_m_s2 / GRAVITY,
        FileUnit::Volt => acceleration_m_s2 / GRAVITY * channel.volt_per_g,
    };
    own + channel.offset
}

/// Content of the file of one run.
///
/// # Errors
/// A sampling rate that the format cannot state.
pub fn content(format: Format, run: &FieldRun, channels: &[Channel], rate_hz: f64) -> Result<Vec<u8>> {
    let count = run.channels[0].len();
    let row = |i: usize| {
        let own = channels.iter().zip(&run.channels).map(move |(channel, signal)| in_file(channel, signal[i]));
        own.chain(run.tach_v.get(i).copied())
    };
    let columns = channels.len() + usize::from(!run.tach_v.is_empty());
    match format {
        Format::Wav => wav((0..count).flat_map(row), columns, rate_hz),
        Format::Npy => {
            let values: Vec<f32> = (0..count).flat_map(row).map(|x| x as f32).collect();
            Ok(npy::bytes_f32(&values, columns))
        }
        Format::Csv => {
            let mut text = String::from("time_s");
            channels.iter().for_each(|c| text.push_str(&format!(",{}", c.name.replace([',', '"', '\n'], " "))));
            text.push_str(if run.tach_v.is_empty() { "\n" } else { ",tach\n" });
            for i in 0..count {
                let _ = write!(text, "{:.9}", i as f64 / rate_hz);
                row(i).for_each(|x| {
                    let _ = write!(text, ",{x:.7e}");
                });
                text.push('\n');
            }
            Ok(text.into_bytes())
        }
    }
}

fn wav(values: impl Iterator<Item = f64>, columns: usize, rate_hz: f64) -> Result<Vec<u8>> {
    if rate_hz.fract() != 0.0 || rate_hz > f64::from(u32::MAX) {
        return Err(Error::invalid("--rate", format!("{rate_hz} Hz is no whole number, which a WAV file needs")));
    }
    let spec = hound::WavSpec {
        channels: columns as u16,
        sample_rate: rate_hz as u32,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = (|| {
        let mut writer = hound::WavWriter::new(&mut bytes, spec)?;
        values.into_iter().try_for_each(|x| writer.write_sample(x as f32))?;
        writer.finalize()
    })();
    written.map_err(|error: hound::Error| Error::invalid("--as wav", error))?;
    Ok(bytes.into_inner())
}
