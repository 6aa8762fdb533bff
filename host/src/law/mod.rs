//! The bandwidth law: from simulated engagement edges to the numbers a node carries.

pub mod crack;
pub mod edges;
pub mod fit;
pub mod forms;
pub mod operating;
pub mod table;
