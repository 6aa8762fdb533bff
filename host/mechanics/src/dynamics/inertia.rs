//! Torque that a changing speed takes: what the train feels where its prescribed motion is not steady.
//!
//! The coordinates of the model are deflections about the prescribed rotation, so the inertias of that rotation do
//! not appear by themselves. With them as external torques the mesh carries what speeds gear and load up, and the
//! motor supplies it. The pinion's own share goes from motor to pinion and is left out: it twists the input coupling
//! and nothing else.

use super::excitation::{Effect, Forces, Moment, Place};
use crate::machine::Machine;

/// Inertias behind the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaTorque {
    /// Inertia of gear and load, kg m2.
    pub driven_kg_m2: f64,
    /// Turns of the gear per turn of the pinion.
    pub ratio: f64,
}

impl InertiaTorque {
    /// Of a machine.
    pub fn of(machine: &Machine) -> Self {
        let [z1, z2] = machine.pair.teeth.map(f64::from);
        let driven_kg_m2 = machine.shafts.inertia_gear_kg_m2 + machine.shafts.inertia_load_kg_m2;
        Self { driven_kg_m2, ratio: z1 / z2 }
    }
}

impl Effect for InertiaTorque {
    fn force(&self, moment: &Moment, forces: &mut Forces) {
        let second = moment.angle_rad[0].derivative().derivative();
        if second.is_zero() {
            return;
        }
        let pinion_rad_s2 = second.scaled(1.0 / (moment.length_s * moment.length_s));
        let load = self.driven_kg_m2 * self.ratio;
        forces.add(Place::Load, pinion_rad_s2.scaled(-load));
        forces.add(Place::Motor, pinion_rad_s2.scaled(load * self.ratio));
    }
}
