use std::collections::BTreeSet;

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_protocol::Aggregation;
use serde::{Deserialize, Serialize};

use crate::Results;
use crate::statistics::{Identical, Leaked, MetricQuery, student_quantile, summary};

/// How far a mean may change before it counts as drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Limit {
    /// Name of the preset.
    pub preset: String,
    /// Name of the method.
    pub method: String,
    /// Id of the metric.
    pub metric: String,
    /// In the metric's unit.
    pub limit: f64,
    /// Number of runs it was estimated from; with 1 run it is the least limit.
    pub runs: u64,
}

/// The smallest limit of a metric: 0.01 dB, and 0.0005 for everything else, half the last digit that papers print.
pub fn least_limit(metric: &str) -> f64 {
    if is_decibels(metric) { 0.01 } else { 0.0005 }
}

/// How far the mean of one scene may change, of several whose mean may change by `noise` from run to run: where noise is independent
/// in each scene it is larger there by the root of their number; twice as much, because the largest of them is compared. Without repeated
/// runs, and at least, 0.5 dB, and 0.02 for everything else.
pub fn scene_limit(metric: &str, noise: Option<f64>, scenes: u64) -> f64 {
    let least = if is_decibels(metric) { 0.5 } else { 0.02 };
    noise.map_or(least, |noise| least.maximum_of(2.0 * noise * (scenes as f64).sqrt()))
}

/// How far a target's score of a deterministic method may differ from the baseline's on another machine type: 0.001 dB, and
/// 1e-5 for everything else. Fused multiply-adds change the last bits of networks and renders; a larger change means that
/// another token was selected, or a real change.
pub fn metric_bound(metric: &str) -> Tolerance {
    Tolerance::absolute(if is_decibels(metric) { 1e-3 } else { 1e-5 })
}

fn is_decibels(metric: &str) -> bool {
    atsplat_metrics::definition(metric).is_some_and(|definition| definition.unit == "dB")
}

/// Limits of all metrics of non-deterministic methods, from repeated runs of the same plan.
///
/// With `n` runs whose means have the standard deviation `s`, the difference between the baseline's mean and that of another
/// run stays within `t · s · √2` in 99 of 100 cases, where `t` is Student's quantile with `n − 1` degrees of freedom.
pub(super) fn limits(runs: &[&Results]) -> Vec<Limit> {
    let Some(first) = runs.first() else { return Vec::new() };
    let random: BTreeSet<&str> = first
        .provenance
        .methods
        .iter()
        .filter(|method| !method.deterministic)
        .map(|method| method.name.as_str())
        .collect();
    let queries: BTreeSet<(&str, &str, &str)> = first
        .targets
        .iter()
        .filter(|row| random.contains(row.key.method.as_str()))
        .flat_map(|row| row.scores.keys().map(|id| (row.key.preset.as_str(), row.key.method.as_str(), id.as_str())))
        .collect();
    let limit = |(preset, method, metric): (&str, &str, &str)| {
        let query = MetricQuery { preset, method, metric, leaked: Leaked::Included, identical: Identical::Capped };
        // The mean that is compared.
        let means: Vec<f64> =
            runs.iter().filter_map(|run| summary(run, &query, Aggregation::SceneMeans).mean).collect();
        let least = least_limit(metric);
        let limit = spread(&means).map_or(least, |spread| spread.maximum_of(least));
        let (preset, method, metric) = (preset.to_owned(), method.to_owned(), metric.to_owned());
        Limit { preset, method, metric, limit, runs: means.len() as u64 }
    };
    queries.into_iter().map(limit).collect()
}

fn spread(means: &[f64]) -> Option<f64> {
    let freedom = means.len().checked_sub(1).filter(|freedom| *freedom > 0)?;
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let variance = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / freedom as f64;
    Some(student_quantile(0.995, freedom) * (2.0 * variance).sqrt())
}
