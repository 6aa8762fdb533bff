//! The forms a bandwidth law can take, from shaft speed to engagement-edge bandwidth.
//!
//! The paper fits a parabola through its bandwidths. A parabola has no physics in it and is only valid
//! between the fitted speeds, so two forms with two physical parameters stand beside it:
//!
//! * **root-sum-square**: rise times add as squares, `t_r^2 = (a / f)^2 + t_mode^2`. This is the rule for
//!   stages in series, each of which slows the edge. Its bandwidth *levels off at high speed*.
//! * **ramp through mode**: the stiffness ramp drives an oscillator that answers on its own time. While
//!   the ramp lasts, the acceleration of the oscillator's mass follows `sin(omega t)`; it has its first
//!   extremum when the ramp ends or after a quarter period, whichever comes first:
//!   `t_r = (asin(0.9 sin theta) - asin(0.1 sin theta)) / omega`, `theta = min(omega w / (2 pi f), pi / 2)`.
//!   Short ramps give `t_r = 0.8 w / (2 pi f)`; long ramps give the mode's own edge. Its bandwidth *levels
//!   off at low speed*, which is what an acceleration does: the force acts on the mass without delay.
//!
//! Where neither holds, around the knee, the **tabulated** form follows the points themselves.
//!
//! Units: speeds Hz of the pinion shaft, bandwidths Hz, times s, ramp widths rad of the pinion.
//! Source of `0.35`: `physics.md` 1.2 (a); single pole, 10-90 %.

use super::table;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Bandwidth of a single pole times its 10-90 % rise time.
pub const RISE_TIME_PRODUCT: f64 = 0.35;

/// A bandwidth law with its coefficients.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "form", rename_all = "kebab-case")]
pub enum Law {
    /// `B = a f^2 + b f + c`, the paper's equation (10).
    Quadratic {
        /// Hz of bandwidth per Hz^2 of shaft speed.
        a: f64,
        /// Hz of bandwidth per Hz of shaft speed.
        b: f64,
        /// Hz.
        c: f64,
    },
    /// `t_r^2 = (a / f)^2 + t_mode^2`.
    RootSumSquare {
        /// Turns of the pinion the edge takes where it is limited by the ramp.
        a_turns: f64,
        /// Rise time left at infinite speed, s.
        t_mode_s: f64,
    },
    /// A linear ramp through one mode, see the module's head.
    RampThroughMode {
        /// Width of the ramp, rad of the pinion.
        ramp_rad: f64,
        /// Frequency of the mode, Hz.
        mode_hz: f64,
    },
    /// Knots with a monotone cubic between them, see [`super::table`].
    Tabulated {
        /// (shaft Hz, bandwidth Hz), ascending.
        knots: Vec<(f64, f64)>,
    },
}

impl Law {
    /// Name used in files and reports.
    pub fn name(&self) -> &'static str {
        match self {
            Law::Quadratic { .. } => "quadratic",
            Law::RootSumSquare { .. } => "root-sum-square",
            Law::RampThroughMode { .. } => "ramp-through-mode",
            Law::Tabulated { .. } => "tabulated",
        }
    }

    /// Bandwidth, Hz, at a shaft speed above 0 Hz.
    pub fn bandwidth_hz(&self, shaft_hz: f64) -> f64 {
        match self {
            Law::Quadratic { a, b, c } => (a * shaft_hz + b) * shaft_hz + c,
            Law::Tabulated { knots } => table::bandwidth_hz(knots, shaft_hz),
            _ => RISE_TIME_PRODUCT / self.rise_time_s(shaft_hz),
        }
    }

    /// Rise time, s, at a shaft speed above 0 Hz.
    pub fn rise_time_s(&self, shaft_hz: f64) -> f64 {
        match self {
            Law::Quadratic { .. } | Law::Tabulated { .. } => RISE_TIME_PRODUCT / self.bandwidth_hz(shaft_hz),
            Law::RootSumSquare { a_turns, t_mode_s } => (a_turns / shaft_hz).hypot(*t_mode_s),
            Law::RampThroughMode { ramp_rad, mode_hz } => {
                let omega = TAU * mode_hz;
                let top = (omega * ramp_rad / (TAU * shaft_hz)).min(FRAC_PI_2).sin();
                ((0.9 * top).asin() - (0.1 * top).asin()) / omega
            }
        }
    }

    /// The coefficients in the order of the variant's fields; of a table the bandwidths at its knots.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            &Law::Quadratic { a, b, c } => vec![a, b, c],
            &Law::RootSumSquare { a_turns, t_mode_s } => vec![a_turns, t_mode_s],
            &Law::RampThroughMode { ramp_rad, mode_hz } => vec![ramp_rad, mode_hz],
            Law::Tabulated { knots } => knots.iter().map(|k| k.1).collect(),
        }
    }

    /// The same form with other coefficients.
    ///
    /// # Panics
    /// If the count is not that of [`Law::coefficients`].
    pub fn with_coefficients(&self, c: &[f64]) -> Self {
        assert_eq!(c.len(), self.coefficients().len(), "as many coefficients as the form has");
        match self {
            Law::Quadratic { .. } => Law::Quadratic { a: c[0], b: c[1], c: c[2] },
            Law::RootSumSquare { .. } => Law::RootSumSquare { a_turns: c[0], t_mode_s: c[1] },
            Law::RampThroughMode { .. } => Law::RampThroughMode { ramp_rad: c[0], mode_hz: c[1] },
            Law::Tabulated { knots } => {
                Law::Tabulated { knots: knots.iter().zip(c).map(|(k, &bandwidth)| (k.0, bandwidth)).collect() }
            }
        }
    }
}
