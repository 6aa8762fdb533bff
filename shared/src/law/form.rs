//! Bandwidth law: bandwidth of the gear vibration as a function of shaft rate, carried as data.
//!
//! Three forms. The paper's quadratic `B = a f^2 + b f + c`, and the physical `t_r^2 = (a/f)^2 + t_mode^2` with
//! `B = 0.35 / t_r`: the engagement edge takes the angle `a` (turns) of the ramp, and the structure's mode adds its own
//! rise time; and a table of knots ([`LawTable`]) where neither follows. A law is only valid for the machine and the
//! engagement ramp it was fitted on, inside its speed domain; outside, the speed is clamped to the domain and the
//! result says so.
//!
//! Source: Zhang et al. 2013, doi 10.1155/2013/462401; 0.35 is the rise-time constant of a first-order edge.

pub use crate::law::table::{LawKnot, LawTable, MAX_KNOTS};
use crate::math;
use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// Bandwidth times 10-90 % rise time of a first-order edge.
pub const RISE_TIME_CONSTANT: f32 = 0.35;

/// Functional form of a law with its constants.
// Laws are copied seldom, and there is no heap to put the table on.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum LawForm {
    /// `B = a f^2 + b f + c`, Hz, with f in Hz.
    Quadratic {
        /// Curvature, 1/Hz.
        a_per_hz: f32,
        /// Slope, Hz per Hz.
        b: f32,
        /// Bandwidth at standstill, Hz.
        c_hz: f32,
    },
    /// `t_r^2 = (a / f)^2 + t_mode^2`, `B = 0.35 / t_r`.
    Physical {
        /// Ramp angle of the engagement edge, turns of the pinion.
        ramp_turns: f32,
        /// Rise time of the dominant mode, s.
        mode_rise_s: f32,
    },
    /// Monotone cubic through knots, in logarithms.
    Tabulated(LawTable),
}

/// What engagement ramp the law was fitted with; the bandwidth follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RampDescription {
    /// The step of the paper's stiffness table (preset).
    PaperTable,
    /// Tip relief of the declared machine.
    TipRelief,
    /// Loaded contact outside the theoretical path.
    LoadedContact,
    /// Fitted to measured edges, no ramp model.
    Measured,
    /// Not known.
    Unknown,
}

/// A bandwidth law with everything needed to judge it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// Form and constants.
    pub form: LawForm,
    /// Lowest pinion rate the law was fitted at, Hz.
    pub lowest: Hertz,
    /// Highest pinion rate the law was fitted at, Hz.
    pub highest: Hertz,
    /// Hash of the machine description the law belongs to; zero is "no machine".
    pub machine_hash: u64,
    /// Engagement ramp of the fit.
    pub ramp: RampDescription,
    /// Relative standard uncertainty of the bandwidth inside the domain.
    pub relative_uncertainty: f32,
    /// Not fitted on any machine: a stand-in until a fitted law is loaded.
    pub provisional: bool,
}

/// Bandwidth at one speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bandwidth {
    /// Bandwidth, Hz.
    pub bandwidth: Hertz,
    /// The speed lay outside the law's domain and was clamped to it.
    pub clamped: bool,
    /// The law is provisional.
    pub provisional: bool,
}

/// Why a law is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LawError {
    /// A constant is not a finite number.
    NotFinite,
    /// The speed domain is empty, or not inside 0 to 1000 Hz.
    Domain,
    /// The bandwidth is not positive everywhere in the domain, or over 10 MHz.
    Bandwidth,
    /// The relative uncertainty is negative or above one.
    Uncertainty,
    /// A table without two knots, or with knots that do not ascend or are not positive.
    Table,
}

impl Law {
    /// The one bandwidth of the paper whose value survives, 42.07 kHz at an inferred 14.5 Hz, taken proportional to
    /// speed. Provisional: to be replaced by a law fitted on the machine.
    pub const PROVISIONAL: Law = Law {
        form: LawForm::Quadratic { a_per_hz: 0.0, b: 42_070.0 / 14.5, c_hz: 0.0 },
        lowest: Hertz(0.5),
        highest: Hertz(25.0),
        machine_hash: 0,
        ramp: RampDescription::PaperTable,
        relative_uncertainty: 0.5,
        provisional: true,
    };

    /// Bandwidth at a pinion rate; speeds outside the domain, and undefined ones (taken as the highest), are clamped.
    pub fn bandwidth(&self, pinion: Hertz) -> Bandwidth {
        let inside = if pinion.0 >= self.lowest.0 && pinion.0 <= self.highest.0 {
            pinion.0
        } else if pinion.0 < self.lowest.0 {
            self.lowest.0
        } else {
            self.highest.0
        };
        Bandwidth {
            bandwidth: Hertz(self.form.evaluate(inside)),
            clamped: inside != pinion.0,
            provisional: self.provisional,
        }
    }

    /// Checks constants, domain and the sign of the bandwidth over the domain.
    pub fn validate(&self) -> Result<(), LawError> {
        let (lowest, highest) = (self.lowest.0, self.highest.0);
        if !self.form.is_finite() {
            return Err(LawError::NotFinite);
        }
        if let LawForm::Tabulated(table) = &self.form
            && !table.is_sound()
        {
            return Err(LawError::Table);
        }
        if !(lowest > 0.0 && lowest < highest && highest <= 1000.0) {
            return Err(LawError::Domain);
        }
        if !(0.0..=1.0).contains(&self.relative_uncertainty) {
            return Err(LawError::Uncertainty);
        }
        // A quadratic over an interval is bounded by its ends and its vertex; 33 points catch the vertex closely enough
        // for a sanity check; the physical form and the table are bounded by their ends and knots.
        for step in 0..=32 {
            let speed = lowest + (highest - lowest) * (step as f32 / 32.0);
            let bandwidth = self.form.evaluate(speed);
            if !(bandwidth > 0.0 && bandwidth < 1.0e7) {
                return Err(LawError::Bandwidth);
            }
        }
        Ok(())
    }
}

impl LawForm {
    fn evaluate(&self, f: f32) -> f32 {
        match *self {
            LawForm::Quadratic { a_per_hz, b, c_hz } => (a_per_hz * f + b) * f + c_hz,
            LawForm::Physical { ramp_turns, mode_rise_s } => {
                let ramp_s = ramp_turns / f;
                RISE_TIME_CONSTANT / math::sqrt(ramp_s * ramp_s + mode_rise_s * mode_rise_s)
            }
            LawForm::Tabulated(ref table) => table.evaluate(f),
        }
    }

    fn is_finite(&self) -> bool {
        match *self {
            LawForm::Quadratic { a_per_hz, b, c_hz } => a_per_hz.is_finite() && b.is_finite() && c_hz.is_finite(),
            LawForm::Physical { ramp_turns, mode_rise_s } => ramp_turns.is_finite() && mode_rise_s.is_finite(),
            // Judged by its own check.
            LawForm::Tabulated(_) => true,
        }
    }
}
