//! Backlash: pairs carry only while their flanks touch, on the drive or on the coast side.
//!
//! Signature: nothing while the dynamic force stays below the static one; beyond that free flight and
//! impacts. Makes the equations piecewise linear: contact changes are root-found.

use super::{Entry, Parameter};
use crate::dynamics::excitation::{Backlash as Clearance, Effect};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "backlash",
    meaning: "contact loss, and contact of the coast flanks beyond the clearance",
    signature: "nothing while the mesh force stays positive; beyond that impacts over a wide band",
    example: "clearance=50e-6",
    span_hz: 5120.0,
    parameters: &[Parameter {
        name: "clearance",
        unit: "m",
        default: 100e-6,
        range: [0.0, 1e-2],
        meaning: "between drive and coast flank along the line of action",
    }],
    build: |v| Box::new(Backlash { clearance_m: v.get("clearance") }),
    hypotheses: &[],
    hidden: &[],
};

struct Backlash {
    clearance_m: f64,
}

impl Effect for Backlash {
    fn backlash(&self) -> Option<Clearance> {
        Some(Clearance { clearance_m: self.clearance_m })
    }
}
