//! Python package `meshband`: the workbench's library on numpy arrays.
//!
//! This crate only converts: arrays to vectors, errors to exceptions, outcomes to JSON and HTML. The Python files
//! beside it (`python/meshband`) give them their classes. Nothing is computed here that the command does not compute
//! by the same call. Every call that may take longer than a blink runs on a thread of its own without the
//! interpreter's lock ([`work`]).

mod analysis;
mod errors;
mod import;
mod law;
mod machine;
mod node;
mod outcome;
mod record;
mod work;

use pyo3::prelude::*;

/// The extension module.
#[pymodule]
fn _meshband(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<machine::Machine>()?;
    module.add_class::<law::Law>()?;
    module.add_class::<record::Record>()?;
    module.add_class::<node::Node>()?;
    module.add_class::<outcome::Outcome>()?;
    module.add_function(wrap_pyfunction!(analysis::analyse, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::check, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::close_loop, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::predict, module)?)?;
    module.add_function(wrap_pyfunction!(import::import_files, module)?)?;
    module.add_function(wrap_pyfunction!(node::replay, module)?)?;
    Ok(())
}
