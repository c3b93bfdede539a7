//! Methods and trials into a results store, and what a store says: statistics, drift, attribution, accuracy against time.
//!
//! A *result* is one method's answer to one trial. It becomes one [`TrialRow`] and as many [`TargetRow`]s as the trial has
//! targets, whatever happened: a failure is a row too. How long it took is told by a [timing pass](timing). [`Results`] are the rows of one store with their [`Provenance`].
//! How a table looks is not known here.

pub mod budget;
mod context;
pub mod discovery;
pub mod drift;
mod error;
pub mod expansion;
mod file_name;
pub mod frame_timings;
pub mod images;
pub mod method;
pub mod overlap_estimators;
pub mod reconstruct;
mod rows;
mod run_report;
pub mod runner;
#[cfg(test)]
mod sample_rows;
pub mod sources;
pub mod statistics;
pub mod store;
pub mod timing;
pub mod tradeoff;
pub mod trained;

pub use context::network_views;
pub use error::EvalError;
pub use rows::{
    IDENTICAL, MethodRecord, MetricRecord, PresetRecord, Provenance, Results, Shard, SkippedEntry, TargetRow,
    TargetStatus, TrialKey, TrialRow, TrialStatus, WarningCount,
};
pub use run_report::RunReport;
pub use store::Store;
