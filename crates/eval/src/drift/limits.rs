use std::collections::{BTreeMap, BTreeSet};

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_protocol::Aggregation;
use serde::{Deserialize, Serialize};

use crate::statistics::{SelectedTarget, score_of, student_quantile, summary_of};
use crate::{Results, TargetRow, TargetStatus};

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

/// Limits above this multiple of the least one let real changes pass, and are pointed out.
const WIDE: f64 = 10.0;

/// The largest multiple of the largest difference between two of the repeated runs that a limit may have.
const MOST_DIFFERENCES: f64 = 4.0;

impl Limit {
    /// How many times the least limit it is, if that is so much that changes of that size would go unnoticed.
    pub fn wide(&self) -> Option<f64> {
        let times = self.limit / least_limit(&self.metric);
        (times > WIDE).then_some(times)
    }
}

/// Limits of all metrics of non-deterministic methods, from repeated runs of the same plan.
///
/// With `n` runs whose means have the standard deviation `s`, the difference between the baseline's mean and that of another
/// run stays within `t · s · √2` in 99 of 100 cases, where `t` is Student's quantile with `n − 1` degrees of freedom. For few runs
/// `t` is so large (63.7 for two) that no change would ever be beyond the limit: it is at most [`MOST_DIFFERENCES`] times the
/// largest difference between two of the runs, which decides up to about four runs.
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
        let means = compared_means(runs, preset, method, metric);
        let least = least_limit(metric);
        let limit = spread(&means).map_or(least, |spread| spread.maximum_of(least));
        let (preset, method, metric) = (preset.to_owned(), method.to_owned(), metric.to_owned());
        Limit { preset, method, metric, limit, runs: means.len() as u64 }
    };
    queries.into_iter().map(limit).collect()
}

/// The means of the runs as they are compared: over the targets with a score in all of them that is not of a render identical to
/// the truth.
fn compared_means(runs: &[&Results], preset: &str, method: &str, metric: &str) -> Vec<f64> {
    let scores = |run: &&Results| -> BTreeMap<(String, u32, u32), f64> {
        let rows = run.targets.iter().filter(|row| row.key.preset == preset && row.key.method == method);
        let score = |row: &TargetRow| {
            let score = score_of(row.status, row.scores.get(metric).copied(), metric)?;
            let id = (row.key.scene.clone(), row.key.entry, row.target);
            (row.status != TargetStatus::Identical).then_some((id, score))
        };
        rows.filter_map(score).collect()
    };
    let runs: Vec<_> = runs.iter().map(scores).collect();
    let in_all = |id: &(String, u32, u32)| runs.iter().all(|run| run.contains_key(id));
    let mean = |run: &BTreeMap<(String, u32, u32), f64>| {
        let common = run.iter().filter(|(id, _)| in_all(id));
        let selected = common
            .map(|((scene, entry, target), value)| SelectedTarget::of_score((scene.as_str(), *entry, *target), *value));
        summary_of(&selected.collect::<Vec<_>>(), Aggregation::SceneMeans).mean
    };
    runs.iter().filter_map(mean).collect()
}

fn spread(means: &[f64]) -> Option<f64> {
    let freedom = means.len().checked_sub(1).filter(|freedom| *freedom > 0)?;
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let variance = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / freedom as f64;
    let [low, high] = means.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.minimum_of(*value), high.maximum_of(*value)]
    });
    Some((student_quantile(0.995, freedom) * (2.0 * variance).sqrt()).minimum_of(MOST_DIFFERENCES * (high - low)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Student's quantile of one degree of freedom is 63.7: unbounded, the limit of two runs would be 63.7 times their difference.
    #[test]
    fn limits_of_few_runs_are_a_small_multiple_of_what_the_runs_showed() {
        let close = Tolerance::relative(1e-9);
        close.assert([spread(&[20.0, 20.5]).unwrap(), spread(&[20.0, 20.5, 20.25]).unwrap()], [2.0, 2.0], "four times");
        // Σ(x − x̄)² = 28 and t(0.995; 6) = 3.707: 3.707 · √(2 · 28 / 6).
        let seven = spread(&[-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]).unwrap();
        Tolerance::absolute(1e-2).assert([seven], [11.33], "Student's, which is less than 24");
        assert_eq!(spread(&[20.0]), None);
        Tolerance::EXACT.assert([spread(&[20.0, 20.0]).unwrap()], [0.0], "equal runs");
    }

    #[test]
    fn limits_of_more_than_ten_times_the_least_are_wide() {
        let of = |metric: &str, limit| {
            let (preset, method, metric) = ("p".to_owned(), "m".to_owned(), metric.to_owned());
            Limit { preset, method, metric, limit, runs: 2 }.wide()
        };
        assert_eq!([of("psnr", 0.09), of("ssim", 0.0045)], [None; 2]);
        Tolerance::relative(1e-9).assert([of("psnr", 0.5).unwrap(), of("ssim", 0.05).unwrap()], [50.0, 100.0], "times");
    }
}
