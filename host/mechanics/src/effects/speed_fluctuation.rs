//! Speed fluctuation: the shaft's angle swings about its steady advance, at an order or a fixed frequency.
//!
//! The swing moves the contact and every order-locked excitation, and the tach sees it. Signature: frequency
//! modulation, hence sidebands of the rate around the n-th mesh harmonic that grow with n.

use super::hypothesis::{Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Recurrence};
use crate::dynamics::series::Series;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "speed-fluctuation",
    meaning: "a swing of the shaft's angle about its steady advance",
    signature: "sidebands of the rate around mesh harmonics, growing with the harmonic's number",
    example: "angle=0.01,frequency=3",
    span_hz: 1000.0,
    parameters: &[
        parameter("angle", "rad", 1e-3, [0.0, 1.0], "amplitude of the pinion's angle"),
        parameter("order", "", 0.0, [0.0, 2000.0], "per turn of the pinion; 0: none"),
        parameter("frequency", "Hz", 0.0, [0.0, 1e4], "fixed part of the rate"),
        PHASE,
    ],
    build: |v| {
        let [angle_rad, order, frequency_hz, phase_rad] = ["angle", "order", "frequency", "phase"].map(|n| v.get(n));
        Box::new(SpeedFluctuation { angle_rad, order, frequency_hz, phase_rad })
    },
    hypotheses: &[
        Hypothesis {
            name: "speed-fluctuation",
            seats: &[Seat::Wave(Wave::Position)],
            // At a whole order of a shaft the contact is carried by that shaft's geometry, not by its speed.
            at: Where::NeitherShaft { fixed: true },
            quantity: "contact_position",
            unit: "base pitch",
            bends: true,
            in_the_angle: true,
            carry: |f| {
                let angle = TAU * f.size / f64::from(f.teeth[0]);
                Some(one("speed-fluctuation", [("angle", angle), f.rate(0)?, f.phase(FRAC_PI_2)]))
            },
            ..Hypothesis::DEFAULTS
        },
        Hypothesis {
            name: "speed-fluctuation",
            plain: "angle moving within the runs",
            seats: &[Seat::Record],
            ..Hypothesis::DEFAULTS
        },
    ],
    hidden: &[Hidden {
        name: "speed-fluctuation",
        right_names: &["speed-fluctuation"],
        families: &["non-stationary", "fixed-frequency", "sideband"],
        reference: 1e-3,
        draw: |size, draw| vec![format!("speed-fluctuation:angle={size},frequency={}", 2.5 + 6.0 * draw.share())],
        ..Hidden::DEFAULTS
    }],
};

struct SpeedFluctuation {
    angle_rad: f64,
    order: f64,
    frequency_hz: f64,
    phase_rad: f64,
}

impl Effect for SpeedFluctuation {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(0, self.order, self.frequency_hz)
    }

    fn turns(&self, start_s: f64, length_s: f64, turns: &mut Series) {
        let mut phase = Series::linear(start_s, length_s).scaled(TAU * self.frequency_hz);
        phase.add_scaled(turns, TAU * self.order);
        phase.add_constant(self.phase_rad);
        turns.add_scaled(&phase.sin_cos().0, self.angle_rad / TAU);
    }
}
