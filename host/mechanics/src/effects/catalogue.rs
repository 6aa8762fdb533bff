//! The catalogue of effects with one picture each: what `book/src/reference/effects.md` shows is computed, not drawn.
//!
//! Every picture is the amplitude spectrum of the pinion channel of the 19/48 machine at 10 turns/s, without
//! and with the effect at the example values, from one second at 10 240 Hz, so that all orders of the pinion
//! fall on whole hertz and no window is needed.

use super::{Entry, REGISTRY, parse};
use crate::Result;
use crate::dynamics::simulate::{Acquisition, Simulated, simulate};
use crate::dynamics::{Motion, Rig};
use crate::report::plot::{Axes, Series, spectrum};
use crate::spectral::{Window, amplitude_spectrum};
use std::fmt::Write;

/// Pinion speed of the pictures, Hz.
const SPEED_HZ: f64 = 10.0;
/// Torque of the pictures, N m.
const TORQUE_N_M: f64 = 15.0;
/// Sampling rate of the pictures, Hz.
const RATE_HZ: f64 = 10_240.0;

/// One second of the machine with one effect, given as on the command line, or none.
///
/// # Errors
/// A text that names no effect, and everything that stops the solver.
pub fn example(rig: &Rig, effect: Option<&str>) -> Result<Simulated> {
    let effects = effect.iter().map(|text| parse(text)).collect::<Result<Vec<_>>>()?;
    let motion = Motion::Constant { speed_hz: SPEED_HZ, turns_at_zero: 0.0 };
    let acquisition =
        Acquisition { rate_hz: RATE_HZ, duration_s: 1.0, pulses_per_turn: 1, jitter_s: 0.0, noise_m_s2: 0.0, seed: 1 };
    simulate(rig, &motion, TORQUE_N_M, &effects, &acquisition)
}

/// The effect's example as on the command line.
pub fn argument(entry: &Entry) -> String {
    let colon = if entry.example.is_empty() { "" } else { ":" };
    format!("{}{colon}{}", entry.name, entry.example)
}

/// The picture of one effect beside the plain machine's signal.
///
/// # Errors
/// Everything that stops the solver or the picture.
pub fn picture(rig: &Rig, plain: &Simulated, entry: &Entry) -> Result<String> {
    let with = example(rig, Some(&argument(entry)))?;
    let points = |signal: &[f64]| -> Vec<(f64, f64)> {
        let s = amplitude_spectrum(signal, RATE_HZ, Window::Rectangular);
        // Without noise the floor is rounding; the picture's own floor keeps the curve short.
        (1..s.values.len())
            .map(|i| (s.frequency(i), s.values[i].max(FLOOR)))
            .take_while(|(hz, _)| *hz <= entry.span_hz.min(0.5 * RATE_HZ))
            .collect()
    };
    let series =
        [Series::new(&argument(entry), points(&with.channels[0])), Series::new("without", points(&plain.channels[0]))];
    spectrum(&series, &[], 1.0, SPAN_DB, Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" })
}

/// Range of the pictures, dB.
const SPAN_DB: f64 = 100.0;
/// Least amplitude drawn, m/s2.
const FLOOR: f64 = 1e-6;

/// The catalogue as Markdown; pictures are expected as `effects/NAME.svg` beside it.
pub fn markdown() -> String {
    let mut text = String::from(
        "# Effects\n\n\
         What real gears and their measuring chains add to the ideal model. This page and its pictures are written \
         by\n\n\
         ```\nmeshband effects --docs book/src/reference/effects.md --force\n```\n\n\
         On the command line an effect is `--effect name:key=value,key=value`; keys left out take the defaults \
         below, and\n\
         `pinion-` or `gear-` before the name of an effect on one gear chooses the gear. Several effects add up; \
         those of\n\
         the measuring chain act in the order given. Adding an effect takes one file in \
         `host/mechanics/src/effects/` and its line\n\
         in the registry. Each signature below is what `tests/tests/simulator/effects.rs` checks. Pictures: machine\n\
         `machines/19-48.toml`, pinion at 10 turns/s (mesh frequency 190 Hz), 15 N m, pinion channel.\n",
    );
    for entry in REGISTRY {
        let _ =
            write!(text, "\n## {}\n\n{}.\n\nSignature: {}.\n\n", entry.name, capital(entry.meaning), entry.signature);
        if !entry.parameters.is_empty() {
            text.push_str("|key|unit|default|range|meaning|\n|---|---|---|---|---|\n");
        }
        for p in entry.parameters {
            let unit = if p.unit.is_empty() { "1" } else { p.unit };
            let [low, high] = p.range;
            let _ = writeln!(text, "|{}|{unit}|{}|{low} to {high}|{}|", p.name, p.default, p.meaning);
        }
        let gap = if entry.parameters.is_empty() { "" } else { "\n" };
        let _ = writeln!(text, "{gap}![Spectrum with and without {}](effects/{}.svg)", entry.name, entry.name);
    }
    text
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|c| c.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}
