//! One assembly for every model: mass, stiffness, damping, mesh direction and external force.
//!
//! `M q'' = f - K0 q - C0 q' - h F`, where `q` are deviations from the rigid rotation, `h` the mesh
//! direction (`delta = h . q` is the approach along the line of action) and `F` the mesh force. The mesh
//! itself is not in `K0`: it varies with time and enters as a rank-one term in the solver.
//!
//! Rotations are positive in the driven sense of each gear. Translations are along `x` and `y` of a frame
//! whose `y` axis makes [`Options::axis_angle_rad`] with the line of action: 0 gives `x` across and `y`
//! along the line of action (record declarations); the pressure angle gives horizontal and vertical axes.

use crate::machine::{Casing, Machine};
use crate::{Error, Result};
use nalgebra::{DMatrix, DVector};

/// Models, by what may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Model {
    /// Two rotations, no bearings: the "traditional" pair.
    Torsional,
    /// Rotations and translations of both gears, torques on the gears themselves.
    BendingTorsionalWithoutShafts,
    /// Rotations of motor, pinion, gear, load; translations of both gears.
    #[default]
    BendingTorsional,
    /// As bending-torsional, with a casing that both bearings stand on.
    Casing,
}

impl Model {
    /// Names accepted by [`std::str::FromStr`].
    pub const NAMES: [&str; 4] = ["torsional", "bending-torsional-6", "bending-torsional", "casing"];
}

impl std::str::FromStr for Model {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "torsional" => Ok(Self::Torsional),
            "bending-torsional-6" => Ok(Self::BendingTorsionalWithoutShafts),
            "bending-torsional" | "bending-torsional-8" => Ok(Self::BendingTorsional),
            "casing" => Ok(Self::Casing),
            _ => Err(Error::invalid("model", format!("`{name}` is not one of {}", Self::NAMES.join(", ")))),
        }
    }
}

/// A coordinate of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinate {
    /// Rotation of the motor, rad.
    Motor,
    /// Rotation of gear body 0 (pinion) or 1 (gear), rad.
    Rotation(usize),
    /// Rotation of the load, rad.
    Load,
    /// Translation across (`x`) of gear body 0 or 1, m.
    Across(usize),
    /// Translation along (`y`) of gear body 0 or 1, m.
    Along(usize),
    /// Casing translation `x`, m.
    CasingAcross,
    /// Casing translation `y`, m.
    CasingAlong,
}

/// Casing of machines that declare none: 10 kg at 525 Hz with 1.6 % damping (reference/physics.md 3.2, item 20).
fn default_casing() -> Casing {
    let omega = 2.0 * std::f64::consts::PI * 525.0;
    let (mass_kg, ratio) = (10.0, 0.016);
    Casing {
        mass_kg,
        stiffness_n_per_m: [mass_kg * omega * omega; 2],
        damping_n_s_per_m: [2.0 * ratio * mass_kg * omega; 2],
    }
}

/// Where the physical damping of shafts and bearings comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Damping {
    /// The declared values.
    #[default]
    Declared,
    /// The same damping ratio in every elastic mode of the averaged system.
    Modal(f64),
    /// The often-printed values (coupling 5e5 N m s/rad, bearing 1.8e5 N s/m): a coupling time constant
    /// below 1 ns, in effect a rigid shaft. Compatibility preset only; explicit steps become tiny.
    Printed,
}

/// Choices of the assembly.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// Which coordinates move.
    pub model: Model,
    /// Angle between the `y` axis and the line of action, rad.
    pub axis_angle_rad: f64,
    /// Physical damping.
    pub damping: Damping,
    /// Mean mesh stiffness, N/m, for modal damping.
    pub mean_mesh_stiffness_n_per_m: f64,
}

/// The assembled linear part.
#[derive(Debug, Clone)]
pub struct System {
    /// What each coordinate is.
    pub coordinates: Vec<Coordinate>,
    /// Diagonal of the mass matrix, kg or kg m2.
    pub mass: DVector<f64>,
    /// Stiffness without the mesh.
    pub stiffness: DMatrix<f64>,
    /// Damping without the mesh.
    pub damping: DMatrix<f64>,
    /// Mesh direction: `delta = mesh . q`.
    pub mesh: DVector<f64>,
    /// Direction of sliding, pinion minus gear, across the line of action.
    pub cross: DVector<f64>,
    /// Generalised force per 1 N m of input torque, the load in balance.
    pub torque: DVector<f64>,
    /// Base radii, m.
    pub base_radius_m: [f64; 2],
}

impl System {
    /// Assembles the model of a machine.
    ///
    /// # Errors
    /// A mass, inertia, stiffness or damping that is not finite and in range, named by table and key.
    pub fn assemble(machine: &Machine, options: &Options) -> Result<Self> {
        check(machine)?;
        let base_radius_m = base_radii(machine);
        let coordinates = coordinates_of(options.model);
        let n = coordinates.len();
        let mut system = Self {
            mass: DVector::from_iterator(n, coordinates.iter().map(|&c| inertia(machine, c))),
            stiffness: DMatrix::zeros(n, n),
            damping: DMatrix::zeros(n, n),
            mesh: DVector::zeros(n),
            cross: DVector::zeros(n),
            torque: DVector::zeros(n),
            coordinates,
            base_radius_m,
        };
        system.set_directions(machine, options.axis_angle_rad);
        system.add_springs(machine, options);
        if let Damping::Modal(ratio) = options.damping {
            system.damping = system.modal_damping(ratio, options.mean_mesh_stiffness_n_per_m)?;
        }
        Ok(system)
    }

    /// Number of coordinates.
    pub fn len(&self) -> usize {
        self.coordinates.len()
    }

    /// Whether the model has no coordinates (never).
    pub fn is_empty(&self) -> bool {
        self.coordinates.is_empty()
    }

    /// Index of a coordinate, `None` if the model has none such.
    pub fn index(&self, coordinate: Coordinate) -> Option<usize> {
        self.coordinates.iter().position(|&c| c == coordinate)
    }

    /// The coordinate that the record's channel 0 or 1 accelerates: the gear body along `y`.
    pub fn sensor(&self, body: usize) -> Option<usize> {
        self.index(Coordinate::Along(body))
    }

    /// Rigid rotation of the whole train, 1 rad of the pinion.
    pub fn rigid_rotation(&self) -> DVector<f64> {
        let ratio = self.base_radius_m[0] / self.base_radius_m[1];
        DVector::from_iterator(
            self.len(),
            self.coordinates.iter().map(|c| match c {
                Coordinate::Motor | Coordinate::Rotation(0) => 1.0,
                Coordinate::Load | Coordinate::Rotation(_) => ratio,
                _ => 0.0,
            }),
        )
    }

    /// Undamped natural frequencies at a constant mesh stiffness, Hz, ascending.
    pub fn natural_frequencies_hz(&self, mesh_stiffness_n_per_m: f64) -> Vec<f64> {
        let (values, _) = self.modes(mesh_stiffness_n_per_m);
        values.iter().map(|&w2| w2.max(0.0).sqrt() / (2.0 * std::f64::consts::PI)).collect()
    }

    /// Squared angular frequencies, ascending, and mass-normalised mode shapes (columns).
    fn modes(&self, mesh_stiffness: f64) -> (Vec<f64>, DMatrix<f64>) {
        let root = self.mass.map(|m| 1.0 / m.sqrt());
        let full = &self.stiffness + mesh_stiffness * &self.mesh * self.mesh.transpose();
        let scaled = DMatrix::from_fn(self.len(), self.len(), |i, j| full[(i, j)] * root[i] * root[j]);
        let eigen = scaled.symmetric_eigen();
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let values = order.iter().map(|&i| eigen.eigenvalues[i]).collect();
        let shapes = DMatrix::from_fn(self.len(), self.len(), |i, j| root[i] * eigen.eigenvectors[(i, order[j])]);
        (values, shapes)
    }

    fn modal_damping(&self, ratio: f64, mesh_stiffness: f64) -> Result<DMatrix<f64>> {
        if !(mesh_stiffness.is_finite() && mesh_stiffness > 0.0) {
            return Err(Error::invalid("damping", "modal damping needs the mean mesh stiffness"));
        }
        let (values, shapes) = self.modes(mesh_stiffness);
        let largest = values.last().copied().unwrap_or(0.0);
        let weights = DVector::from_iterator(
            values.len(),
            values.iter().map(|&w2| if w2 > 1e-9 * largest { 2.0 * ratio * w2.sqrt() } else { 0.0 }),
        );
        let mass = DMatrix::from_diagonal(&self.mass);
        Ok(&mass * &shapes * DMatrix::from_diagonal(&weights) * shapes.transpose() * &mass)
    }

    /// Static deflection under `force` at a constant mesh stiffness, without rigid rotation.
    ///
    /// # Errors
    /// If the equations cannot be solved (no stiffness at all).
    pub fn static_deflection(&self, force: &DVector<f64>, mesh_stiffness_n_per_m: f64) -> Result<DVector<f64>> {
        let full = &self.stiffness + mesh_stiffness_n_per_m * &self.mesh * self.mesh.transpose();
        // The rigid rotation is pinned by a soft rank-one term that a balanced force does not feel.
        let rigid = self.rigid_rotation();
        let pinned = &full + (full.norm() / rigid.norm_squared()) * &rigid * rigid.transpose();
        let balanced = force - &rigid * (rigid.dot(force) / rigid.norm_squared());
        pinned.lu().solve(&balanced).ok_or_else(|| Error::impossible("static deflection", "singular stiffness"))
    }

    fn set_directions(&mut self, machine: &Machine, axis_angle_rad: f64) {
        let (sin, cos) = axis_angle_rad.sin_cos();
        let alone = self.index(Coordinate::Motor).is_none();
        let ratio = f64::from(machine.pair.teeth[1]) / f64::from(machine.pair.teeth[0]);
        for (i, &coordinate) in self.coordinates.iter().enumerate() {
            let sign = |body: usize| if body == 0 { 1.0 } else { -1.0 };
            match coordinate {
                Coordinate::Rotation(body) => {
                    self.mesh[i] = sign(body) * self.base_radius_m[body];
                    if alone {
                        self.torque[i] = if body == 0 { 1.0 } else { -ratio };
                    }
                }
                Coordinate::Motor => self.torque[i] = 1.0,
                Coordinate::Load => self.torque[i] = -ratio,
                Coordinate::Across(body) => {
                    self.mesh[i] = sign(body) * sin;
                    self.cross[i] = sign(body) * cos;
                }
                Coordinate::Along(body) => {
                    self.mesh[i] = sign(body) * cos;
                    self.cross[i] = -sign(body) * sin;
                }
                Coordinate::CasingAcross | Coordinate::CasingAlong => {}
            }
        }
    }

    fn add_springs(&mut self, machine: &Machine, options: &Options) {
        let shafts = &machine.shafts;
        let (coupling, bearing) = match options.damping {
            Damping::Printed => ([5.0e5; 2], [1.8e5; 2]),
            _ => (shafts.coupling_damping_n_m_s_per_rad, shafts.bearing_damping_n_s_per_m),
        };
        let ends = [(Coordinate::Motor, Coordinate::Rotation(0)), (Coordinate::Rotation(1), Coordinate::Load)];
        for (side, (a, b)) in ends.into_iter().enumerate() {
            if let (Some(i), Some(j)) = (self.index(a), self.index(b)) {
                self.spring(i, Some(j), shafts.coupling_stiffness_n_m_per_rad[side], coupling[side]);
            }
        }
        for (body, damping) in bearing.into_iter().enumerate() {
            let axes = [
                (Coordinate::Across(body), Coordinate::CasingAcross),
                (Coordinate::Along(body), Coordinate::CasingAlong),
            ];
            for (axis, ground) in axes {
                if let Some(i) = self.index(axis) {
                    let ground = self.index(ground);
                    self.spring(i, ground, shafts.bearing_stiffness_n_per_m[body], damping);
                }
            }
        }
        let casing = machine.casing.unwrap_or_else(default_casing);
        for (axis, coordinate) in [Coordinate::CasingAcross, Coordinate::CasingAlong].into_iter().enumerate() {
            if let Some(i) = self.index(coordinate) {
                self.spring(i, None, casing.stiffness_n_per_m[axis], casing.damping_n_s_per_m[axis]);
            }
        }
    }

    /// A spring and damper between coordinate `i` and `j`, or ground.
    fn spring(&mut self, i: usize, j: Option<usize>, stiffness: f64, damping: f64) {
        for (matrix, value) in [(&mut self.stiffness, stiffness), (&mut self.damping, damping)] {
            matrix[(i, i)] += value;
            if let Some(j) = j {
                matrix[(j, j)] += value;
                matrix[(i, j)] -= value;
                matrix[(j, i)] -= value;
            }
        }
    }
}

/// Base radii of both gears, m.
pub fn base_radii(machine: &Machine) -> [f64; 2] {
    let cos = machine.pair.pressure_angle_deg.to_radians().cos();
    machine.pair.teeth.map(|z| 0.5 * machine.pair.module_m * f64::from(z) * cos)
}

fn coordinates_of(model: Model) -> Vec<Coordinate> {
    use Coordinate::*;
    let translations = [Across(0), Along(0), Across(1), Along(1)];
    let gears = [Rotation(0), Rotation(1)];
    match model {
        Model::Torsional => gears.to_vec(),
        Model::BendingTorsionalWithoutShafts => [&gears[..], &translations].concat(),
        Model::BendingTorsional => [&[Motor, gears[0], gears[1], Load][..], &translations].concat(),
        Model::Casing => [&[Motor, gears[0], gears[1], Load][..], &translations, &[CasingAcross, CasingAlong]].concat(),
    }
}

fn inertia(machine: &Machine, coordinate: Coordinate) -> f64 {
    let shafts = &machine.shafts;
    match coordinate {
        Coordinate::Motor => shafts.inertia_motor_kg_m2,
        Coordinate::Rotation(0) => shafts.inertia_pinion_kg_m2,
        Coordinate::Rotation(_) => shafts.inertia_gear_kg_m2,
        Coordinate::Load => shafts.inertia_load_kg_m2,
        Coordinate::Across(body) | Coordinate::Along(body) => shafts.mass_kg[body],
        Coordinate::CasingAcross | Coordinate::CasingAlong => machine.casing.unwrap_or_else(default_casing).mass_kg,
    }
}

fn check(machine: &Machine) -> Result<()> {
    let s = &machine.shafts;
    let positive = [
        ("shafts.inertia_motor_kg_m2", s.inertia_motor_kg_m2),
        ("shafts.inertia_pinion_kg_m2", s.inertia_pinion_kg_m2),
        ("shafts.inertia_gear_kg_m2", s.inertia_gear_kg_m2),
        ("shafts.inertia_load_kg_m2", s.inertia_load_kg_m2),
        ("shafts.mass_kg[0]", s.mass_kg[0]),
        ("shafts.mass_kg[1]", s.mass_kg[1]),
        ("shafts.coupling_stiffness_n_m_per_rad[0]", s.coupling_stiffness_n_m_per_rad[0]),
        ("shafts.coupling_stiffness_n_m_per_rad[1]", s.coupling_stiffness_n_m_per_rad[1]),
        ("shafts.bearing_stiffness_n_per_m[0]", s.bearing_stiffness_n_per_m[0]),
        ("shafts.bearing_stiffness_n_per_m[1]", s.bearing_stiffness_n_per_m[1]),
        ("pair.module_m", machine.pair.module_m),
    ];
    let not_negative = [
        ("shafts.coupling_damping_n_m_s_per_rad[0]", s.coupling_damping_n_m_s_per_rad[0]),
        ("shafts.coupling_damping_n_m_s_per_rad[1]", s.coupling_damping_n_m_s_per_rad[1]),
        ("shafts.bearing_damping_n_s_per_m[0]", s.bearing_damping_n_s_per_m[0]),
        ("shafts.bearing_damping_n_s_per_m[1]", s.bearing_damping_n_s_per_m[1]),
        ("pair.mesh_damping_s", machine.pair.mesh_damping_s),
    ];
    for (place, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::invalid(place, format!("{value} is not a positive number")));
        }
    }
    for (place, value) in not_negative {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::invalid(place, format!("{value} is negative or not a number")));
        }
    }
    Ok(())
}
