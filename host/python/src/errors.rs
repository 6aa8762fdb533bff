//! The workbench's errors as Python exceptions, with the same one line.

use meshband_host::Error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The exception of `meshband.errors` that stands for an error's kind.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::File { .. } | Error::Output(_) => "FileError",
        Error::Invalid { .. } => "InvalidInput",
        Error::Impossible { .. } => "Impossible",
        Error::Tool { .. } => "ToolError",
    };
    let text = error.to_string();
    match py.import("meshband.errors").and_then(|module| module.getattr(class)).and_then(|class| class.call1((&text,)))
    {
        Ok(instance) => PyErr::from_value(instance),
        Err(_) => PyRuntimeError::new_err(text),
    }
}

/// A result of the workbench as one of Python.
pub fn raised<T>(py: Python<'_>, result: meshband_host::Result<T>) -> PyResult<T> {
    result.map_err(|error| exception(py, &error))
}

/// An invalid argument, said as the workbench says it.
pub fn invalid(py: Python<'_>, place: &str, what: impl std::fmt::Display) -> PyErr {
    exception(py, &Error::invalid(place, what))
}
