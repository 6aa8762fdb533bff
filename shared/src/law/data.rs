//! The law of `machines/paper-rig.toml`. Generated, do not edit:
//! `meshband law export machines/paper-rig.toml -o shared/src/law/data.rs`.

use crate::law::{Law, LawForm, LawKnot, LawTable, RampDescription};
use crate::units::Hertz;

/// Pinion rate, Hz, and bandwidth, Hz.
pub const KNOTS: [(f32, f32); 24] = [
    (1.0, 13000.2),
    (1.25749, 12699.3),
    (1.30766, 12599.0),
    (1.35983, 12554.1),
    (1.41408, 12460.2),
    (1.63521, 12164.2),
    (1.71956, 11999.8),
    (1.79818, 11924.8),
    (1.90153, 11691.1),
    (2.03342, 11508.2),
    (2.1383, 11280.4),
    (2.37784, 10804.4),
    (2.55701, 10285.5),
    (2.65902, 10014.0),
    (2.81184, 9397.44),
    (2.85938, 9113.79),
    (2.89152, 8902.22),
    (2.92402, 8972.13),
    (2.97345, 9083.6),
    (3.12683, 9460.27),
    (3.69754, 10945.0),
    (6.01257, 17497.8),
    (9.50764, 27603.5),
    (25.0, 72552.5),
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
        machine_hash: 0xd02343aecaaabbd5,
        ramp: RampDescription::PaperTable,
        relative_uncertainty: 0.00423416,
        provisional: false,
    }
}
