//! Evaluates methods on trials into a results store, and analyses stores: statistics, accuracy against time.
//!
//! Every trial under every method becomes one [`TrialRow`] and one [`TargetRow`] per target, also if it fails. Times come from
//! a separate [timing pass](timing). [`Results`] are the rows of one store with their [`Provenance`]. Tables are laid out
//! elsewhere.

pub mod budget;
mod device;
pub mod discovery;
pub mod doubts;
mod error;
pub mod expansion;
mod file_name;
pub mod fitting;
mod folder_walk;
mod gaps;
mod gaussian_frame;
pub mod live;
pub mod method;
pub mod overlap_estimators;
pub mod reconstruct;
pub mod rendering;
mod rows;
mod run_report;
pub mod runner;
#[cfg(test)]
mod sample_rows;
mod shard;
pub mod sources;
pub mod statistics;
pub mod store;
pub mod timing;
pub mod tradeoff;
pub mod trained;
pub mod weights_list;

pub use device::ComputeDevice;
pub use error::EvalError;
pub use file_name::file_name;
pub use gaps::{Gap, GapKind};
pub use gaussian_frame::GaussianFrame;
pub use reconstruct::network_views;
pub use rows::difference::{differences, excerpts};
pub use rows::{
    AdapterRecord, IDENTICAL, MethodRecord, MetricRecord, PresetRecord, Provenance, Results, SkippedEntry, TargetRow,
    TargetStatus, TrainingRecord, TrialKey, TrialRow, TrialStatus, WarningCount,
};
pub use run_report::RunReport;
pub use shard::{InvalidShard, Shard};
pub use store::Store;
