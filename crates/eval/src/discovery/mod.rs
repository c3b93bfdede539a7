//! Datasets to evaluate on: in a folder with anything in it, or simulated.

mod folder;
mod simulated;

pub use folder::{Found, NotRun, find_datasets};
pub use simulated::simulated_datasets;
