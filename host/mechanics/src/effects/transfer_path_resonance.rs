//! A mode of the structure beside the direct path: `y (1 + gain H(f))`, `H` of second order, 1 at low frequency.
//!
//! Signature: lines near a fixed frequency are raised and turned in phase at every speed; no new lines.

use super::filter::{mode, pass};
use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Path, Seat, one};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "transfer-path-resonance",
    meaning: "a structural mode beside the direct path to the sensor",
    signature: "a fixed formant over the whole order pattern; proportional to the signal; no new lines",
    example: "gain=0.3,frequency=1900",
    span_hz: 5120.0,
    parameters: &[
        parameter("gain", "", 0.1, [-100.0, 100.0], "of the mode, at low frequency"),
        parameter("frequency", "Hz", 1900.0, [1.0, 1e6], "of the mode"),
        parameter("damping", "", 0.02, [1e-4, 0.9], "ratio of the mode"),
        CHANNEL,
    ],
    build: |v| {
        let [gain, frequency_hz, damping] = ["gain", "frequency", "damping"].map(|n| v.get(n));
        Box::new(Mode { gain, frequency_hz, damping, channels: v.channels() })
    },
    hypotheses: &[Hypothesis {
        name: "transfer-path-resonance",
        plain: "fixed-frequency mode in the path of a channel",
        seats: &[Seat::Path(Path::Mode)],
        quantity: "gain",
        carry: real_gain,
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "transfer-path-resonance",
        right_names: &["transfer-path-resonance"],
        families: &["path"],
        reference: 0.1,
        draw: |size, draw| {
            let (channel, hz) = (draw.side(), 1500.0 + 3000.0 * draw.share());
            vec![format!("transfer-path-resonance:gain={size},frequency={hz},damping=0.03,channel={channel}")]
        },
        ..Hidden::DEFAULTS
    }],
};

/// The simulator's mode has a real gain; the quadrature part has no counterpart.
fn real_gain(f: &Fitted<'_>) -> Option<Carried> {
    let &[gain, quadrature] = f.parts.first()?;
    let keys = [("gain", gain), ("frequency", f.shape[0]), ("damping", f.shape[1]), f.on()];
    let share = (quadrature / gain.hypot(quadrature)).abs();
    let remark = (share > 0.1).then(|| format!("{:.0} % of the gain in quadrature, left out", 100.0 * share));
    Some(Carried { remark, ..one("transfer-path-resonance", keys) })
}

struct Mode {
    gain: f64,
    frequency_hz: f64,
    damping: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Mode {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        let response = |hz: f64| 1.0 + self.gain * mode(hz, self.frequency_hz, self.damping);
        pass(sampled, self.channels.clone(), response);
    }
}
