//! What a store's rows say: means as protocols publish them, intervals, paired differences, cost.
//!
//! Everything starts from a [`MetricQuery`]: one metric of one method under one preset, with or without the targets that the
//! method was given as context. What was not compared is counted and never averaged; a value that is not finite counts as a
//! broken render, wherever it comes from. Intervals resample scenes, because targets of one scene fail together.

mod bootstrap;
mod contrast;
mod cost;
mod distance;
mod overlap;
mod paired;
mod scene_means;
mod selection;
mod sign_test;
mod student;
mod summary;
mod worst;

use serde::{Deserialize, Serialize};

pub use bootstrap::{CONFIDENCE, interval_of_mean};
pub use contrast::Contrast;
pub use cost::{Cost, cost};
pub use distance::by_distance;
pub use overlap::{Binned, by_overlap};
pub use paired::{Paired, paired, paired_between};
pub use scene_means::{SceneMean, scene_means};
pub use sign_test::sign_test;
pub use summary::{Summary, summary};
pub use worst::{direction, worst};

pub(crate) use contrast::contrast;
pub(crate) use paired::of_selected as paired_of;
pub(crate) use selection::{Outcome, SelectedTarget, score_of, select};
pub(crate) use student::student_quantile;
pub(crate) use summary::of_selected as summary_of;

/// One metric of one method under one preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetricQuery<'a> {
    /// Name of the preset in the rows.
    pub preset: &'a str,
    /// Name of the method in the rows.
    pub method: &'a str,
    /// Id of the metric's [`atsplat_metrics::Definition`].
    pub metric: &'a str,
    /// Whether targets that the method was given count.
    pub leaked: Leaked,
}

/// What becomes of targets that are also context frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Leaked {
    /// They count, as in published numbers.
    #[default]
    Included,
    /// They are left out, of counts too.
    Excluded,
}

#[cfg(test)]
mod tests;
