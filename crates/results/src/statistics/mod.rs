//! Statistics of a store's rows: means as protocols publish them, intervals, paired differences, cost.
//!
//! Everything starts from a [`MetricQuery`]: one metric of one method under one preset, with or without targets that
//! are also context frames. Targets that were not compared are counted but never averaged; a non-finite value always
//! counts as a broken render. Intervals resample scenes, because targets of one scene fail together; with fewer than
//! [`MIN_SCENES`] there is no interval, and no slope.

mod bootstrap;
mod breakdown;
mod contrast;
mod cost;
mod paired;
mod scene_means;
mod seeds;
mod selection;
mod significance;
mod summary;
mod trend;

use serde::{Deserialize, Serialize};

pub use bootstrap::{CONFIDENCE, MIN_SCENES, interval_of_mean};
pub use breakdown::{Binned, by_distance_steps, by_overlap, outside_bins_in_words, within_distances};
pub use contrast::Contrast;
pub use cost::{Cost, cost};

pub use paired::{Paired, paired, paired_between, paired_of, paired_scene_means, scene_differences};
pub use scene_means::{
    SceneMean, common_scene_means, direction, scene_means, unpaired_targets, weighted_scene_means, worst,
};
pub use seeds::{Seeds, difference_of_seeds, mean_over_seeds};
pub use selection::{SelectedTarget, is_psnr, score_of};
pub use significance::{sign_test, student_quantile};
pub use summary::{Summary, mean_of, summary, summary_of};
pub use trend::{
    NoTrend, Trend, along_distance, along_overlap, along_setting, lead_along_distance, lead_along_overlap,
};

pub(crate) use contrast::contrast;
pub(crate) use selection::select;
pub(crate) use summary::summary_without_interval;

/// What the label of a row with [`Leaked::Excluded`] has to add.
pub const LEAKED_EXCLUDED: &str = "leaked targets excluded";
/// What [`LEAKED_EXCLUDED`] means.
pub const LEAKED_EXCLUDED_MEANS: &str = "targets that are also context frames do not count";

/// One metric of one method under one preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetricQuery<'a> {
    /// Name of the preset in the rows.
    pub preset: &'a str,
    /// Name of the method in the rows.
    pub method: &'a str,
    /// Id of the metric's [`atsplat_metrics::Definition`].
    pub metric: &'a str,
    /// Whether targets that are also context frames count.
    pub leaked: Leaked,
    /// Whether renders that are identical to the truth count.
    pub identical: Identical,
}

/// Treatment of targets that are also context frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Leaked {
    /// They count, as in published numbers.
    #[default]
    Included,
    /// They are excluded, also from counts.
    Excluded,
}

/// Treatment of renders that are bit-identical to the ground truth: their PSNR is infinite, and one of them, capped at
/// [`atsplat_metrics::DECIBEL_CAP`] dB, moves the mean of a scene by tens of decibels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Identical {
    /// They are counted, and left out of means of every metric.
    #[default]
    Excluded,
    /// They are in the mean, in decibels with the cap.
    Capped,
}

#[cfg(test)]
mod tests;
