//! Evaluates methods on trials into a results store ([`atsplat_results::Store`]).
//!
//! Every trial under every method becomes rows, also if it fails. Times come from a separate [timing pass](timing). Statistics of
//! the rows are in [`atsplat_results`]; tables are laid out elsewhere.

pub mod budget;
mod device;
pub mod discovery;
mod error;
pub mod expansion;
pub mod fitting;
mod folder_walk;
mod gaussian_frame;
pub mod live;
pub mod method;
pub mod overlap_estimators;
pub mod reconstruct;
pub mod rendering;
pub mod runner;
#[cfg(test)]
#[path = "../../results/src/sample_rows.rs"]
#[expect(dead_code, reason = "some rows are those of other crates")]
mod sample_rows;
pub mod sources;
pub mod suspicious_notes;
pub mod sweep;
pub mod timing;
pub mod trained;
pub mod weights_list;

pub use device::{ComputeDevice, adapter_record};
pub use error::EvalError;
pub use gaussian_frame::GaussianFrame;
