//! What a train machine's file leaves out, from its geometry.
//!
//! Rules of machine design handbooks as `meshband machine new` has them: solid discs of steel, bores at the root radius
//! over 2.6, shafts that fill the bore, four face widths between two bodies; a drive of four times its pinion's
//! inertia, a load of twice its gear's; ball bearings of 1e8 N/m; dampers as a share of critical. A ring is a rim 15 %
//! of its root radius thick, a carrier a disc as large as the planet circle. These are orders of magnitude: declared
//! values are always better.

use super::tables::{EndTable, MeshTable, PlanetaryTable, ShaftTable, Tables};
use super::{End, Inertia, MeshDamping, Set, Shaft, Toothing, TrainMachine};
use crate::{Error, Result};
use meshband_train::declaration::Stage;
use meshband_train::{Role, Train};
use std::f64::consts::PI;

/// Density of steel, kg/m3.
const STEEL_KG_M3: f64 = 7_850.0;
/// Shear modulus of steel, Pa.
const SHEAR_PA: f64 = 79.3e9;
/// Young's modulus of steel, Pa.
const YOUNG_PA: f64 = 206e9;
/// Poisson's ratio of steel.
const POISSON: f64 = 0.3;
/// Root radius over bore radius.
const ROOT_OVER_BORE: f64 = 2.6;
/// Dedendum of a standard tooth, normal modules.
const DEDENDUM_MODULES: f64 = 1.25;
/// Face widths of shaft between two neighbouring bodies.
const SHAFT_FACE_WIDTHS: f64 = 4.0;
/// Inertia of the drive over that of the first gear on its shaft.
const DRIVE_OVER_GEAR: f64 = 4.0;
/// Inertia of the load over that of the last gear on its shaft.
const LOAD_OVER_GEAR: f64 = 2.0;
/// Stiffness of a pair of ball bearings, of a planet's needles and of a member's support, N/m.
const BEARING_N_PER_M: f64 = 1e8;
/// Damping ratio of a mesh.
const MESH_DAMPING_RATIO: f64 = 0.05;
/// Damping ratio of planet pins and supports.
const SET_DAMPING_RATIO: f64 = 0.04;
/// Ramp of engagement, base pitches.
const RAMP_BASE_PITCHES: f64 = 0.125;
/// Outer radius of a ring over its root radius.
const RING_OUTER_OVER_ROOT: f64 = 1.15;
/// Stiffness with which a housing keeps a ring's teeth from moving along their pitch circle, N/m.
const FIXED_MEMBER_N_PER_M: f64 = 1e9;

/// A train and its tables on the way to a machine.
pub(super) struct Resolver<'t> {
    train: Train,
    tables: &'t Tables,
    place: &'t str,
}

impl<'t> Resolver<'t> {
    /// Checks that the tables belong to the train's stages and shafts.
    pub(super) fn new(train: Train, tables: &'t Tables, place: &'t str) -> Result<Self> {
        let refuse = |key: &str, what: String| Err(Error::invalid(format!("{place} {key}"), what));
        let stages = &train.declaration.stages;
        if let Some(i) = stages.iter().position(|stage| matches!(stage, Stage::Belt { .. })) {
            return refuse(&format!("[[stage]] {}", i + 1), "a belt cannot be simulated; leave it out".into());
        }
        if tables.meshes.len() != stages.len() {
            let what = format!("{} tables where {} stages need one each", tables.meshes.len(), stages.len());
            return refuse("[[mesh]]", what);
        }
        if !tables.shafts.is_empty() && tables.shafts.len() != train.shafts.len() {
            let what = format!("{} tables; leave them out or give all {}", tables.shafts.len(), train.shafts.len());
            return refuse("[[shaft]]", what);
        }
        if tables.drive.shaft.is_some_and(|shaft| shaft != 0) {
            return refuse("[drive] shaft", "the drive is on shaft 0, the train's input".into());
        }
        let last = train.shafts.len() - 1;
        if let Some(shaft) = tables.load.shaft.filter(|shaft| !(1..=last).contains(shaft)) {
            return refuse("[load] shaft", format!("{shaft} is no shaft behind a stage (1 to {last})"));
        }
        for (i, set) in tables.planetary.iter().enumerate() {
            let stage = set.stage.checked_sub(1).and_then(|index| stages.get(index));
            if !matches!(stage, Some(Stage::Planetary { .. })) {
                let what = format!("{} is no planetary stage", set.stage);
                return refuse(&format!("[[planetary]] {} stage", i + 1), what);
            }
        }
        Ok(Self { train, tables, place })
    }

    /// The machine with everything filled in.
    pub(super) fn machine(self) -> Result<TrainMachine> {
        let toothings: Vec<Toothing> = (0..self.tables.meshes.len()).map(|stage| self.toothing(stage)).collect();
        let sets: Vec<Option<Set>> = (0..toothings.len()).map(|stage| self.set(stage, &toothings[stage])).collect();
        let mut gears: Vec<Inertia> = (0..self.train.gears.len()).map(|gear| self.gear(gear, &toothings)).collect();
        self.add_extra_inertia(&mut gears)?;
        let shafts = (0..self.train.shafts.len()).map(|shaft| self.shaft(shaft, &toothings)).collect();
        let load_shaft = self.tables.load.shaft.unwrap_or(self.train.shafts.len() - 1);
        let drive = self.end(&self.tables.drive, 0, DRIVE_OVER_GEAR, &gears, &toothings, &sets);
        let load = self.end(&self.tables.load, load_shaft, LOAD_OVER_GEAR, &gears, &toothings, &sets);
        Ok(TrainMachine {
            nominal: self.tables.nominal,
            train: self.train,
            toothings,
            gears,
            shafts,
            drive,
            load,
            sets,
        })
    }

    /// Helix angle of a stage and the tooth counts whose bores are declared.
    fn teeth(&self, stage: usize) -> ([u32; 2], f64) {
        match &self.train.declaration.stages[stage] {
            Stage::Pair { teeth, helix_angle_deg, .. } => (*teeth, *helix_angle_deg),
            Stage::Planetary { sun, planet, helix_angle_deg, .. } => ([*sun, *planet], *helix_angle_deg),
            Stage::Belt { .. } => ([0; 2], 0.0),
        }
    }

    fn toothing(&self, stage: usize) -> Toothing {
        let table: &MeshTable = &self.tables.meshes[stage];
        let (teeth, helix_angle_deg) = self.teeth(stage);
        let module_m = 1e-3 * table.module_mm.unwrap_or(f64::NAN);
        let damping = match (table.mesh_damping_s, table.mesh_damping_ratio) {
            (Some(time), _) => MeshDamping::Time(time),
            (None, ratio) => MeshDamping::Ratio(ratio.unwrap_or(MESH_DAMPING_RATIO)),
        };
        let radius = |z: u32| 0.5 * module_m * f64::from(z) / helix_angle_deg.to_radians().cos();
        let bore = teeth.map(|z| (radius(z) - DEDENDUM_MODULES * module_m) / ROOT_OVER_BORE);
        Toothing {
            module_m,
            face_width_m: 1e-3 * table.face_width_mm.unwrap_or(f64::NAN),
            pressure_angle_deg: table.pressure_angle_deg.unwrap_or(20.0),
            helix_angle_deg,
            // The shafts of a flat box lie on one line.
            centre_line_rad: table.centre_line_deg.unwrap_or(0.0).to_radians(),
            bore_radius_m: table.bore_radius_mm.map_or(bore, |mm| mm.map(|mm| 1e-3 * mm)),
            youngs_modulus_pa: table.youngs_modulus_gpa.map_or(YOUNG_PA, |gpa| 1e9 * gpa),
            poisson: table.poisson.unwrap_or(POISSON),
            ramp_base_pitches: table.engagement_base_pitches.unwrap_or(RAMP_BASE_PITCHES),
            damping,
            transmission_error_m: table.transmission_error_um.iter().map(|um| 1e-6 * um).collect(),
        }
    }

    fn planetary(&self, stage: usize) -> Option<&PlanetaryTable> {
        self.tables.planetary.iter().find(|set| set.stage == stage + 1)
    }

    /// Inertia of a gear of the train.
    fn gear(&self, index: usize, toothings: &[Toothing]) -> Inertia {
        let gear = &self.train.gears[index];
        let (toothing, table) = (&toothings[gear.stage], &self.tables.meshes[gear.stage]);
        let radius = toothing.radius_m(gear.teeth);
        let body = match gear.role {
            Role::Ring => rim(radius + DEDENDUM_MODULES * toothing.module_m, toothing.face_width_m),
            Role::Gear if self.is_internal(gear.stage) => {
                rim(radius + DEDENDUM_MODULES * toothing.module_m, toothing.face_width_m)
            }
            _ => disc(radius, toothing.face_width_m),
        };
        let (masses, inertias, slot) = match gear.role {
            Role::Pinion => (pick(table.mass_kg, 0), pick(table.inertia_kg_m2, 0), None),
            Role::Gear => (pick(table.mass_kg, 1), pick(table.inertia_kg_m2, 1), None),
            Role::Idler(_) => (None, None, None),
            Role::Sun => (None, None, Some(0)),
            Role::Planet => (None, None, Some(1)),
            Role::Ring => (None, None, Some(2)),
        };
        let set = self.planetary(gear.stage);
        let of_set = |list: Option<[f64; 4]>| slot.and_then(|slot| list.map(|list| list[slot]));
        Inertia {
            mass_kg: masses.or(of_set(set.and_then(|set| set.mass_kg))).unwrap_or(body.mass_kg),
            inertia_kg_m2: inertias.or(of_set(set.and_then(|set| set.inertia_kg_m2))).unwrap_or(body.inertia_kg_m2),
        }
    }

    fn is_internal(&self, stage: usize) -> bool {
        matches!(&self.train.declaration.stages[stage], Stage::Pair { internal: true, .. })
    }

    fn add_extra_inertia(&self, gears: &mut [Inertia]) -> Result<()> {
        for (shaft, table) in self.tables.shafts.iter().enumerate() {
            let Some(extra) = table.extra_inertia_kg_m2 else { continue };
            let on: Vec<usize> = self.train.gears_on(shaft).collect();
            if on.is_empty() {
                let key = format!("{} [[shaft]] {shaft} extra_inertia_kg_m2", self.place);
                return Err(Error::invalid(key, "no gear is on this shaft; declare it with [drive] or [load]"));
            }
            on.iter().for_each(|&gear| gears[gear].inertia_kg_m2 += extra / on.len() as f64);
        }
        Ok(())
    }

    /// Least bore radius of the gears on a shaft, m, with the face width there; of a carrier's shaft that of its sun.
    fn thinnest(&self, shaft: usize, toothings: &[Toothing]) -> (f64, f64) {
        let mut least = (f64::INFINITY, 1.0);
        for gear in self.train.gears_on(shaft).map(|gear| &self.train.gears[gear]) {
            let toothing = &toothings[gear.stage];
            let bore = match gear.role {
                Role::Pinion | Role::Sun | Role::Idler(_) => toothing.bore_radius_m[0],
                Role::Gear | Role::Planet | Role::Ring => toothing.bore_radius_m[1],
            };
            if bore < least.0 {
                least = (bore, toothing.face_width_m);
            }
        }
        if least.0.is_finite() {
            return least;
        }
        let stage = if shaft == 0 { 0 } else { shaft - 1 };
        (toothings[stage].bore_radius_m[0], toothings[stage].face_width_m)
    }

    /// Torsional stiffness of a shaft between two bodies, N m/rad.
    fn torsion(&self, shaft: usize, toothings: &[Toothing]) -> f64 {
        let (bore, width) = self.thinnest(shaft, toothings);
        SHEAR_PA * 0.5 * PI * bore.powi(4) / (SHAFT_FACE_WIDTHS * width)
    }

    fn shaft(&self, shaft: usize, toothings: &[Toothing]) -> Shaft {
        let none = ShaftTable::default();
        let table = self.tables.shafts.get(shaft).unwrap_or(&none);
        Shaft {
            torsion_n_m_per_rad: table
                .torsional_stiffness_n_m_per_rad
                .unwrap_or_else(|| self.torsion(shaft, toothings)),
            torsion_damping_n_m_s_per_rad: table.torsional_damping_n_m_s_per_rad,
            bearing_n_per_m: table.bearing_stiffness_n_per_m.unwrap_or([BEARING_N_PER_M; 2]),
            bearing_damping_n_s_per_m: table.bearing_damping_n_s_per_m,
        }
    }

    fn end(
        &self,
        table: &EndTable,
        shaft: usize,
        factor: f64,
        gears: &[Inertia],
        toothings: &[Toothing],
        sets: &[Option<Set>],
    ) -> End {
        let on = self.train.gears_on(shaft).map(|gear| gears[gear].inertia_kg_m2);
        let carriers = sets.iter().flatten().map(|set| set.carrier.inertia_kg_m2);
        let body = on.chain(carriers).next().unwrap_or(f64::NAN);
        // A coupling twists as eight face widths of its shaft do.
        End {
            shaft,
            inertia_kg_m2: table.inertia_kg_m2.unwrap_or(factor * body),
            coupling_n_m_per_rad: table
                .coupling_stiffness_n_m_per_rad
                .unwrap_or_else(|| 0.5 * self.torsion(shaft, toothings)),
            coupling_damping_n_m_s_per_rad: table.coupling_damping_n_m_s_per_rad,
        }
    }

    fn set(&self, stage: usize, toothing: &Toothing) -> Option<Set> {
        let Stage::Planetary { sun, planet, ring, .. } = &self.train.declaration.stages[stage] else { return None };
        let none = PlanetaryTable::default();
        let table = self.planetary(stage).unwrap_or(&none);
        let disc = disc(toothing.radius_m(sun + planet), toothing.face_width_m);
        let carrier = Inertia {
            mass_kg: table.mass_kg.map_or(disc.mass_kg, |list| list[3]),
            inertia_kg_m2: table.inertia_kg_m2.map_or(disc.inertia_kg_m2, |list| list[3]),
        };
        let fixed = FIXED_MEMBER_N_PER_M * toothing.radius_m(*ring).powi(2);
        Some(Set {
            carrier,
            pin_n_per_m: table.pin_stiffness_n_per_m.unwrap_or(BEARING_N_PER_M),
            support_n_per_m: table.support_stiffness_n_per_m.unwrap_or([BEARING_N_PER_M; 3]),
            fixed_torsion_n_m_per_rad: table.fixed_torsion_n_m_per_rad.unwrap_or(fixed),
            damping_ratio: table.damping_ratio.unwrap_or(SET_DAMPING_RATIO),
        })
    }
}

fn pick(list: Option<[f64; 2]>, index: usize) -> Option<f64> {
    list.map(|list| list[index])
}

/// A solid disc of steel.
fn disc(radius_m: f64, width_m: f64) -> Inertia {
    let mass_kg = STEEL_KG_M3 * PI * radius_m * radius_m * width_m;
    Inertia { mass_kg, inertia_kg_m2: 0.5 * mass_kg * radius_m * radius_m }
}

/// The rim of a ring of this root radius.
fn rim(root_m: f64, width_m: f64) -> Inertia {
    let outer = RING_OUTER_OVER_ROOT * root_m;
    let mass_kg = STEEL_KG_M3 * PI * (outer * outer - root_m * root_m) * width_m;
    Inertia { mass_kg, inertia_kg_m2: 0.5 * mass_kg * (outer * outer + root_m * root_m) }
}
