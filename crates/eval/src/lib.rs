//! Methods and trials into a results store, and what a store says: statistics, drift, attribution, accuracy against time.
//!
//! A *result* is one method's answer to one trial. It becomes one [`TrialRow`] and as many [`TargetRow`]s as the trial has
//! targets, whatever happened: a failure is a row too. [`Results`] are the rows of one store with their [`Provenance`].
//! How a table looks is not known here.

mod rows;
#[cfg(test)]
mod sample_rows;
pub mod statistics;
pub mod tradeoff;

pub use rows::{
    MethodRecord, MetricRecord, PresetRecord, Provenance, Results, Seconds, SkippedEntry, TargetRow, TargetStatus,
    TrialKey, TrialRow, TrialStatus, WarningCount,
};
