//! Torque ripple of the motor: at an order of the pinion's shaft, or at a fixed frequency.
//!
//! Signature: a line at the order (moves with speed) or frequency (fixed), sidebands of it around the mesh.

use super::hypothesis::{Hidden, Hypothesis, Seat, Site, Wave, one};
use super::{Entry, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Forces, Moment, Place, Recurrence};
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "torque-ripple",
    meaning: "motor torque with a sinusoidal part",
    signature: "a line at the order or frequency and sidebands of it around the mesh; proportional to torque",
    example: "depth=0.3,frequency=47",
    span_hz: 500.0,
    parameters: &[
        Parameter { name: "depth", unit: "", default: 0.05, range: [0.0, 10.0], meaning: "amplitude over mean torque" },
        Parameter { name: "order", unit: "", default: 0.0, range: [0.0, 1000.0], meaning: "per pinion turn; 0: none" },
        Parameter { name: "frequency", unit: "Hz", default: 0.0, range: [0.0, 1e5], meaning: "fixed part of the rate" },
        PHASE,
    ],
    build: |v| {
        let [depth, order, frequency_hz, phase_rad] = ["depth", "order", "frequency", "phase"].map(|n| v.get(n));
        Box::new(TorqueRipple { depth, order, frequency_hz, phase_rad })
    },
    hypotheses: &[
        Hypothesis {
            name: "torque-ripple",
            seats: &[Seat::Wave(Wave::Force { at: Site::Motor, speed: 0, torque: 1 })],
            quantity: "share_of_torque",
            carry: |f| Some(one("torque-ripple", [("depth", f.size), f.rate(0)?, f.phase(0.0)])),
            ..Hypothesis::DEFAULTS
        },
        Hypothesis {
            name: "torque-ripple",
            seats: &[Seat::Wave(Wave::Force { at: Site::Motor, speed: 0, torque: 0 })],
            quantity: "torque",
            unit: "N m",
            ..Hypothesis::DEFAULTS
        },
    ],
    hidden: &[Hidden {
        name: "torque-ripple",
        right_names: &["torque-ripple"],
        families: &["shaft-order", "sideband", "non-integer-order"],
        reference: 0.05,
        parameter: "share_of_torque",
        draw: |size, draw| {
            let order = 3 + draw.below(6);
            vec![format!("torque-ripple:depth={size},order={order},phase={}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

struct TorqueRipple {
    depth: f64,
    order: f64,
    frequency_hz: f64,
    phase_rad: f64,
}

impl Effect for TorqueRipple {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(0, self.order, self.frequency_hz)
    }

    fn force(&self, moment: &Moment, forces: &mut Forces) {
        let mut phase = moment.time_s().scaled(TAU * self.frequency_hz);
        phase.add_scaled(&moment.angle_rad[0], self.order);
        phase.add_constant(self.phase_rad);
        forces.add(Place::Motor, phase.sin_cos().1.scaled(self.depth * moment.facts.input_torque_n_m));
    }
}
