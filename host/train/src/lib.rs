//! A gear train as data: what its owner declares, and everything that follows from it in exact fractions.
//!
//! `declaration` is the form of the files; `kinematics` turns it into shafts, gears and meshes with signed speeds
//! (Willis for planets); `phasing` says which sidebands a sound planetary set shows; `lines` owns the orders;
//! `families` has the lines of a fault at every gear; `coincidences` says which of them cannot be told apart; `page`
//! and `picture` show it. All orders are per turn of shaft 0, the train's input.

pub mod coincidences;
pub mod declaration;
pub mod families;
pub mod fraction;
pub mod kinematics;
pub mod lines;
pub mod page;
pub mod phasing;
pub mod picture;

pub use declaration::Declaration;
pub use fraction::Fraction;
pub use kinematics::{Gear, Mesh, Role, Train};

use meshband_common::{Error, Result, budget, report, terminal, text};
