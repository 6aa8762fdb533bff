//! Puts bodies, springs and meshes of a train together, stage by stage.
//!
//! Bodies on one shaft stand in a row in the order of the stages, the drive before and the load behind them.

use crate::assembly::{Body, MeshLine, Part, System};
use crate::machine::{Inertia, MeshDamping, TrainMachine};
use crate::stiffness::MeshStiffness;
use meshband_mechanics::machine::damping::{COUPLING, of_coupling};
use nalgebra::{DMatrix, DVector};

/// Table of a stage's toothing.
pub(crate) fn place(stage: usize) -> String {
    format!("[[mesh]] {}", stage + 1)
}

/// Damping of a body's support.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Damper {
    /// Share of critical on the body's mass.
    Ratio(f64),
    /// Along x and y, N s/m.
    Own([f64; 2]),
}

/// A spring and damper along a direction of a few coordinates.
struct Spring {
    along: Vec<(usize, f64)>,
    stiffness: f64,
    damping: f64,
}

/// A system that is being put together.
pub(crate) struct Builder<'m> {
    pub machine: &'m TrainMachine,
    mass: Vec<f64>,
    springs: Vec<Spring>,
    bodies: Vec<Body>,
    meshes: Vec<MeshLine>,
    stiffnesses: Vec<MeshStiffness>,
    rigid: Vec<f64>,
    ends: [usize; 2],
}

impl<'m> Builder<'m> {
    pub fn new(machine: &'m TrainMachine) -> Self {
        let ends = [0, 1];
        let load = machine.train.shafts[machine.load.shaft].value();
        Self {
            machine,
            mass: vec![machine.drive.inertia_kg_m2, machine.load.inertia_kg_m2],
            springs: Vec::new(),
            bodies: Vec::new(),
            meshes: Vec::new(),
            stiffnesses: Vec::new(),
            rigid: vec![1.0, load],
            ends,
        }
    }

    /// Adds a body at rest in its frame; gives its index.
    pub fn add_body(&mut self, part: Part, shaft: Option<usize>, inertia: Inertia, [turns, frame]: [f64; 2]) -> usize {
        let at = self.mass.len();
        self.mass.extend([inertia.inertia_kg_m2, inertia.mass_kg, inertia.mass_kg]);
        self.rigid.extend([turns, 0.0, 0.0]);
        self.bodies.push(Body { part, at, shaft, inertia, turns, frame_turns: frame });
        self.bodies.len() - 1
    }

    /// A body.
    pub fn body(&self, body: usize) -> &Body {
        &self.bodies[body]
    }

    /// Index of a body's rotation.
    pub fn at(&self, body: usize) -> usize {
        self.bodies[body].at
    }

    /// Lets a body's x and y take part in the rotation of the whole.
    pub fn carry(&mut self, body: usize, shift: [f64; 2]) {
        let at = self.at(body);
        self.rigid[at + 1..at + 3].copy_from_slice(&shift);
    }

    /// Adds a spring along a direction.
    pub fn add_spring(&mut self, along: Vec<(usize, f64)>, stiffness: f64, damping: f64) {
        self.springs.push(Spring { along, stiffness, damping });
    }

    /// Adds springs under a body along x and y, with a damping of its own or a ratio of critical.
    pub fn support(&mut self, body: usize, stiffness: [f64; 2], damping: Damper) {
        let (at, mass) = (self.at(body), self.bodies[body].inertia.mass_kg);
        for axis in 0..2 {
            let critical = 2.0 * (stiffness[axis] * mass).sqrt();
            let damper = match damping {
                Damper::Ratio(ratio) => ratio * critical,
                Damper::Own(own) => own[axis],
            };
            self.add_spring(vec![(at + 1 + axis, 1.0)], stiffness[axis], damper);
        }
    }

    /// Adds a stiffness curve; gives its index.
    pub fn add_stiffness(&mut self, stiffness: MeshStiffness) -> usize {
        self.stiffnesses.push(stiffness);
        self.stiffnesses.len() - 1
    }

    /// Position of the pitch point on the path of a stiffness, base pitches.
    pub fn pitch_point(&self, stiffness: usize) -> f64 {
        self.stiffnesses[stiffness].pitch_point
    }

    /// Adds a mesh, whose damping follows from its stage's toothing.
    pub fn add_mesh(&mut self, mesh: MeshLine) {
        let toothing = &self.machine.toothings[mesh.stage];
        let damping_s = match toothing.damping {
            MeshDamping::Time(time) => time,
            MeshDamping::Ratio(ratio) => {
                let compliance =
                    |i: usize| mesh.directions[i][0].powi(2) / self.bodies[mesh.bodies[i]].inertia.inertia_kg_m2;
                let mass = 1.0 / (compliance(0) + compliance(1));
                2.0 * ratio * (mass / self.stiffnesses[mesh.stiffness].mean_n_per_m()).sqrt()
            }
        };
        let transmission_error_m = toothing.transmission_error_m.clone();
        self.meshes.push(MeshLine { damping_s, transmission_error_m, ..mesh });
    }

    /// Couples the bodies of each shaft, drive and load against twist.
    pub fn add_shafts(&mut self) {
        let machine = self.machine;
        for (number, shaft) in machine.shafts.iter().enumerate() {
            let on: Vec<usize> = (0..self.bodies.len()).filter(|&b| self.bodies[b].shaft == Some(number)).collect();
            let at: Vec<usize> = on.iter().map(|&body| self.at(body)).collect();
            let damping = shaft.torsion_damping_n_m_s_per_rad;
            at.windows(2).for_each(|ends| self.twist([ends[0], ends[1]], shaft.torsion_n_m_per_rad, damping));
            for (end, index) in [(&machine.drive, self.ends[0]), (&machine.load, self.ends[1])] {
                let neighbour = if index == self.ends[0] { at.first() } else { at.last() };
                if let (true, Some(&neighbour)) = (end.shaft == number, neighbour) {
                    self.twist([index, neighbour], end.coupling_n_m_per_rad, end.coupling_damping_n_m_s_per_rad);
                }
            }
        }
    }

    fn twist(&mut self, ends: [usize; 2], stiffness: f64, damping: Option<f64>) {
        let damper = damping.unwrap_or_else(|| of_coupling(COUPLING, stiffness, ends.map(|end| self.mass[end])));
        self.add_spring(vec![(ends[0], 1.0), (ends[1], -1.0)], stiffness, damper);
    }

    pub fn finish(self) -> System {
        let n = self.mass.len();
        let (mut stiffness, mut damping) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for spring in &self.springs {
            for &(i, a) in &spring.along {
                for &(j, b) in &spring.along {
                    stiffness[(i, j)] += spring.stiffness * a * b;
                    damping[(i, j)] += spring.damping * a * b;
                }
            }
        }
        let mut force_per_load = DVector::zeros(n);
        let load_turns = self.rigid[self.ends[1]];
        force_per_load[self.ends[0]] = load_turns.abs();
        force_per_load[self.ends[1]] = -load_turns.signum();
        System {
            mass: DVector::from_vec(self.mass),
            stiffness,
            damping,
            bodies: self.bodies,
            meshes: self.meshes,
            stiffnesses: self.stiffnesses,
            rigid: DVector::from_vec(self.rigid),
            force_per_load,
        }
    }
}

/// Where a mesh lies and which way its force pushes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    /// Direction from the first body's centre to the second one's; of a pinion in a ring to the pitch point, rad.
    pub angle: f64,
    /// 1 where the first body pushes the second one counter-clockwise about the first one's centre, else -1.
    pub sense: f64,
    /// Whether the second body is a ring about the first.
    pub is_internal: bool,
}

impl Line {
    /// What rotation, x and y of either body add to the approach, from pressure angle and base radii, m.
    ///
    /// The force on the second body lies along the tangent of both base circles: across the line of centres in the
    /// driving sense, turned away from the first body by the pressure angle.
    pub fn directions(&self, pressure_angle: f64, base_radii_m: [f64; 2]) -> [[f64; 3]; 2] {
        let (sin, cos) = self.angle.sin_cos();
        let (out, across) = pressure_angle.sin_cos();
        let normal = [out * cos - self.sense * across * sin, out * sin + self.sense * across * cos];
        let second = if self.is_internal { -self.sense } else { self.sense };
        [[self.sense * base_radii_m[0], normal[0], normal[1]], [second * base_radii_m[1], -normal[0], -normal[1]]]
    }
}
