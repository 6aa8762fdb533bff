//! Wobble: a gear whose face runs out of true, so that its contact gives way at one end of the face once per turn.
//!
//! A tilted blank, bent shaft or clamping error adds a lead slope that turns with the gear to the slope that mounting
//! leaves. Where slopes leave the face in partial contact, the width that carries, and with it the pair's stiffness
//! under a given load, goes with the inverse root of the slope (ISO 6336-1:2006, 7:
//! `b_cal / b = sqrt(2 F_m / (b F_beta c_gamma))` below full contact), so that of a slope `1 + r cos(angle)` times
//! its mean the stiffness is `(1 + r cos(angle))^(-1/2)` times the declared: at once per turn `r / 2`, at twice
//! `3 r^2 / 16`. Signature: sidebands of the shaft rate and its double around the mesh harmonics, proportional to
//! torque. Limits: the declared stiffness is that of the mean slope; spur teeth; the end's own runout is an
//! eccentricity's to describe.

use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, GEAR, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;
use std::f64::consts::PI;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "wobble",
    meaning: "a gear whose face runs out of true, so that the width in contact varies once per turn",
    signature: "sidebands of the shaft rate and its double around the mesh harmonics; proportional to torque",
    example: "ratio=0.5",
    span_hz: 500.0,
    parameters: &[
        parameter("ratio", "", 0.2, [0.0, 0.95], "lead slope that turns with the gear over the one that stands"),
        PHASE,
        GEAR,
    ],
    build: |v| Box::new(Wobble { ratio: v.get("ratio"), phase_rad: v.get("phase"), body: v.body() }),
    hypotheses: &[WOBBLE, Hypothesis { name: "gear-wobble", at: Where::Multiple(1, 1.0), ..WOBBLE }],
    hidden: &[
        Hidden {
            name: "pinion-wobble",
            right_names: &["pinion-wobble"],
            reference: 0.02,
            draw: |size, draw| vec![format!("wobble:ratio={},phase={}", size.min(0.95), draw.phase())],
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "gear-wobble",
            right_names: &["gear-wobble"],
            reference: 0.02,
            draw: |size, draw| vec![format!("wobble:ratio={},phase={},gear=1", size.min(0.95), draw.phase())],
            ..Hidden::DEFAULTS
        },
    ],
};

const WOBBLE: Hypothesis = Hypothesis {
    name: "pinion-wobble",
    seats: &[Seat::Wave(Wave::MeshStiffness)],
    at: Where::Multiple(0, 1.0),
    quantity: "share_of_stiffness_once_per_turn",
    bends: true,
    carry: carried,
    ..Hypothesis::DEFAULTS
};

/// The stiffness is least where the slope is largest.
fn carried(f: &Fitted<'_>) -> Option<Carried> {
    let body = f64::from(u8::from(!Where::Multiple(0, 1.0).holds(f.order, f.ratio())));
    Some(one("wobble", [("ratio", 2.0 * f.size), f.phase(PI), ("gear", body)]))
}

struct Wobble {
    ratio: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for Wobble {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn pair_stiffness(&self, moment: &Moment, _pair: &PairOnPath, stiffness: &mut Series) {
        let mut angle = moment.angle_rad[self.body];
        angle.add_constant(self.phase_rad);
        let mut slope = angle.sin_cos().1.scaled(self.ratio);
        slope.add_constant(1.0);
        *stiffness = stiffness.quotient(&slope.sqrt());
    }
}
