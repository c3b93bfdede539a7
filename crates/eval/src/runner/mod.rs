//! Evaluates presets × methods × trials into a [`Store`](crate::Store).
//!
//! Trials are prepared ahead within the limits of [`Prefetch`](atsplat_protocol::trial::Prefetch). Several trials, or the
//! targets of one, are evaluated concurrently without timing; a [timing pass](crate::timing) follows if requested. Failures
//! become rows; only a store that cannot be written stops a run.

mod evaluate;
mod findings;
mod index;
mod metrics;
mod outcome;
mod outdated;
mod pictures;
mod plan;
mod run;
mod scored;
mod selection;
mod walk;
mod worst;

pub use findings::Findings;
pub use index::PlannedIndex;
pub use metrics::{metric_ids, metric_records, named_metrics};
pub use pictures::{CONTEXT, KeepPictures, TRUTH, picture_path};
pub use plan::{Dataset, Plan, Summary, current_provenance};
pub use run::run;
pub use selection::{Selection, spread};

pub(crate) use walk::{groups, key_of, recipe};
