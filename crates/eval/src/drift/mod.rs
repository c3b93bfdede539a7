//! Results against a committed baseline: has a number moved, is the difference real, and which stage moved it.
//!
//! A [`Baseline`] is a JSON file, one row a line, so that a review of its diff shows what moved. Rows of a deterministic
//! method are compared bit by bit on the machine type that made them, within a stated bound on another, and everything else
//! by paired intervals against limits that repeated runs gave ([`Limit`]). Any change that counts is drift, for better or
//! worse: it has to be looked at and [accepted](Baseline::accept) with a reason. [`DriftReport::data`] says which pictures
//! are others, and [`probe`] which stage does something else. Where nothing could be compared the verdict is
//! [`Verdict::Nothing`], not the same.

mod baseline;
mod bounds;
mod compare;
mod data;
mod display;
mod error;
mod figures;
mod history;
mod limits;
mod numbers;
pub mod probe;
mod provenance;
mod report;
#[cfg(test)]
mod tests;

pub use baseline::{Baseline, BaselineTarget, BaselineTrial, ProbeRecord};
pub use bounds::metric_bound;
pub use compare::compare;
pub use data::{ChangedPicture, DataComparison, PictureDigest, PictureRole};
pub use error::DriftError;
pub use history::{Acceptance, date};
pub use limits::{Limit, least_limit};
pub use numbers::{AcceptedNumber, HistoricRun, NumberHistory, histories};
pub use provenance::{Difference, same_machine};
pub use report::{Basis, Comparison, DriftReport, Finding, FindingKind, Verdict};
