//! The native part of the Python package `atsplat`: the libraries' work, without the GIL.
//!
//! What users call is Python, in `python/atsplat`: it has the documented classes, converts arrays of any library to NumPy's, and
//! calls the functions and classes here, which take and return plain numbers and bytes.

#![allow(clippy::needless_pass_by_value, reason = "arguments from Python are owned")]

mod array;
mod camera;
mod drift;
mod error;
mod evaluate;
mod exchange;
mod gaussians;
mod method;
mod metrics;
mod protocol;
mod render;
mod report;
mod store;
mod threads;
mod trial;

use pyo3::prelude::*;

/// The binary's: images come and go, and glibc would map and clear memory for each again.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The native part of atsplat. Its functions are documented where the package calls them.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::drift::{accept_baseline, compare_with_baseline};
    #[pymodule_export]
    use super::evaluate::evaluate;
    #[pymodule_export]
    use super::gaussians::Gaussians;
    #[pymodule_export]
    use super::metrics::{Suite, metric_definitions};
    #[pymodule_export]
    use super::protocol::{Data, Protocol, protocol_names};
    #[pymodule_export]
    use super::render::render;
    #[pymodule_export]
    use super::report::{tables, write_report};
    #[pymodule_export]
    use super::store::{merge_stores, read_store};
    #[pymodule_export]
    use super::trial::{Input, Trial, Trials};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
