//! Dynamics of the gear pair: assembly, excitation, Taylor integration, steady state, energy.

pub mod assembly;
pub mod crossings;
pub mod decimate;
pub mod energy;
pub mod excitation;
mod expansion;
pub mod inertia;
pub mod kinematics;
pub mod mesh;
pub mod modes;
pub mod quantity;
pub mod rig;
pub mod roots;
pub mod sample;
pub mod series;
pub mod simulate;
pub mod steady;
pub mod taylor;
pub mod work;

pub use assembly::{Coordinate, Model, System};
pub use excitation::{Effect, Facts};
pub use kinematics::Motion;
pub use mesh::{Mesh, MeshDamping};
pub use quantity::Quantity;
pub use rig::Rig;
pub use series::Series;
pub use taylor::{Solver, State, Statistics, Step};
