//! Compares results with a committed baseline: whether a number changed, whether the change is significant, and which stage
//! caused it.
//!
//! A [`Baseline`] is a JSON file with one row per line, so that its diff shows the changes. Rows of a deterministic method are
//! compared bit by bit on the machine type that produced them and within a stated bound on another; all others by paired
//! intervals against limits from repeated runs ([`Limit`]). Any significant change, for better or worse, is drift and has to be
//! reviewed and [accepted](NewBaseline::write) with a reason. [`DriftReport::changes`] says what changed, from the data and the
//! protocol to the methods; [`DriftReport::data`] lists changed images, and [`probe`] finds the changed stage. If nothing could
//! be compared, the verdict is [`DriftVerdict::Nothing`] rather than [`DriftVerdict::Same`].

mod accept;
mod acceptance;
mod agreement;
mod baseline;
mod change;
mod compare;
mod data;
mod display;
mod error;
mod format;
mod github;
mod history;
mod inputs;
mod limits;
mod lost;
mod moved;
pub mod probe;
mod provenance;
mod repetition;
mod report;
mod rows;
#[cfg(test)]
mod tests;

pub use accept::{NewBaseline, ProbeChoice};
pub use acceptance::{Acceptance, AcceptanceReport, acceptable};
pub use baseline::{Baseline, BaselineTarget, BaselineTrial, ProbeRecord, TargetGrouping};
pub use change::{Cause, Change};
pub use compare::compare;
pub use data::{ChangedImage, DataComparison, ImageDigest, ImageRole};
pub use error::DriftError;
pub use format::change as signed_change;
pub use history::{AcceptedNumber, HistoricRun, NumberHistory, histories};
pub use limits::{Limit, LimitOrigin, least_limit, metric_bound, scene_limit};
pub use provenance::{Difference, Setting, same_machine};
pub use repetition::check_repetition;
pub use report::{Basis, Comparison, DriftReport, DriftVerdict, Finding, FindingKind, SceneChange};
