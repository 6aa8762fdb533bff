//! The bandwidth law: from simulated engagement edges to the numbers a node carries.

pub mod crack;
pub mod derive;
pub mod edges;
pub mod file;
pub mod fit;
pub mod forms;
pub mod operating;
pub mod table;
