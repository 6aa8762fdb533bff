//! What a sensor on the housing gives of a train's motion.
//!
//! A bearing's sensor takes the acceleration of its body along x or y of the housing; a body of a set moves in its
//! carrier's frame, which turns. A sensor on a set's ring housing takes the force of each planet's ring mesh over the
//! ring's mass, weighted by how near the planet is: a Hann window of the planet's place, two planet spacings long, so
//! that the weights of evenly spaced planets sum to one and a steady load gives no line (McFadden and Smith, 1985;
//! Inalpolat and Kahraman, J. Sound Vib. 323, 2009, doi 10.1016/j.jsv.2009.01.004). The direction of the force at the
//! sensor and the housing's own resonances are left out.

use crate::assembly::{Part, System};
use crate::integrate::Step;
use crate::machine::TrainMachine;
use crate::{Error, Result};
use meshband_mechanics::dynamics::Motion;
use meshband_mechanics::dynamics::sample::evaluate;
use std::f64::consts::{PI, TAU};

/// Planet spacings that the window of a planet's path is long.
const WINDOW_SPACINGS: f64 = 2.0;

/// Axis of the housing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Along x.
    X,
    /// Along y.
    Y,
}

/// A sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sensor {
    /// On the bearing of a gear, by its index in the train (no planet).
    Bearing {
        /// Its gear.
        gear: usize,
        /// Its axis.
        axis: Axis,
    },
    /// On the housing of a set's ring.
    Ring {
        /// Stage, from 0.
        stage: usize,
        /// Its place, turns from the housing's x axis.
        place_turns: f64,
    },
}

impl Sensor {
    /// On the bearing of the first gear of a shaft.
    ///
    /// # Errors
    /// A shaft without a gear.
    pub fn on_shaft(machine: &TrainMachine, shaft: usize, axis: Axis) -> Result<Self> {
        let gear = machine.train.gears_on(shaft).next();
        let gear = gear.ok_or_else(|| Error::invalid("sensor", format!("no gear is on shaft {shaft}")))?;
        Ok(Self::Bearing { gear, axis })
    }

    /// In words.
    pub fn words(&self, machine: &TrainMachine) -> String {
        match self {
            Self::Bearing { gear, axis } => {
                let axis = if *axis == Axis::X { "x" } else { "y" };
                let gear = machine.train.gears.get(*gear).map_or_else(String::new, |gear| gear.words());
                format!("bearing of {gear}, {axis}")
            }
            Self::Ring { stage, .. } => format!("ring housing of stage {}", stage + 1),
        }
    }
}

/// Weight of a planet at this distance from the sensor, turns, with planets this far apart.
pub fn window(distance_turns: f64, spacing_turns: f64) -> f64 {
    let nearest = distance_turns - distance_turns.round();
    let share = nearest.abs() / (0.5 * WINDOW_SPACINGS * spacing_turns);
    if share < 1.0 { 0.5 + 0.5 * (PI * share).cos() } else { 0.0 }
}

/// One part of a sensor's signal.
#[derive(Debug, Clone, Copy)]
enum Source {
    /// Acceleration of a coordinate of the housing's frame.
    Still(usize),
    /// Acceleration of coordinates x and y of a turning frame along an axis.
    Turning { at: usize, frame_turns: f64, axis: Axis },
    /// Force of a planet's ring mesh over a mass.
    Planet { mesh: usize, mass_kg: f64, place_turns: f64, carrier_turns: f64, spacing_turns: f64 },
}

/// A sensor made ready for a train.
#[derive(Debug, Clone)]
pub(crate) struct Pickup(Vec<Source>);

impl Pickup {
    /// Of a sensor.
    pub fn new(system: &System, machine: &TrainMachine, sensor: &Sensor) -> Result<Self> {
        let refuse = |what: String| Err(Error::invalid("sensor", what));
        match *sensor {
            Sensor::Bearing { gear, axis } => {
                let Some(body) = system.body(Part::Gear(gear)) else {
                    return refuse(format!("gear {gear} is no gear with a bearing in the housing"));
                };
                Ok(Self(vec![match body.frame_turns {
                    0.0 => Source::Still(body.at + if axis == Axis::X { 1 } else { 2 }),
                    frame_turns => Source::Turning { at: body.at, frame_turns, axis },
                }]))
            }
            Sensor::Ring { stage, place_turns } => {
                let carrier = machine.train.mesh(stage).and_then(|mesh| mesh.carrier.as_ref());
                let (Some(carrier), true) = (carrier, place_turns.is_finite()) else {
                    return refuse(format!("stage {} is no planetary set", stage + 1));
                };
                let even = |number: usize| number as f64 / f64::from(carrier.planets);
                let places = |number: usize| carrier.spacing.as_ref().map_or(even(number), |all| all[number]);
                let is_ring = |side: usize| matches!(system.bodies[side].part, Part::Gear(_));
                let planets = system.meshes.iter().enumerate().filter(|(_, mesh)| mesh.stage == stage);
                let planets = planets.filter(|(_, mesh)| is_ring(mesh.bodies[1]));
                let sources = planets.filter_map(|(index, mesh)| {
                    Some(Source::Planet {
                        mesh: index,
                        mass_kg: system.bodies[mesh.bodies[1]].inertia.mass_kg,
                        place_turns: places(mesh.planet?) - place_turns,
                        carrier_turns: carrier.speed.value(),
                        spacing_turns: 1.0 / f64::from(carrier.planets),
                    })
                });
                Ok(Self(sources.collect()))
            }
        }
    }

    /// Adds the signal at evenly spaced times from `first` on, units of the step, to `values`.
    pub fn add(&self, step: &Step, motion: &Motion, [first, spacing]: [f64; 2], values: &mut [f64]) {
        let mut part = vec![0.0; values.len()];
        let turns = motion.turns(step.start_s, step.length_s);
        let at = |i: usize| turns.value(first + i as f64 * spacing);
        for source in &self.0 {
            match *source {
                Source::Still(coordinate) => {
                    evaluate(&step.acceleration(coordinate), first, spacing, &mut part);
                    values.iter_mut().zip(&part).for_each(|(value, part)| *value += part);
                }
                Source::Turning { at: body, frame_turns, axis } => {
                    let mut other = vec![0.0; values.len()];
                    evaluate(&step.acceleration(body + 1), first, spacing, &mut part);
                    evaluate(&step.acceleration(body + 2), first, spacing, &mut other);
                    for (i, value) in values.iter_mut().enumerate() {
                        let (sin, cos) = (TAU * (frame_turns * at(i)).fract()).sin_cos();
                        *value += match axis {
                            Axis::X => part[i] * cos - other[i] * sin,
                            Axis::Y => part[i] * sin + other[i] * cos,
                        };
                    }
                }
                Source::Planet { mesh, mass_kg, place_turns, carrier_turns, spacing_turns } => {
                    evaluate(&step.force(mesh), first, spacing, &mut part);
                    for (i, value) in values.iter_mut().enumerate() {
                        *value += part[i] / mass_kg * window(place_turns + carrier_turns * at(i), spacing_turns);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_the_weights_of_even_planets_sum_to_one_wherever_the_carrier_stands() {
        for planets in 2..=6 {
            let spacing = 1.0 / f64::from(planets);
            for place in [0.0, 0.123, 0.49, 0.77] {
                let sum: f64 = (0..planets).map(|i| window(place + f64::from(i) * spacing, spacing)).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{planets} {place}: {sum}");
            }
        }
        assert_eq!(window(0.5, 1.0 / 3.0), 0.0);
    }
}
