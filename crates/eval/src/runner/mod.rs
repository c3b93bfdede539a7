//! Presets × methods × trials into a [`Store`](crate::Store).
//!
//! Trials come prepared ahead within the bounds of [`Prefetch`](atsplat_protocol::trial::Prefetch). Several of them, or the
//! targets of one, are worked on at once, and nothing is timed; where times are wanted, a [timing pass](crate::timing) follows.
//! Whatever happens to a trial becomes rows; only a store that cannot be written stops a run.

mod evaluate;
mod findings;
mod here;
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
pub use here::here;
pub use index::PlannedIndex;
pub use metrics::{metric_ids, metric_records, named_metrics};
pub use pictures::{KeepPictures, TRUTH, picture_path};
pub use plan::{Dataset, Plan, Summary};
pub use run::run;
pub use selection::{Selection, spread};

pub(crate) use walk::{groups, key_of, recipe};
