//! Profile error: every pair's flank departs from the involute in the same way, given at the first mesh orders.
//!
//! Signature: mesh harmonics change, each at its own order; no sidebands; independent of torque.

use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Seat};
use super::{Entry, Parameter, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;
use std::f64::consts::TAU;

const AMPLITUDE: [f64; 2] = [0.0, 1e-3];

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "profile-error",
    meaning: "the same departure from the involute on every flank",
    signature: "mesh harmonics change at the orders given; no sidebands; independent of torque",
    example: "first=2e-6,third=1e-6",
    span_hz: 2000.0,
    parameters: &[
        parameter("first", "m", 1e-6, AMPLITUDE, "amplitude at the mesh order"),
        parameter("second", "m", 0.0, AMPLITUDE, "at twice the mesh order"),
        parameter("third", "m", 0.0, AMPLITUDE, "at three times the mesh order"),
        parameter("fourth", "m", 0.0, AMPLITUDE, "at four times the mesh order"),
        Parameter { meaning: "phase of all, at the start of the path", ..super::PHASE },
    ],
    build: |v| {
        let amplitudes_m = ["first", "second", "third", "fourth"].map(|n| v.get(n));
        Box::new(ProfileError { amplitudes_m, phase_rad: v.get("phase") })
    },
    hypotheses: &[Hypothesis {
        name: "profile-error",
        seats: &[Seat::MeshOrders(4)],
        quantity: "displacement",
        unit: "m",
        carry: at_mesh_orders,
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "profile-error",
        right_names: &["profile-error"],
        families: &["mesh-order"],
        reference: 5e-6,
        draw: |size, draw| {
            // The first order's default is not zero.
            let size = if draw.below(2) == 0 { format!("first={size}") } else { format!("first=0,second={size}") };
            vec![format!("profile-error:{size},phase={}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

/// One table per mesh order, as each has its own phase.
fn at_mesh_orders(f: &Fitted<'_>) -> Option<Carried> {
    let names = ["first", "second", "third", "fourth"];
    let table = |(&[a, b], name): (&[f64; 2], &'static str)| {
        // The first order's default is not zero.
        let mut keys = vec![("first", 0.0), ("phase", b.atan2(a))];
        keys.retain(|(key, _)| *key != name);
        keys.push((name, a.hypot(b)));
        ("profile-error", keys)
    };
    let tables: Vec<_> = f.parts.iter().zip(names).map(table).collect();
    (!tables.is_empty()).then_some(Carried { tables, remark: None })
}

struct ProfileError {
    amplitudes_m: [f64; 4],
    phase_rad: f64,
}

impl Effect for ProfileError {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn pair_error(&self, _moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        for (h, &amplitude) in (1..).zip(&self.amplitudes_m).filter(|(_, a)| **a != 0.0) {
            let mut phase = pair.position.scaled(TAU * f64::from(h));
            phase.add_constant(self.phase_rad);
            error.add_scaled(&phase.sin_cos().1, amplitude);
        }
    }
}
