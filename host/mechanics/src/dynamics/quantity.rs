//! What can be sampled of a run: accelerations of coordinates, forces of bearings on what they stand on.

use super::assembly::{Coordinate, System};
use super::mesh::UNIT;
use super::series::Series;
use super::taylor::Step;
use crate::{Error, Result};

/// One quantity of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// Acceleration of a coordinate, m/s2.
    Acceleration(usize),
    /// Force of a bearing in one direction on the housing, N.
    BearingForce(Bearing),
}

/// One bearing in one direction: spring and damper between a gear body and the housing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    coordinate: usize,
    housing: Option<usize>,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

impl Bearing {
    /// All four: along the line of action of pinion and gear, then across it.
    ///
    /// # Errors
    /// A model without bearings.
    pub fn all(system: &System) -> Result<[Self; 4]> {
        use Coordinate::{Across, Along, CasingAcross, CasingAlong};
        let places =
            [(Along(0), CasingAlong), (Along(1), CasingAlong), (Across(0), CasingAcross), (Across(1), CasingAcross)];
        let mut all = [Self { coordinate: 0, housing: None, stiffness_n_per_m: 0.0, damping_n_s_per_m: 0.0 }; 4];
        for (bearing, (body, housing)) in all.iter_mut().zip(places) {
            let Some(coordinate) = system.index(body) else {
                return Err(Error::invalid("model", "has no bearings, hence no force on a housing"));
            };
            // A translation has no other spring than its bearing's.
            let own = |matrix: &nalgebra::DMatrix<f64>| matrix[(coordinate, coordinate)];
            *bearing = Self {
                coordinate,
                housing: system.index(housing),
                stiffness_n_per_m: own(&system.stiffness),
                damping_n_s_per_m: own(&system.damping),
            };
        }
        Ok(all)
    }

    fn force(&self, step: &Step) -> Series {
        let (mut deflection, mut velocity) = (step.deflection(self.coordinate), step.velocity(self.coordinate));
        if let Some(housing) = self.housing {
            deflection.add_scaled(&step.deflection(housing), -1.0);
            velocity.add_scaled(&step.velocity(housing), -1.0);
        }
        let mut force = deflection.scaled(self.stiffness_n_per_m);
        force.add_scaled(&velocity, self.damping_n_s_per_m);
        // What effects add to the bearing's stiffness.
        let unit = UNIT + self.coordinate;
        for channel in step.terms.channels().iter().filter(|c| c.input == unit && c.output == unit) {
            force.add_scaled(&channel.k.product(&step.deflection(self.coordinate)), 1.0);
        }
        force
    }
}

impl Quantity {
    /// The quantity over a step.
    pub fn series(&self, step: &Step) -> Series {
        match self {
            Self::Acceleration(coordinate) => step.acceleration(*coordinate),
            Self::BearingForce(bearing) => bearing.force(step),
        }
    }
}
