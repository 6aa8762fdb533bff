//! A run of a record as a file of a foreign format; what is written is read back equal, by `import` and by the
//! format's own libraries.
//!
//! `wav`: 64-bit float, no unit. `csv`: time and names with units, every digit. `mat`: version 5, the channels by
//! name, `fs`, `unit`, `edges_s`. `uff58`: binary, double, unit and rate per set. `npy`: float64, samples x channels,
//! no rate and no unit. `mf4`: MDF 4.10. `parquet`: unit per column, the rate of the table. All values are the
//! record's, in its unit.

mod mdf;
mod table;

use super::{Acquisition, Run, npy};
use crate::{Error, Result, text};
use std::fmt::Write;

/// Formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// RIFF WAVE, 64-bit float.
    Wav,
    /// Text, comma-separated.
    Csv,
    /// MATLAB version 5.
    Mat,
    /// Universal file, dataset 58, binary.
    Uff58,
    /// NumPy, float64.
    Npy,
    /// ASAM MDF 4.10.
    Mf4,
    /// Apache Parquet.
    Parquet,
}

impl Format {
    /// Every format by the name that `--to` takes.
    pub const ALL: [(&str, Self); 7] = [
        ("wav", Self::Wav),
        ("csv", Self::Csv),
        ("mat", Self::Mat),
        ("uff58", Self::Uff58),
        ("npy", Self::Npy),
        ("mf4", Self::Mf4),
        ("parquet", Self::Parquet),
    ];

    /// The format of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(own, _)| *own == name).map(|(_, format)| *format)
    }
}

/// Largest file that a format of 32-bit sizes can be, bytes.
const MOST_BYTES: usize = u32::MAX as usize - 4096;
/// Longest name of a MATLAB variable.
const LONGEST_NAME: usize = 63;

/// Content of the file of one run.
///
/// # Errors
/// A rate that the format cannot state, and more bytes than it can.
pub fn content(format: Format, run: &Run, acquisition: &Acquisition) -> Result<Vec<u8>> {
    let signals: Vec<Vec<f64>> = (0..run.channels()).map(|channel| run.signal_m_s2(channel)).collect();
    let bytes = signals.len() * run.samples() * size_of::<f64>();
    if bytes > MOST_BYTES && matches!(format, Format::Wav | Format::Mat) {
        return Err(Error::invalid(
            "--to",
            format!("{bytes} bytes are more than the format can state; write npy or uff58"),
        ));
    }
    let file = File {
        signals: &signals,
        names: &acquisition.channels,
        unit: acquisition.unit.as_deref().unwrap_or("m/s2"),
        rate_hz: run.sample_rate_hz(),
    };
    match format {
        Format::Wav => file.wav(),
        Format::Csv => Ok(file.csv()),
        Format::Mat => Ok(file.mat(&run.edges_s)),
        Format::Uff58 => Ok(file.uff58()),
        Format::Npy => Ok(npy::bytes_f64(&file.rows().collect::<Vec<_>>(), signals.len())),
        Format::Mf4 => Ok(mdf::content(&file)),
        Format::Parquet => table::content(&file),
    }
}

/// What is written.
struct File<'a> {
    signals: &'a [Vec<f64>],
    names: &'a [String],
    unit: &'a str,
    rate_hz: f64,
}

impl File<'_> {
    fn samples(&self) -> usize {
        self.signals[0].len()
    }

    fn rows(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.samples()).flat_map(|i| self.signals.iter().map(move |signal| signal[i]))
    }

    fn wav(&self) -> Result<Vec<u8>> {
        let rate = self.rate_hz.round();
        if (rate - self.rate_hz).abs() > 1e-9 * rate || rate > f64::from(u32::MAX) {
            let what = format!(
                "{} Hz is no whole number, which is all that WAV can state; write csv, mat or uff58",
                self.rate_hz
            );
            return Err(Error::invalid("--to wav", what));
        }
        let block = (8 * self.signals.len()) as u32;
        let data = block * self.samples() as u32;
        let mut bytes = b"RIFF".to_vec();
        bytes.extend((data + 50).to_le_bytes());
        bytes.extend(b"WAVEfmt ");
        bytes.extend(18_u32.to_le_bytes());
        bytes.extend(3_u16.to_le_bytes());
        bytes.extend((self.signals.len() as u16).to_le_bytes());
        bytes.extend((rate as u32).to_le_bytes());
        bytes.extend((rate as u32).wrapping_mul(block).to_le_bytes());
        bytes.extend((block as u16).to_le_bytes());
        bytes.extend([64, 0, 0, 0]);
        bytes.extend(b"fact");
        bytes.extend(4_u32.to_le_bytes());
        bytes.extend((self.samples() as u32).to_le_bytes());
        bytes.extend(b"data");
        bytes.extend(data.to_le_bytes());
        bytes.extend(self.rows().flat_map(f64::to_le_bytes));
        Ok(bytes)
    }

    fn csv(&self) -> Vec<u8> {
        let mut out = String::from("time [s]");
        let unit = if self.unit == "unknown" { String::new() } else { format!(" [{}]", self.unit) };
        for name in self.names {
            let _ = write!(out, ",{}{unit}", text::name(name).replace([',', '"', ';'], " "));
        }
        out.push('\n');
        for i in 0..self.samples() {
            let _ = write!(out, "{}", i as f64 / self.rate_hz);
            for signal in self.signals {
                let _ = write!(out, ",{:?}", signal[i]);
            }
            out.push('\n');
        }
        out.into_bytes()
    }

    fn mat(&self, edges_s: &[f64]) -> Vec<u8> {
        let mut bytes = format!("{:<124}", "MATLAB 5.0 MAT-file, a run of a meshband record").into_bytes();
        bytes.extend([0x00, 0x01, b'I', b'M']);
        let mut taken: Vec<String> = Vec::new();
        for (name, signal) in self.names.iter().zip(self.signals) {
            let name = variable(name, &taken);
            bytes.extend(mat_array(&name, signal));
            taken.push(name);
        }
        bytes.extend(mat_array("fs", &[self.rate_hz]));
        if self.unit != "unknown" {
            bytes.extend(mat_text("unit", self.unit));
        }
        if edges_s.len() > 1 {
            bytes.extend(mat_array("edges_s", edges_s));
        }
        bytes
    }

    fn uff58(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let code = if self.unit == "m/s2" { 12 } else { 0 };
        let unit = if self.unit == "unknown" { "NONE" } else { self.unit };
        for (c, (name, signal)) in self.names.iter().zip(self.signals).enumerate() {
            let name: String = text::name(name).chars().filter(char::is_ascii).take(80).collect();
            let mut head = format!(
                "    -1\n    58b     1     2{:12}{:12}     0     0           0           0\n",
                11,
                8 * signal.len()
            );
            let _ = write!(head, "{name}\nNONE\n01-Jan-00 00:00:00\nNONE\nNONE\n");
            let _ = writeln!(
                head,
                "{:5}{:10}{:5}{:10} {:<10}{:10}{:4} {:<10}{:10}{:4}",
                1,
                c + 1,
                0,
                0,
                "NONE",
                0,
                0,
                "NONE",
                0,
                0
            );
            let _ = writeln!(
                head,
                "{:10}{:10}{:10}{:13.5e}{}{:13.5e}",
                4,
                signal.len(),
                1,
                0.0,
                step(1.0 / self.rate_hz),
                0.0
            );
            for (code, label, unit) in
                [(17, "Time", "s"), (code, "Signal", unit), (0, "NONE", "NONE"), (0, "NONE", "NONE")]
            {
                let _ = writeln!(head, "{code:10}{:5}{:5}{:5} {label:<20} {unit:<20}", 0, 0, 0);
            }
            out.extend(head.into_bytes());
            out.extend(signal.iter().flat_map(|x| x.to_le_bytes()));
            out.extend(b"\n    -1\n");
        }
        out
    }
}

/// The interval in thirteen places with all digits that fit.
fn step(step_s: f64) -> String {
    let (mantissa, exponent) = format!("{step_s:.6e}")
        .split_once('e')
        .map_or((String::new(), 0), |(m, e)| (m.to_owned(), e.parse::<i32>().unwrap_or(0)));
    format!("{:>13}", format!("{mantissa}E{}{:02}", if exponent < 0 { '-' } else { '+' }, exponent.abs()))
}

/// A name that MATLAB takes, and that no other variable has.
fn variable(name: &str, taken: &[String]) -> String {
    let mut out: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(LONGEST_NAME - 4).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "ch_");
    }
    let reserved = ["fs", "unit", "edges_s"].contains(&out.as_str());
    if !reserved && !taken.contains(&out) {
        return out;
    }
    let numbered = (1..).map(|k| format!("{out}_{k}")).find(|name| !taken.contains(name));
    numbered.unwrap_or(out)
}

fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

fn matrix(class: u32, name: &str, dims: [u32; 2], kind: u32, data: &[u8]) -> Vec<u8> {
    let mut body = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    body.extend(element(5, &dims.map(u32::to_le_bytes).concat()));
    body.extend(element(1, name.as_bytes()));
    body.extend(element(kind, data));
    element(14, &body)
}

fn mat_array(name: &str, values: &[f64]) -> Vec<u8> {
    let data: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    matrix(6, name, [values.len() as u32, 1], 9, &data)
}

fn mat_text(name: &str, text: &str) -> Vec<u8> {
    let data: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    matrix(4, name, [1, text.encode_utf16().count() as u32], 4, &data)
}
