//! Errors and faults at any gear of a train, as the meshes of that gear feel them.
//!
//! A gear's errors follow its teeth: every mesh knows which tooth of either gear its pairs meet, so one cause at a sun
//! comes by at each planet in turn. Errors are along the line of action, positive where they open a gap; the flank
//! force is `k (d - e) + c (d' - e')`. Runout adds on the one flank what it takes from the other, which matters where
//! both are loaded, and carries the contact along its path, as the pair's eccentricity does. A tooth's displacement
//! and its loss of stiffness take part in its pair's share of the load and so come and go as the pair does.

use crate::assembly::{MeshLine, System};
use crate::stiffness::MeshStiffness;
use crate::{Error, Result};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Amplitudes of errors, m.
const ERRORS_M: RangeInclusive<f64> = -1e-3..=1e-3;
/// Shares of stiffness that a tooth may lose.
const LOSSES: RangeInclusive<f64> = 0.0..=0.99;

/// A gear of the train; of planets one of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seat {
    /// Index among the train's gears.
    pub gear: usize,
    /// Number of the planet from 0, where the gear is a planet.
    pub planet: Option<usize>,
}

/// One effect at one gear.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// The pitch circle runs out: an error once per turn.
    Runout {
        /// Its gear.
        at: Seat,
        /// Amplitude, m.
        amplitude_m: f64,
        /// Phase at tooth 0, turns.
        phase_turns: f64,
    },
    /// An error some whole number of times per turn: ghost of the machine that cut the gear.
    Ghost {
        /// Its gear.
        at: Seat,
        /// Times per turn.
        order: u32,
        /// Amplitude, m.
        amplitude_m: f64,
        /// Phase at tooth 0, turns.
        phase_turns: f64,
    },
    /// Errors of single pitches, one per tooth, m.
    Pitch {
        /// Its gear.
        at: Seat,
        /// Error of each tooth, m.
        errors_m: Vec<f64>,
    },
    /// One tooth's flank is displaced: wear or a spall opens a gap, a burr closes it.
    ToothError {
        /// Its gear.
        at: Seat,
        /// Its tooth.
        tooth: u32,
        /// Error while the tooth carries, m.
        error_m: f64,
    },
    /// One tooth is soft: a crack in its root.
    ToothStiffness {
        /// Its gear.
        at: Seat,
        /// Its tooth.
        tooth: u32,
        /// Share of its pairs' stiffness that is lost, 0 to 1.
        loss: f64,
    },
}

/// A sinusoidal error over the passage of pairs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wave {
    /// Cycles per pair.
    pub cycles: f64,
    /// Amplitude, m.
    pub amplitude_m: f64,
    /// Phase at position 0, rad.
    pub phase_rad: f64,
    /// Base pitches by which an error of 1 m rolls the contact along its path.
    pub roll_per_m: f64,
}

/// What single teeth of one side of a mesh do to their pairs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Teeth {
    /// Number of the pair in which tooth 0 meets.
    pub first_pair: i64,
    /// Error of each tooth, m.
    pub errors_m: Vec<f64>,
    /// Share of stiffness that each tooth has lost.
    pub losses: Vec<f64>,
}

/// Everything that disturbs one mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Disturbance {
    /// Errors of all pairs alike.
    pub waves: Vec<Wave>,
    /// Errors of single teeth.
    pub teeth: Vec<Teeth>,
}

impl Disturbance {
    /// Of one mesh under these effects.
    pub fn of(system: &System, mesh: &MeshLine, effects: &[Effect]) -> Self {
        let mut own = Self::default();
        for (i, &amplitude_m) in mesh.transmission_error_m.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            own.waves.push(Wave { cycles: (i + 1) as f64, amplitude_m, phase_rad: 0.0, roll_per_m: 0.0 });
        }
        let curves = &system.stiffnesses[mesh.stiffness];
        for effect in effects {
            let seat = effect.seat();
            for side in (0..2).filter(|&side| mesh.gears[side] == seat.gear) {
                let is_planet = system.bodies[mesh.bodies[side]].is_planet();
                if !is_planet || seat.planet == mesh.planet {
                    own.add(effect, mesh, side, curves);
                }
            }
        }
        own
    }

    fn add(&mut self, effect: &Effect, mesh: &MeshLine, side: usize, curves: &MeshStiffness) {
        let (teeth, first_pair) = (mesh.teeth[side], mesh.first_pairs[side]);
        let mut wave = |order: u32, amplitude_m: f64, phase_turns: f64, roll_per_m: f64| {
            let cycles = f64::from(order) / f64::from(teeth);
            let phase_rad = TAU * (phase_turns - cycles * (curves.pitch_point + first_pair as f64));
            self.waves.push(Wave { cycles, amplitude_m, phase_rad, roll_per_m });
        };
        // The flanks of the driver's and of the driven gear's teeth in a mesh face one another.
        let flank = if side == 0 { -1.0 } else { 1.0 };
        let none = || vec![0.0; teeth as usize];
        match effect {
            Effect::Runout { amplitude_m, phase_turns, .. } => {
                wave(1, flank * amplitude_m, *phase_turns, 1.0 / curves.base_pitch_m);
            }
            Effect::Ghost { order, amplitude_m, phase_turns, .. } => wave(*order, *amplitude_m, *phase_turns, 0.0),
            Effect::Pitch { errors_m, .. } => {
                self.teeth.push(Teeth { first_pair, errors_m: errors_m.clone(), losses: none() });
            }
            Effect::ToothError { tooth, error_m, .. } => {
                let mut errors_m = none();
                errors_m[*tooth as usize] = *error_m;
                self.teeth.push(Teeth { first_pair, errors_m, losses: none() });
            }
            Effect::ToothStiffness { tooth, loss, .. } => {
                let mut losses = none();
                losses[*tooth as usize] = *loss;
                self.teeth.push(Teeth { first_pair, errors_m: none(), losses });
            }
        }
    }
}

impl Teeth {
    /// Error, m, and lost share of stiffness of a pair.
    pub fn of_pair(&self, number: i64) -> (f64, f64) {
        let tooth = (number - self.first_pair).rem_euclid(self.errors_m.len() as i64) as usize;
        (self.errors_m[tooth], self.losses[tooth])
    }
}

impl Effect {
    /// Where it is.
    pub fn seat(&self) -> Seat {
        match self {
            Self::Runout { at, .. }
            | Self::Ghost { at, .. }
            | Self::Pitch { at, .. }
            | Self::ToothError { at, .. }
            | Self::ToothStiffness { at, .. } => *at,
        }
    }

    /// Whether the train has what the effect needs, and its values are in range.
    ///
    /// # Errors
    /// One line with effect and value.
    pub fn check(&self, system: &System) -> Result<()> {
        let refuse = |key: &str, what: String| Err(Error::invalid(format!("effect {} {key}", self.name()), what));
        let seat = self.seat();
        let meets = |mesh: &&MeshLine| {
            (0..2).any(|side| {
                let planet = system.bodies[mesh.bodies[side]].is_planet().then_some(mesh.planet).flatten();
                mesh.gears[side] == seat.gear && planet == seat.planet
            })
        };
        let Some(mesh) = system.meshes.iter().find(meets) else {
            return refuse("gear", format!("gear {} (planet {:?}) is not in this train", seat.gear, seat.planet));
        };
        let teeth = mesh.teeth[usize::from(mesh.gears[0] != seat.gear)];
        let amplitudes: &[f64] = match self {
            Self::Runout { amplitude_m, .. } | Self::Ghost { amplitude_m, .. } => std::slice::from_ref(amplitude_m),
            Self::Pitch { errors_m, .. } => errors_m,
            Self::ToothError { error_m, .. } => std::slice::from_ref(error_m),
            Self::ToothStiffness { .. } => &[],
        };
        if let Some(value) = amplitudes.iter().find(|value| !ERRORS_M.contains(*value)) {
            return refuse("amplitude", format!("{value} m is not within -0.001 to 0.001"));
        }
        match self {
            Self::Pitch { errors_m, .. } if errors_m.len() != teeth as usize => {
                refuse("errors", format!("{} values for {teeth} teeth", errors_m.len()))
            }
            Self::ToothError { tooth, .. } | Self::ToothStiffness { tooth, .. } if *tooth >= teeth => {
                refuse("tooth", format!("{tooth} is not within 0 to {}", teeth - 1))
            }
            Self::ToothStiffness { loss, .. } if !LOSSES.contains(loss) => {
                refuse("loss", format!("{loss} is not within 0 to 0.99"))
            }
            Self::Ghost { order: 0, .. } => refuse("order", "an error 0 times per turn is none".into()),
            Self::Runout { phase_turns, .. } | Self::Ghost { phase_turns, .. } if !phase_turns.is_finite() => {
                refuse("phase", "is not a finite number".into())
            }
            _ => Ok(()),
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Runout { .. } => "runout",
            Self::Ghost { .. } => "ghost",
            Self::Pitch { .. } => "pitch",
            Self::ToothError { .. } => "tooth error",
            Self::ToothStiffness { .. } => "tooth stiffness",
        }
    }
}
