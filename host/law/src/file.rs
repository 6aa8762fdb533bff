//! law.toml: a fitted law with everything needed to judge it, and its way to a node.
//!
//! The file holds what [`meshband::law::Law`] holds, in f64 and with names for people. Reading it checks what the
//! node would check, so that a law that a node refuses is refused here first, with the key named.
//!
//! ```toml
//! machine = "paper-rig"
//! machine_hash = "0x1234567890abcdef"
//! ramp = "paper"
//! domain_hz = [1.0, 25.0]
//! relative_uncertainty = 0.005
//! [law]
//! form = "tabulated"
//! knots = [[1.0, 13000.0], [25.0, 72500.0]]
//! ```

use super::forms::Law;
use crate::machine::EngagementKind;
use crate::{Error, Result};
use meshband::law::{Law as NodeLaw, LawForm, LawKnot, LawTable, RampDescription};
use meshband::units::Hertz;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What a bandwidth measured on the machine itself is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measured {
    /// 0.35 over the rise time of engagement edges, as in a simulated law.
    Edges,
    /// The frequency below which 99 % of the power locked to the shaft lies.
    Occupied,
}

/// A law as it is kept in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LawFile {
    /// Title of the machine.
    pub machine: String,
    /// Fingerprint of the machine, hexadecimal with `0x`.
    pub machine_hash: String,
    /// Engagement of the machine, as in its declaration.
    pub ramp: EngagementKind,
    /// What was measured, for a law that comes from a record of the machine; absent for a simulated one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
    /// Lowest and highest pinion speed of the fit, Hz.
    pub domain_hz: [f64; 2],
    /// Relative standard uncertainty of the bandwidth inside the domain.
    pub relative_uncertainty: f64,
    /// The law.
    pub law: Law,
}

impl LawFile {
    /// Reads a law.
    ///
    /// # Errors
    /// A file that cannot be read, is no law, or holds one that a node would refuse.
    pub fn read(path: &Path) -> Result<Self> {
        let text = crate::budget::read_text(path)?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads a law from TOML text; `place` names it in errors.
    ///
    /// # Errors
    /// As [`LawFile::read`].
    pub fn from_toml(text: &str, place: &str) -> Result<Self> {
        let file: Self =
            toml::from_str(text).map_err(|error| Error::invalid(place, error.message().replace('\n', " ")))?;
        file.for_node().map_err(|error| Error::invalid(place, error))?;
        Ok(file)
    }

    /// The text of the file.
    pub fn to_toml(&self) -> String {
        let head = format!(
            "# Bandwidth law of {}, {}.\n\
             # Valid for this machine with this engagement ramp only; bandwidths in Hz over pinion speed in Hz.\n",
            self.machine.replace(char::is_control, " "),
            match self.measured {
                None => "B = 0.35 / t_r of the edge with which a pair gives off its load",
                Some(Measured::Edges) => "measured: B = 0.35 / t_r of engagement edges",
                Some(Measured::Occupied) => "measured: B holds 99 % of the power locked to the shaft",
            }
        );
        head + &toml::to_string(self).expect("plain data")
    }

    /// Fingerprint of the machine.
    ///
    /// # Errors
    /// Text that is no hexadecimal number.
    pub fn hash(&self) -> Result<u64> {
        let digits = self.machine_hash.strip_prefix("0x").unwrap_or(&self.machine_hash);
        u64::from_str_radix(digits, 16)
            .map_err(|_| Error::invalid("machine_hash", format!("`{}` is not a hexadecimal number", self.machine_hash)))
    }

    /// The law as a node carries it.
    ///
    /// # Errors
    /// A form that a node does not have (ramp-through-mode), or what [`meshband::law::Law::validate`] refuses.
    pub fn for_node(&self) -> Result<NodeLaw> {
        let form = match &self.law {
            &Law::Quadratic { a, b, c } => LawForm::Quadratic { a_per_hz: a as f32, b: b as f32, c_hz: c as f32 },
            &Law::RootSumSquare { a_turns, t_mode_s } => {
                LawForm::Physical { ramp_turns: a_turns as f32, mode_rise_s: t_mode_s as f32 }
            }
            Law::RampThroughMode { .. } => {
                return Err(Error::invalid(
                    "[law] form",
                    "a node has no ramp-through-mode form: send the tabulated one",
                ));
            }
            Law::Tabulated { knots } => {
                let knot = |&(f, b): &(f64, f64)| LawKnot { speed: Hertz(f as f32), bandwidth: Hertz(b as f32) };
                let knots: Vec<LawKnot> = knots.iter().map(knot).collect();
                let what = "a node's table has 2 to 24 knots of ascending positive speeds and positive bandwidths";
                LawForm::Tabulated(LawTable::new(&knots).map_err(|_| Error::invalid("[law] knots", what))?)
            }
        };
        let law = NodeLaw {
            form,
            lowest: Hertz(self.domain_hz[0] as f32),
            highest: Hertz(self.domain_hz[1] as f32),
            machine_hash: self.hash()?,
            ramp: match self.ramp {
                _ if self.measured.is_some() => RampDescription::Measured,
                EngagementKind::Paper => RampDescription::PaperTable,
                EngagementKind::TipRelief => RampDescription::TipRelief,
                EngagementKind::Loaded => RampDescription::LoadedContact,
                EngagementKind::None | EngagementKind::Linear | EngagementKind::RaisedCosine => {
                    RampDescription::Unknown
                }
            },
            relative_uncertainty: self.relative_uncertainty as f32,
            provisional: false,
        };
        law.validate().map_err(|error| Error::invalid("law", format!("a node would refuse it: {error:?}")))?;
        Ok(law)
    }
}
