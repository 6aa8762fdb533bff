//! A train machine: the declared train with the mechanical data of its meshes, shafts and ends, in SI units.
//!
//! A file has the train's own tables (`[[stage]]` and what hangs on its shafts) and beside them one `[[mesh]]` per
//! stage; `[[shaft]]`, `[drive]`, `[load]`, `[[planetary]]` and `[nominal]` may be missing, see `defaults`. Limits: a
//! belt is refused; each gear has its own pair of bearings, so two gears on one shaft are coupled by its twist only.

mod defaults;
mod tables;

pub use tables::{Nominal, SPEEDS_HZ, TORQUES_N_M, within};

use crate::{Error, Result};
use defaults::Resolver;
use meshband_train::{Declaration, Train};
use std::path::Path;
use tables::Tables;

/// A machine whose train is to be simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainMachine {
    /// The train in exact fractions.
    pub train: Train,
    /// Toothing of each stage.
    pub toothings: Vec<Toothing>,
    /// Inertia of each gear of the train, by its index; of a planet, of one.
    pub gears: Vec<Inertia>,
    /// Each shaft.
    pub shafts: Vec<Shaft>,
    /// What drives shaft 0.
    pub drive: End,
    /// What takes the power.
    pub load: End,
    /// Planetary data of each stage that is a set.
    pub sets: Vec<Option<Set>>,
    /// Operating point, where declared.
    pub nominal: Option<Nominal>,
}

/// Mass and moment of inertia of one body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about its axis, kg m2.
    pub inertia_kg_m2: f64,
}

/// Damping of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeshDamping {
    /// Ratio at the mean stiffness on the two gears' equivalent mass.
    Ratio(f64),
    /// This time, s, times the stiffness.
    Time(f64),
}

/// Toothing of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Toothing {
    /// Normal module, m.
    pub module_m: f64,
    /// Face width, m.
    pub face_width_m: f64,
    /// Normal pressure angle, degrees.
    pub pressure_angle_deg: f64,
    /// Helix angle, degrees, 0 of spur gears.
    pub helix_angle_deg: f64,
    /// Direction from driver to driven gear, rad from the housing's x axis.
    pub centre_line_rad: f64,
    /// Bore radii of driver and driven gear; of sun and planet of a set, m.
    pub bore_radius_m: [f64; 2],
    /// Young's modulus, Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Length of the ramp at either end of a pair's contact, base pitches.
    pub ramp_base_pitches: f64,
    /// Damping.
    pub damping: MeshDamping,
    /// Amplitudes of the transmission error at the mesh's harmonics, m.
    pub transmission_error_m: Vec<f64>,
}

impl Toothing {
    /// Transverse module, m.
    pub fn transverse_module_m(&self) -> f64 {
        self.module_m / self.helix_angle_deg.to_radians().cos()
    }

    /// Transverse pressure angle, rad.
    pub fn transverse_pressure_angle(&self) -> f64 {
        (self.pressure_angle_deg.to_radians().tan() / self.helix_angle_deg.to_radians().cos()).atan()
    }

    /// Reference radius of a gear of `teeth`, m.
    pub fn radius_m(&self, teeth: u32) -> f64 {
        0.5 * self.transverse_module_m() * f64::from(teeth)
    }
}

/// One shaft with the bearings of its gears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaft {
    /// Torsional stiffness between neighbouring bodies, N m/rad.
    pub torsion_n_m_per_rad: f64,
    /// Torsional damping between them, N m s/rad; where absent a ratio of critical on the two inertias.
    pub torsion_damping_n_m_s_per_rad: Option<f64>,
    /// Stiffness of the bearings under each gear along x and y, N/m.
    pub bearing_n_per_m: [f64; 2],
    /// Their damping, N s/m; where absent a ratio of critical on the gear's mass.
    pub bearing_damping_n_s_per_m: Option<[f64; 2]>,
}

/// Drive or load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct End {
    /// Its shaft.
    pub shaft: usize,
    /// Moment of inertia, kg m2.
    pub inertia_kg_m2: f64,
    /// Stiffness of the coupling to its shaft, N m/rad.
    pub coupling_n_m_per_rad: f64,
    /// Damping of the coupling, N m s/rad; where absent a ratio of critical.
    pub coupling_damping_n_m_s_per_rad: Option<f64>,
}

/// A planetary set beyond its toothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Set {
    /// The carrier without its planets.
    pub carrier: Inertia,
    /// Stiffness of a planet's bearing, N/m.
    pub pin_n_per_m: f64,
    /// Stiffness of the supports of sun, ring and carrier, N/m.
    pub support_n_per_m: [f64; 3],
    /// Stiffness that keeps the fixed member from turning, N m/rad.
    pub fixed_torsion_n_m_per_rad: f64,
    /// Damping ratio of pins and supports.
    pub damping_ratio: f64,
}

impl TrainMachine {
    /// Reads a machine file.
    ///
    /// # Errors
    /// One line with file, table and key.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&meshband_common::budget::read_text(path)?, &path.display().to_string())
    }

    /// [`TrainMachine::read`] of text; `place` names it.
    ///
    /// # Errors
    /// As [`TrainMachine::read`].
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let mut table: toml::Table = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{place}:{line}"), meshband_common::text::one_line(error.message()))
        })?;
        let tables = Tables::take(&mut table, place)?;
        let train = meshband_train::Declaration::parse(
            &toml::to_string(&table)
                .map_err(|error| Error::invalid(place, meshband_common::text::one_line(&error.to_string())))?,
            place,
        );
        Self::of(train?, &tables, place)
    }

    /// From a declaration and the tables beside it.
    fn of(declaration: Declaration, tables: &Tables, place: &str) -> Result<Self> {
        Resolver::new(Train::of(declaration)?, tables, place)?.machine()
    }

    /// Whether a file's text declares stages and their toothing: then it is a train machine and no pair's.
    pub fn is_declared(text: &str) -> bool {
        let table = toml::from_str::<toml::Table>(text);
        table.is_ok_and(|table| table.contains_key("stage") && table.contains_key("mesh"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO_STAGES: &str = "[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\nhelix_angle_deg = 15\n[[stage]]\nkind = \
        \"pair\"\nteeth = [19, 77]\n[[mesh]]\nmodule_mm = 2.0\nface_width_mm = 20\n[[mesh]]\nmodule_mm = \
        3.0\nface_width_mm = 30\n";

    #[test]
    fn claim_a_machine_needs_module_and_width_only_and_its_bodies_are_discs() {
        let machine = TrainMachine::parse(TWO_STAGES, "m.toml").expect("a machine");
        let radius = 0.5e-3 * 3.0 * 77.0;
        let mass = 7850.0 * std::f64::consts::PI * radius * radius * 0.03;
        assert!((machine.gears[3].inertia_kg_m2 / (0.5 * mass * radius * radius) - 1.0).abs() < 1e-12);
        assert!(machine.shafts.len() == 3 && machine.load.shaft == 2 && machine.drive.shaft == 0);
        assert!(machine.shafts[1].torsion_n_m_per_rad > 1e3);
    }

    #[test]
    fn claim_the_example_machines_are_read() {
        for name in ["train-two-stage", "train-planetary"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../machines/{name}.toml"));
            let machine = TrainMachine::read(&path).expect(name);
            assert!(machine.nominal.is_some() && machine.train.declaration.title == name);
            assert!(TrainMachine::is_declared(&std::fs::read_to_string(path).expect("text")));
        }
        assert!(!TrainMachine::is_declared("[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\n"));
    }

    #[test]
    fn fault_tables_are_refused_with_place_table_and_key() {
        let refused = |text: &str| TrainMachine::parse(text, "m.toml").expect_err("refused").to_string();
        let stage = "[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\n";
        let mesh = "[[mesh]]\nmodule_mm = 2.0\nface_width_mm = 20\n";
        let belt = "[[stage]]\nkind = \"belt\"\npulleys_mm = [100, 200]\n";
        for (text, words) in [
            (stage.to_owned(), "[[mesh]]"),
            (format!("{stage}[[mesh]]\nface_width_mm = 20\n"), "module_mm"),
            (format!("{stage}[[mesh]]\nmodule_mm = 2.0\nface_width_mm = nan\n"), "face_width_mm"),
            (format!("{stage}{mesh}mesh_damping = 1\n"), "[[mesh]] 1"),
            (format!("{stage}{mesh}mesh_damping_ratio = 0.1\nmesh_damping_s = 1e-7\n"), "mesh_damping_s"),
            (format!("{stage}{mesh}[[shaft]]\nextra_inertia_kg_m2 = -1\n"), "extra_inertia_kg_m2"),
            (format!("{stage}{mesh}[[shaft]]\n"), "[[shaft]]"),
            (format!("{stage}{mesh}[load]\nshaft = 7\n"), "[load] shaft"),
            (format!("{stage}{mesh}[drive]\nshaft = 1\n"), "[drive] shaft"),
            (format!("{stage}{mesh}[[planetary]]\nstage = 1\n"), "[[planetary]] 1 stage"),
            (format!("{stage}{mesh}[nominal]\nspeed_hz = 0\nload_torque_n_m = 3\n"), "speed_hz"),
            (format!("{stage}{belt}{mesh}{mesh}"), "belt"),
            (format!("{stage}{mesh}[gearbox]\nx = 1\n"), "gearbox"),
            (format!("{stage}{mesh}[load\n"), "m.toml:"),
        ] {
            let error = refused(&text);
            assert!(
                error.contains(words) && error.contains("m.toml") && error.lines().count() == 1,
                "{words}: {error}"
            );
        }
    }
}
