//! Integration of a train by Taylor series: explicit, of the order that a step needs, ended at every knot of a mesh.
//!
//! Between two knots of all meshes the equations have analytic coefficients, so a step's series is as good as its last
//! term is small; of a step only the part within the tolerance is used. The polynomial is the dense output. Methods of
//! low order, explicit or implicit, would need far more steps for the same error. The powers of a long step cancel,
//! which leaves about 1e-10 of the largest acceleration at the default tolerance. Contact is linear: a mesh whose force
//! becomes negative pulls, which [`Statistics`] reports.

use crate::assembly::System;
use crate::effects::Effect;
use crate::expansion::Expansion;
use crate::terms::Terms;
use crate::{Error, Result};
pub use meshband_mechanics::dynamics::taylor::Options;
use meshband_mechanics::dynamics::{Motion, Series};

/// Truncation error of a step's acceleration, relative to the largest so far: long steps cancel to 1e-10.
const TOLERANCE: f64 = 1e-9;

/// Accuracy and limits of a train's integration.
pub fn options() -> Options {
    Options { tolerance: TOLERANCE, ..Options::default() }
}

/// What an integration took, and whether teeth pulled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// Steps.
    pub steps: u64,
    /// Orders computed.
    pub orders: u64,
    /// Least mesh force at the start of any step, N.
    pub least_mesh_force_n: f64,
}

/// Deflections, m or rad, and velocities.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Deflections.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
}

/// A train under way.
#[derive(Debug, Clone, Copy)]
pub struct Course<'a> {
    /// The train.
    pub system: &'a System,
    /// Motion of shaft 0, whose speed stays positive.
    pub motion: &'a Motion,
    /// Torque of the load, N m.
    pub load_torque_n_m: f64,
    /// Effects.
    pub effects: &'a [Effect],
}

/// A finished step.
pub struct Step<'s> {
    /// Start, s.
    pub start_s: f64,
    /// Unit of the series' time, s.
    pub length_s: f64,
    /// Part of the unit for which the step is valid, up to 1.
    pub end: f64,
    expansion: &'s Expansion,
}

impl Step<'_> {
    /// Deflection of a coordinate.
    pub fn deflection(&self, coordinate: usize) -> Series {
        self.expansion.deflection(coordinate)
    }

    /// Acceleration of a coordinate.
    pub fn acceleration(&self, coordinate: usize) -> Series {
        let second = self.deflection(coordinate).derivative().derivative();
        second.scaled(1.0 / (self.length_s * self.length_s))
    }

    /// Force of a mesh, N.
    pub fn force(&self, mesh: usize) -> Series {
        self.expansion.force(mesh)
    }
}

impl Course<'_> {
    /// The state that a constant load at mean stiffness gives, at rest.
    ///
    /// # Errors
    /// As [`System::static_deflection`].
    pub fn start(&self) -> Result<State> {
        let q: Vec<f64> = self.system.static_deflection(self.load_torque_n_m)?.iter().copied().collect();
        Ok(State { v: vec![0.0; q.len()], q })
    }

    /// Integrates a state from one time to another, s, calling `sink` for every step.
    ///
    /// # Errors
    /// A motion that does not go forward, a step below its limit, values beyond the range of numbers.
    pub fn integrate(
        &self,
        state: &mut State,
        (from_s, to_s): (f64, f64),
        options: &Options,
        mut sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        let mut terms = Terms::new(self.system, self.motion, self.effects);
        let mut expansion = Expansion::new(self.system, self.load_torque_n_m);
        let mut statistics = Statistics { steps: 0, orders: 0, least_mesh_force_n: f64::INFINITY };
        let mut scale = expansion.load_norm();
        let (mut t, mut usable) = (from_s, options.longest_step_s);
        let clock = 4.0 * f64::EPSILON * from_s.abs().max(to_s.abs()).max(1e-6);
        while to_s - t > clock {
            if self.motion.speed_hz(t) <= 0.0 {
                return Err(Error::invalid("speed", format!("does not go forward at {t:.6} s")));
            }
            let longest = (to_s - t).min(1.25 * usable).min(options.longest_step_s);
            let h = terms.begin(t, longest);
            scale = scale.max(expansion.compute(&terms, [&state.q, &state.v], h, options.tolerance * scale));
            let limit = expansion.usable_part(options.tolerance * scale);
            let end = limit.min(1.0);
            // A term beyond the range of numbers, or a part far too small: a tenth of the step is tried.
            if limit * h < options.shortest_step_s && h >= options.shortest_step_s {
                usable = 0.1 * h;
                if usable < options.shortest_step_s {
                    let what = format!("step below {} s at {t:.6} s: the train is too stiff", options.shortest_step_s);
                    return Err(Error::impossible("train dynamics", what));
                }
                continue;
            }
            // A step that a knot cut short says little of how long the next one may be.
            usable = if limit < 1.0 { limit * h } else { usable.max(limit.min(8.0) * h) };
            sink(&Step { start_s: t, length_s: h, end, expansion: &expansion });
            let forces = (0..self.system.meshes.len()).map(|mesh| expansion.first_force(mesh));
            statistics.least_mesh_force_n = forces.fold(statistics.least_mesh_force_n, f64::min);
            expansion.state(end, h, &mut state.q, &mut state.v);
            statistics.steps += 1;
            statistics.orders += (expansion.degree - 1) as u64;
            t += end * h;
            if state.q.iter().chain(&state.v).any(|x| !x.is_finite()) {
                return Err(Error::impossible("train dynamics", format!("the motion is not finite at {t:.6} s")));
            }
        }
        Ok(statistics)
    }
}
