use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::Scale;
use atsplat_numeric::{Extremes as _, Tolerance, mean};
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{SelectedTarget, mean_of, scene_differences, score_of, student_quantile};
use atsplat_results::{Results, TargetRow, TargetStatus};
use serde::{Deserialize, Serialize};

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
    /// Where it is from; in files, a number of runs.
    #[serde(rename = "runs")]
    pub origin: LimitOrigin,
    /// How far the mean of one scene may change, from the same runs; `None` unless it is from such, and in baselines of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<f64>,
}

/// Where a limit is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub enum LimitOrigin {
    /// It was stated; 0 in files.
    Stated,
    /// It is the [`least_limit`], because no repetition of the run showed another; 1 in files.
    Least,
    /// It was estimated from so many runs, at least two.
    Estimated(u64),
}

impl From<u64> for LimitOrigin {
    fn from(runs: u64) -> Self {
        match runs {
            0 => Self::Stated,
            1 => Self::Least,
            runs => Self::Estimated(runs),
        }
    }
}

impl From<LimitOrigin> for u64 {
    fn from(origin: LimitOrigin) -> Self {
        match origin {
            LimitOrigin::Stated => 0,
            LimitOrigin::Least => 1,
            LimitOrigin::Estimated(runs) => runs,
        }
    }
}

/// The smallest limit of a metric: 0.01 dB, and 0.0005 for everything else, half the last digit that papers print.
pub fn least_limit(metric: &str) -> f64 {
    match Scale::of(metric) {
        Scale::Decibels => 0.01,
        Scale::Unit => 0.0005,
    }
}

/// How far the mean of one of several scenes may change: as far as repeated runs showed, and at least by 0.5 dB, or 0.02 for
/// everything else.
///
/// Of a limit without [`Limit::scene`], such as one that was stated, it is estimated: where noise is independent in each scene, it is larger
/// there than in their mean by the root of their number; twice as much, because the largest of them is compared. The least limit of
/// a mean is not noise, and estimates nothing.
pub fn scene_limit(metric: &str, known: Option<&Limit>, scenes: u64) -> f64 {
    let estimated = |known: &Limit| {
        let is_noise = known.origin != LimitOrigin::Least && known.limit > least_limit(metric);
        is_noise.then(|| 2.0 * known.limit * (scenes as f64).sqrt())
    };
    let noise = known.and_then(|known| known.scene.or_else(|| estimated(known)));
    let least = match Scale::of(metric) {
        Scale::Decibels => 0.5,
        Scale::Unit => 0.02,
    };
    noise.map_or(least, |noise| least.maximum_of(noise))
}

/// How far a target's score of a deterministic method may differ from the baseline's on another machine type: 0.001 dB, and
/// 1e-5 for everything else. Fused multiply-adds change the last bits of networks and renders; a larger change means that
/// another token was selected, or a real change.
pub fn metric_bound(metric: &str) -> Tolerance {
    Tolerance::absolute(match Scale::of(metric) {
        Scale::Decibels => 1e-3,
        Scale::Unit => 1e-5,
    })
}

/// Limits above this multiple of the least one let real changes pass, and are pointed out.
const WIDE: f64 = 10.0;

/// The largest multiple of the largest difference between two of the repeated runs that a limit may have.
const MAX_DIFFERENCES: f64 = 4.0;

impl Limit {
    /// Whether it was stated, not estimated.
    pub const fn is_stated(&self) -> bool {
        matches!(self.origin, LimitOrigin::Stated)
    }

    /// Whether it was estimated from repeated runs.
    pub const fn is_estimated(&self) -> bool {
        matches!(self.origin, LimitOrigin::Estimated(_))
    }

    /// Replaces the limits of a metric; `false` if no method has one.
    pub(super) fn state(limits: &mut [Self], metric: &str, limit: f64) -> bool {
        let mut any = false;
        for known in limits.iter_mut().filter(|known| known.metric == metric) {
            (known.limit, known.origin, known.scene, any) = (limit, LimitOrigin::Stated, None, true);
        }
        any
    }

    /// Takes over the limits of the same numbers that were stated before, or estimated from repeated runs.
    pub(super) fn keep(limits: &mut [Self], before: &[Self]) {
        for known in limits {
            let is_same = |limit: &&Self| {
                (&limit.preset, &limit.method, &limit.metric) == (&known.preset, &known.method, &known.metric)
            };
            if let Some(kept) = before.iter().filter(|limit| limit.origin != LimitOrigin::Least).find(is_same) {
                *known = kept.clone();
            }
        }
    }

    /// How many times the least limit it is, if that is so much that changes of that size would go unnoticed.
    pub fn times_least_limit(&self) -> Option<f64> {
        let times = self.limit / least_limit(&self.metric);
        (times > WIDE).then_some(times)
    }
}

/// Limits of all metrics of non-deterministic methods, from repeated runs of the same plan.
///
/// With `n` runs whose means have the standard deviation `s`, the difference between the baseline's mean and that of another
/// run stays within `t · s · √2` in 99 of 100 cases, where `t` is Student's quantile with `n − 1` degrees of freedom. For few runs
/// `t` is so large (63.7 for two) that no change would ever be beyond the limit: it is at most [`MAX_DIFFERENCES`] times the
/// largest difference between two of the runs, which decides up to about four runs. The limit of a scene's mean is as many times the
/// largest difference of one. Without a target that all runs have a score for, it is the least limit.
pub(super) fn limits(runs: &[&Results]) -> Vec<Limit> {
    let Some(first) = runs.first() else { return Vec::new() };
    let limit = |(preset, method, metric): Number<'_>| {
        let scores = compared_scores(runs, preset, method, metric);
        let compared: Vec<Vec<SelectedTarget>> = scores.iter().map(selected).collect();
        let means: Vec<f64> = compared.iter().filter_map(|run| mean_of(run, Aggregation::SceneMeans)).collect();
        let least = least_limit(metric);
        let limit = spread(&means).map_or(least, |spread| spread.maximum_of(least));
        let scene = largest_of_scene(&compared).map(|largest| MAX_DIFFERENCES * largest);
        let (preset, method, metric) = (preset.to_owned(), method.to_owned(), metric.to_owned());
        let origin = if means.len() > 1 { LimitOrigin::Estimated(means.len() as u64) } else { LimitOrigin::Least };
        Limit { preset, method, metric, limit, origin, scene }
    };
    random_numbers(first).into_iter().map(limit).collect()
}

/// Preset, method and metric.
pub(super) type Number<'a> = (&'a str, &'a str, &'a str);

/// Those with scores by a method that is not deterministic.
pub(super) fn random_numbers(results: &Results) -> BTreeSet<Number<'_>> {
    random_targets(results)
        .flat_map(|row| row.scores.keys().map(|id| (row.key.preset.as_str(), row.key.method.as_str(), id.as_str())))
        .collect()
}

/// The targets of methods that are not deterministic.
pub(super) fn random_targets(results: &Results) -> impl Iterator<Item = &TargetRow> {
    let is_random =
        move |row: &&TargetRow| results.provenance.method(&row.key.method).is_some_and(|method| !method.deterministic);
    results.targets.iter().filter(is_random)
}

/// Scores by scene, entry and target.
type Scores = BTreeMap<(String, u32, u32), f64>;

/// The scores of the runs as they are compared: of the targets with a score in all of them that is not of a render identical to the
/// truth.
fn compared_scores(runs: &[&Results], preset: &str, method: &str, metric: &str) -> Vec<Scores> {
    let scores = |run: &&Results| -> Scores {
        let score = |row: &TargetRow| {
            let score = score_of(row.status, row.scores.get(metric).copied(), metric)?;
            let id = (row.key.scene.clone(), row.key.entry, row.target);
            (row.status != TargetStatus::Identical).then_some((id, score))
        };
        run.targets_of(preset, method).filter_map(score).collect()
    };
    let all: Vec<Scores> = runs.iter().map(scores).collect();
    let in_all = |id: &(String, u32, u32)| all.iter().all(|run| run.contains_key(id));
    let common = |run: &Scores| -> Scores {
        run.iter().filter(|(id, _)| in_all(id)).map(|(id, score)| (id.clone(), *score)).collect()
    };
    all.iter().map(common).collect()
}

fn selected(scores: &Scores) -> Vec<SelectedTarget<'_>> {
    let scores = scores.iter();
    scores
        .map(|((scene, entry, target), value)| SelectedTarget::of_score((scene.as_str(), *entry, *target), *value))
        .collect()
}

/// The largest difference of a scene's mean between two of the runs; `None` with one run, or without a scene.
fn largest_of_scene(runs: &[Vec<SelectedTarget<'_>>]) -> Option<f64> {
    let mut largest = None;
    for (at, run) in runs.iter().enumerate() {
        for other in runs.iter().skip(at + 1) {
            for (_, change) in scene_differences(other, run, Aggregation::SceneMeans) {
                largest = Some(largest.map_or(change.abs(), |known: f64| known.maximum_of(change.abs())));
            }
        }
    }
    largest
}

fn spread(means: &[f64]) -> Option<f64> {
    let freedom = means.len().checked_sub(1).filter(|freedom| *freedom > 0)?;
    let mean = mean(means.iter().copied())?;
    let variance = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / freedom as f64;
    let [low, high] = means.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.minimum_of(*value), high.maximum_of(*value)]
    });
    Some((student_quantile(0.995, freedom) * (2.0 * variance).sqrt()).minimum_of(MAX_DIFFERENCES * (high - low)))
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
            Limit { preset, method, metric, limit, origin: LimitOrigin::Estimated(2), scene: None }.times_least_limit()
        };
        assert_eq!([of("psnr", 0.09), of("ssim", 0.0045)], [None; 2]);
        Tolerance::relative(1e-9).assert([of("psnr", 0.5).unwrap(), of("ssim", 0.05).unwrap()], [50.0, 100.0], "times");
    }
}
