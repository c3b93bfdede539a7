//! Finds datasets to evaluate on in any folder, or simulates them.

mod folder;
mod search;
mod simulated;

pub use folder::{DiscoveredDatasets, NotRun, find_datasets};
pub use simulated::simulated_datasets;
