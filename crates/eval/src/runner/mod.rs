//! Evaluates presets × methods × trials into a [`Store`](atsplat_results::Store).
//!
//! Trials are prepared ahead within the limits of [`Prefetch`](atsplat_protocol::trial::Prefetch). Several trials, or the
//! targets of one, are evaluated concurrently without timing; a [timing pass](crate::timing) follows if requested. Failures
//! become rows; only a file that cannot be written, of the store or for a method, and a process that cannot be started stop a run.

mod dataset;
mod evaluate;
mod evaluate_trial;
mod findings;
mod group_run;
mod image_mistakes;
mod images_and_times;
mod imported_files;
mod index;
mod index_folder;
mod index_notices;
mod kept_images;
mod metrics;
mod moved;
mod nothing_evaluated;
mod outdated;
mod plan;
mod run;
mod selection;
mod shared_files;
mod suspicious;
mod target_row;

pub use dataset::IndexChoice;
pub use evaluate_trial::evaluate_trial;
pub use findings::Findings;
pub use index::PlannedIndex;
pub use index_folder::IndexFolder;
pub use index_notices::{IndexNotice, Missing};
pub use kept_images::KeepImages;
pub use metrics::{metric_records, named_metrics, suite};
pub use plan::{Dataset, Plan, current_provenance};
pub use run::{Step, run, run_until};
pub use selection::Selection;

pub(crate) use group_run::{groups, key_of, trials_of};
