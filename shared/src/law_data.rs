//! The law of `machines/paper-rig.toml`. Generated, do not edit:
//! `meshband law export machines/paper-rig.toml -o shared/src/law_data.rs`.

use crate::law::{Law, LawForm, LawKnot, LawTable, RampDescription};
use crate::units::Hertz;

/// Pinion rate, Hz, and bandwidth, Hz.
pub const KNOTS: [(f32, f32); 24] = [
    (1.0, 13007.6),
    (1.09966, 12884.5),
    (1.33722, 12575.6),
    (1.6261, 12164.3),
    (1.81839, 11862.7),
    (2.07938, 11405.0),
    (2.36458, 10809.8),
    (2.5145, 10432.7),
    (2.62947, 10093.7),
    (2.74969, 9660.94),
    (2.81184, 9381.64),
    (2.85938, 9119.82),
    (2.87541, 9015.97),
    (2.89152, 8905.08),
    (2.90772, 8940.63),
    (2.92402, 8976.78),
    (2.97345, 9088.74),
    (3.12683, 9453.97),
    (3.45772, 10301.2),
    (3.69754, 10944.6),
    (4.27577, 12545.3),
    (6.04627, 17595.2),
    (9.72256, 28220.6),
    (25.0, 72532.9),
];

/// The fitted law.
pub fn law() -> Law {
    let knots = KNOTS.map(|(speed, bandwidth)| LawKnot { speed: Hertz(speed), bandwidth: Hertz(bandwidth) });
    // The knots are sound (a test holds it); the provisional law is the answer that needs no panic.
    let Ok(table) = LawTable::new(&knots) else { return Law::PROVISIONAL };
    Law {
        form: LawForm::Tabulated(table),
        lowest: Hertz(1.0),
        highest: Hertz(25.0),
        machine_hash: 0xdc44544bcc1622f5,
        ramp: RampDescription::PaperTable,
        relative_uncertainty: 0.00170098,
        provisional: false,
    }
}
