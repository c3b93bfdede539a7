//! What runs leave: rows, their store, statistics, times, accuracy against cost.
//!
//! Every trial under every method is one [`TrialRow`] and one [`TargetRow`] per target, also if it failed. [`Results`] are the rows
//! of one [`Store`] with their [`Provenance`]. Everything that tables, plots and checks of drift need is computed from them alone:
//! no method, network or dataset is needed to read results.

// Tests of other crates contain `sample_rows` too, which therefore names this one.
#[cfg(test)]
extern crate self as atsplat_results;

mod error;
mod file_name;
mod gaps;
mod rows;
mod run_report;
mod run_warning;
#[cfg(test)]
mod sample_rows;
mod shard;
pub mod statistics;
pub mod store;
pub mod times;
pub mod tradeoff;
mod trial_notes;

pub use error::ResultsError;
pub use file_name::file_name;
pub use gaps::{Gap, GapKind};
pub use rows::difference::{differences, excerpts};
pub use rows::{
    AdapterRecord, IDENTICAL, MethodRecord, MetricRecord, Moved, PresetRecord, Provenance, RecordKind, Results,
    SAMPLED_BY, SkippedEntry, StatedCost, StatedSeconds, TRAINED_BACKGROUND, TRAINED_POSES, TargetRow, TargetStatus,
    TrainingRecord, TrialId, TrialKey, TrialRow, TrialStatus, WEIGHTS_ABSENT, WarningCount,
};
pub use run_report::{RunCounts, RunReport};
pub use run_warning::RunWarning;
pub use shard::{InvalidShard, Shard};
pub use store::Store;
pub use trial_notes::TrialNote;
