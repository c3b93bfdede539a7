//! Evaluates presets × methods × trials into a [`Store`](crate::Store).
//!
//! Trials are prepared ahead within the limits of [`Prefetch`](atsplat_protocol::trial::Prefetch). Several trials, or the
//! targets of one, are evaluated concurrently without timing; a [timing pass](crate::timing) follows if requested. Failures
//! become rows; only a store that cannot be written stops a run.

mod dataset;
mod evaluate;
mod findings;
mod group_run;
mod image_files;
mod images_and_times;
mod index;
mod index_folder;
mod index_notices;
mod kept_images;
mod metrics;
mod outcome;
mod outdated;
mod plan;
mod resemblance;
mod run;
mod scored;
mod selection;
mod shared_files;
mod single;
mod suspicious;

pub use dataset::IndexChoice;
pub use findings::{Findings, UNPUBLISHED_WEIGHTS};
pub use image_files::{CONTEXT, KeepImages, TRUTH, image_path, is_image_of};
pub use index::PlannedIndex;
pub use index_folder::IndexFolder;
pub use index_notices::{DROPPED_BY_SPLIT, IndexNotice, Missing, NOT_SAMPLED};
pub use metrics::{metric_ids, metric_records, named_metrics, suite};
pub use plan::{Dataset, Plan, Summary, current_provenance};
pub use run::{MISSING_SCENES, run, run_until};
pub use selection::{Selection, spread};
pub use single::evaluate_trial;

pub(crate) use findings::is_of_run;
pub(crate) use group_run::{groups, key_of, recipe};
