//! Load fluctuation: the load's torque has a sinusoidal part, at an order of the gear's shaft or a fixed frequency.
//!
//! Signature: a line at the rate, and amplitude modulation of the mesh harmonics at that rate: mesh force
//! follows the load. Proportional to the mean torque.

use super::hypothesis::{Carried, Fitted, HUNTING, Hidden, Hypothesis, Seat, Site, Wave, one};
use super::{Entry, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Forces, Moment, Place, Recurrence};
use std::f64::consts::{PI, TAU};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "load-fluctuation",
    meaning: "load torque with a sinusoidal part",
    signature: "a line at the rate and sidebands of it around the mesh; proportional to torque",
    example: "depth=0.3,frequency=7",
    span_hz: 500.0,
    parameters: &[
        parameter("depth", "", 0.05, [0.0, 10.0], "amplitude over mean load torque"),
        parameter("order", "", 0.0, [0.0, 1000.0], "per turn of the gear; 0: none"),
        parameter("frequency", "Hz", 0.0, [0.0, 1e5], "fixed part of the rate"),
        PHASE,
    ],
    build: |v| {
        let [depth, order, frequency_hz, phase_rad] = ["depth", "order", "frequency", "phase"].map(|n| v.get(n));
        Box::new(LoadFluctuation { depth, order, frequency_hz, phase_rad })
    },
    hypotheses: &[
        Hypothesis {
            name: "load-fluctuation",
            seats: &[Seat::Wave(Wave::Force { at: Site::Load, speed: 0, torque: 1 })],
            quantity: "share_of_torque",
            carry: braking,
            ..Hypothesis::DEFAULTS
        },
        Hypothesis {
            name: "load-fluctuation",
            seats: &[Seat::Wave(Wave::Force { at: Site::Load, speed: 0, torque: 0 })],
            quantity: "torque",
            unit: "N m",
            ..Hypothesis::DEFAULTS
        },
    ],
    hidden: &[Hidden {
        name: "load-fluctuation",
        right_names: &["load-fluctuation"],
        families: &["shaft-order", "sideband", "non-integer-order"],
        reference: 0.05,
        parameter: "share_of_torque",
        draw: |size, draw| {
            let order = draw.odd_order();
            let order = draw.per_turn(order, 1);
            vec![format!("load-fluctuation:depth={size},order={order},phase={}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

/// The load brakes; its order counts per turn of the gear.
fn braking(f: &Fitted<'_>) -> Option<Carried> {
    let remark = f.order.map(|_| HUNTING.into());
    Some(Carried { remark, ..one("load-fluctuation", [("depth", f.size), f.rate(1)?, f.phase(PI)]) })
}

struct LoadFluctuation {
    depth: f64,
    order: f64,
    frequency_hz: f64,
    phase_rad: f64,
}

impl Effect for LoadFluctuation {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(1, self.order, self.frequency_hz)
    }

    fn force(&self, moment: &Moment, forces: &mut Forces) {
        let mut phase = moment.time_s().scaled(TAU * self.frequency_hz);
        phase.add_scaled(&moment.angle_rad[1], self.order);
        phase.add_constant(self.phase_rad);
        let [z1, z2] = moment.facts.teeth.map(f64::from);
        // The load brakes: its torque acts against the driven sense.
        forces.add(Place::Load, phase.sin_cos().1.scaled(-self.depth * moment.facts.input_torque_n_m * z2 / z1));
    }
}
