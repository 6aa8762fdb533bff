//! Mesh stiffness by the potential-energy method: geometry to the stiffness of one tooth pair along the
//! path of contact, and from there to the time-varying mesh stiffness (TVMS).
//!
//! The abscissa of every curve is the path of contact in base pitches from its theoretical start: the
//! next pair follows one unit behind, the pinion advances one unit per tooth, so a curve is the same at
//! every speed. Stiffness is the local (tangent) one; with the linear Hertz term it equals the secant.
//!
//! The method's own accuracy is about 8 %: three independent codes differ by that much.

mod approach;
mod body;
mod crack;
mod declared;
mod hertz;
pub mod iso6336;
pub mod mesh;
pub mod page;
mod pair;
pub mod pair_curve;
mod quadrature;
mod ramp;
pub mod report;
mod table;
mod tooth;

pub use approach::{gap_curvature_per_m, gap_m};
pub use body::{BodyCompliance, body_compliance};
pub use crack::CrackedSection;
pub use declared::CrackedPair;
pub use hertz::hertz_stiffness;
pub use pair::{PairModel, event_knots, fit_adaptive};
pub use ramp::{PAPER_WIDTH_RAD, engage};
pub use table::{TABLE_TOLERANCE, Table};
pub use tooth::{Tooth, ToothCompliance};
