//! Evaluates presets × methods × trials into a [`Store`](crate::Store).
//!
//! Trials are prepared ahead within the limits of [`Prefetch`](atsplat_protocol::trial::Prefetch). Several trials, or the
//! targets of one, are evaluated concurrently without timing; a [timing pass](crate::timing) follows if requested. Failures
//! become rows; only a store that cannot be written stops a run.

mod dataset;
mod evaluate;
mod findings;
mod group_run;
mod images;
mod images_and_times;
mod index;
mod metrics;
mod outcome;
mod outdated;
mod plan;
mod run;
mod scored;
mod selection;
mod single;
mod suspicious;
mod worst;

pub use dataset::IndexChoice;
pub use findings::{Findings, UNPUBLISHED_WEIGHTS};
pub use images::{CONTEXT, KeepImages, TRUTH, image_path, is_image_of};
pub use index::{DROPPED_BY_SPLIT, IndexNotice, Missing, NOT_SAMPLED, PlannedIndex};
pub use metrics::{metric_ids, metric_records, named_metrics, suite};
pub use plan::{Dataset, Plan, Summary, current_provenance};
pub use run::{MISSING_SCENES, run, run_until};
pub use selection::{Selection, spread};
pub use single::evaluate_trial;

pub(crate) use findings::is_of_run;
pub(crate) use group_run::{groups, key_of, recipe};
