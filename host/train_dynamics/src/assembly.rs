//! Bodies, springs and meshes of a train as equations of motion: `M q'' = f - K q - C q' - sum d F`.
//!
//! Each gear is a body of three coordinates, its rotation and its shifts along x and y; drive and load turn only.
//! Angles count counter-clockwise, as shaft 0 turns; all are deviations from the exact motion. A mesh is a rank-one
//! term along its direction `d`: `F = k (d.q - e) + c (d.q' - e')`, its force positive where the loaded flanks press.
//! Shafts are springs against twist between neighbours; each body has springs to the ground. Limits: no bending of
//! shafts between gears, no axial motion, no gyroscopic terms.

use crate::machine::Inertia;
use crate::stiffness::MeshStiffness;
use crate::{Error, Result};
use nalgebra::{DMatrix, DVector};

/// What a body is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A gear of the train that is no planet, by its index.
    Gear(usize),
    /// A planet: the train's gear and its number from 0.
    Planet(usize, usize),
    /// The carrier of a stage.
    Carrier(usize),
}

/// A body with rotation, x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// What it is.
    pub part: Part,
    /// Index of its rotation; x and y follow.
    pub at: usize,
    /// Its shaft, where it has one.
    pub shaft: Option<usize>,
    /// Mass and moment of inertia.
    pub inertia: Inertia,
    /// Turns per turn of shaft 0, positive counter-clockwise.
    pub turns: f64,
    /// Turns of the frame of x and y per turn of shaft 0: the carrier's for the bodies of a set, else 0.
    pub frame_turns: f64,
}

impl Body {
    /// Whether it is a planet.
    pub fn is_planet(&self) -> bool {
        matches!(self.part, Part::Planet(..))
    }
}

/// One mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshLine {
    /// Stage, from 0.
    pub stage: usize,
    /// Number of its planet, in a set.
    pub planet: Option<usize>,
    /// Its two bodies.
    pub bodies: [usize; 2],
    /// What rotation, x and y of either body add to the approach of the flanks.
    pub directions: [[f64; 3]; 2],
    /// The train's gears, by index.
    pub gears: [usize; 2],
    /// Teeth.
    pub teeth: [u32; 2],
    /// Number of the pair in which either gear's tooth 0 meets.
    pub first_pairs: [i64; 2],
    /// Pairs per turn of shaft 0.
    pub order: f64,
    /// Position on the path at angle 0, base pitches: pair `n` lies at `order turns + phase - n`.
    pub phase: f64,
    /// Stiffness, by index among [`System::stiffnesses`].
    pub stiffness: usize,
    /// Damping over stiffness, s.
    pub damping_s: f64,
    /// Amplitudes of the transmission error at the harmonics, m.
    pub transmission_error_m: Vec<f64>,
}

/// The assembled train.
#[derive(Debug, Clone)]
pub struct System {
    /// Mass of each coordinate, kg or kg m2.
    pub mass: DVector<f64>,
    /// Stiffness without the meshes.
    pub stiffness: DMatrix<f64>,
    /// Damping without the meshes.
    pub damping: DMatrix<f64>,
    /// Bodies.
    pub bodies: Vec<Body>,
    /// Meshes.
    pub meshes: Vec<MeshLine>,
    /// Stiffness curves.
    pub stiffnesses: Vec<MeshStiffness>,
    /// Rotation of the whole train with 1 rad of shaft 0.
    pub rigid: DVector<f64>,
    /// Generalised force per 1 N m of load, the drive in balance.
    pub force_per_load: DVector<f64>,
}

impl System {
    /// Number of coordinates.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether there are none (never).
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }

    /// Direction of a mesh over all coordinates.
    pub fn direction(&self, mesh: &MeshLine) -> DVector<f64> {
        let mut direction = DVector::zeros(self.len());
        for (body, values) in mesh.bodies.iter().zip(&mesh.directions) {
            let at = self.bodies[*body].at;
            values.iter().enumerate().for_each(|(i, value)| direction[at + i] += value);
        }
        direction
    }

    /// The body of a part.
    pub fn body(&self, part: Part) -> Option<&Body> {
        self.bodies.iter().find(|body| body.part == part)
    }

    /// Stiffness with every mesh at its mean.
    pub fn mean_stiffness(&self) -> DMatrix<f64> {
        self.meshes.iter().fold(self.stiffness.clone(), |sum, mesh| {
            let direction = self.direction(mesh);
            sum + self.stiffnesses[mesh.stiffness].mean_n_per_m() * &direction * direction.transpose()
        })
    }

    /// Damping with every mesh at its mean.
    pub fn mean_damping(&self) -> DMatrix<f64> {
        self.meshes.iter().fold(self.damping.clone(), |sum, mesh| {
            let direction = self.direction(mesh);
            let damping = mesh.damping_s * self.stiffnesses[mesh.stiffness].mean_n_per_m();
            sum + damping * &direction * direction.transpose()
        })
    }

    /// Deflection under a constant load with every mesh at its mean, without rotation of the whole.
    ///
    /// # Errors
    /// If the equations cannot be solved.
    pub fn static_deflection(&self, load_torque_n_m: f64) -> Result<DVector<f64>> {
        let full = self.mean_stiffness();
        // The rotation of the whole is pinned by a term that a balanced load does not feel.
        let scale = full.diagonal().amax() / self.rigid.norm_squared();
        let pinned = full + scale * &self.rigid * self.rigid.transpose();
        let solved = pinned.lu().solve(&(load_torque_n_m * &self.force_per_load));
        solved.ok_or_else(|| Error::impossible("static deflection", "singular stiffness"))
    }

    /// The same train with every mesh's stiffness at its mean.
    #[must_use]
    pub fn averaged(&self) -> Self {
        Self { stiffnesses: self.stiffnesses.iter().map(MeshStiffness::averaged).collect(), ..self.clone() }
    }
}
