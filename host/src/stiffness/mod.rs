//! Mesh stiffness by the potential-energy method: geometry to the stiffness of one tooth pair along the
//! path of contact, and from there to the time-varying mesh stiffness (TVMS).
//!
//! The abscissa of every curve is the path of contact in base pitches from its theoretical start: the
//! next pair follows one unit behind, the pinion advances one unit per tooth, so a curve is the same at
//! every speed. Stiffness is the local (tangent) one; with the linear Hertz term it equals the secant.
//!
//! The method's own accuracy is about 8 %: three independent codes differ by that much.

mod body;
mod declared;
mod geometry;
mod hertz;
mod pair;
mod quadrature;
mod table;
mod tooth;

pub use body::{BodyCompliance, body_compliance};
pub use geometry::Geometry;
pub use hertz::hertz_stiffness;
pub use pair::PairModel;
pub use table::Table;
pub use tooth::{Tooth, ToothCompliance};
