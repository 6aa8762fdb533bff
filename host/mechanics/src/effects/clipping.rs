//! Clipping: the signal stops at a limit of sensor or converter.
//!
//! Signature: flat crests; odd sums and differences of lines once the peaks reach the limit, nothing before.

use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Seat};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "clipping",
    meaning: "a signal cut off at a limit",
    signature: "nothing below the limit; beyond it flat crests and a raised floor",
    example: "limit=3",
    span_hz: 5120.0,
    parameters: &[parameter("limit", "m/s2", 50.0, [1e-6, 1e6], "largest magnitude"), CHANNEL],
    build: |v| Box::new(Clipping { limit: v.get("limit"), channels: v.channels() }),
    hypotheses: &[Hypothesis {
        name: "clipping",
        plain: "signal limited from above and below",
        seats: &[Seat::Record],
        quantity: "limit_of_the",
        unit: "m/s2",
        carry: per_channel,
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "clipping",
        right_names: &["clipping"],
        families: &["path"],
        reference: 0.8,
        has_floor: false,
        draw: |share, draw| {
            let channel = draw.side();
            vec![format!("clipping:limit={},channel={channel}", share * draw.peak_m_s2[channel])]
        },
        ..Hidden::DEFAULTS
    }],
};

/// One limit per channel that has one (cosine part; zero: none).
fn per_channel(f: &Fitted<'_>) -> Option<Carried> {
    let limited = f.parts.iter().enumerate().filter(|(_, [limit, _])| *limit > 0.0);
    let table = |(c, [limit, _]): (usize, &[f64; 2])| ("clipping", vec![("limit", *limit), ("channel", c as f64)]);
    Some(Carried { tables: limited.map(table).collect(), remark: None })
}

struct Clipping {
    limit: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Clipping {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        for x in sampled.channels[self.channels.clone()].iter_mut().flatten() {
            *x = x.clamp(-self.limit, self.limit);
        }
    }
}
