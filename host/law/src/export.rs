//! The law as Rust constants for the node: a generated file of the `meshband` crate.

use super::file::LawFile;
use super::forms::Law;
use crate::{Error, Result};
use std::fmt::Write;

/// The source text of `shared/src/law/data.rs` for a tabulated law.
///
/// # Errors
/// Another form, or a law that a node would refuse.
pub fn rust_source(file: &LawFile, machine_path: &str) -> Result<String> {
    let Law::Tabulated { knots } = &file.law else {
        return Err(Error::invalid("[law] form", "only the tabulated form is exported"));
    };
    let node = file.for_node()?;
    let mut rows = String::new();
    for (speed, bandwidth) in knots {
        let _ = writeln!(rows, "    ({:?}, {:?}),", *speed as f32, *bandwidth as f32);
    }
    Ok(format!(
        "//! The law of `{path}`. Generated, do not edit:\n\
         //! `meshband law export {path} -o shared/src/law/data.rs`.\n\
         \n\
         use crate::law::{{Law, LawForm, LawKnot, LawTable, RampDescription}};\n\
         use crate::units::Hertz;\n\
         \n\
         /// Pinion rate, Hz, and bandwidth, Hz.\n\
         pub const KNOTS: [(f32, f32); {count}] = [\n{rows}];\n\
         \n\
         /// The fitted law.\n\
         pub fn law() -> Law {{\n    \
             let knots = KNOTS.map(|(speed, bandwidth)| LawKnot \
             {{ speed: Hertz(speed), bandwidth: Hertz(bandwidth) }});\n    \
             // The knots are sound (a test holds it); the provisional law is the answer that needs no panic.\n    \
             let Ok(table) = LawTable::new(&knots) else {{ return Law::PROVISIONAL }};\n    \
             Law {{\n        \
                 form: LawForm::Tabulated(table),\n        \
                 lowest: Hertz({lowest:?}),\n        \
                 highest: Hertz({highest:?}),\n        \
                 machine_hash: {hash:#x},\n        \
                 ramp: RampDescription::{ramp:?},\n        \
                 relative_uncertainty: {uncertainty:?},\n        \
                 provisional: false,\n    \
             }}\n\
         }}\n",
        path = machine_path,
        count = knots.len(),
        lowest = node.lowest.0,
        highest = node.highest.0,
        hash = node.machine_hash,
        ramp = node.ramp,
        uncertainty = node.relative_uncertainty,
    ))
}
