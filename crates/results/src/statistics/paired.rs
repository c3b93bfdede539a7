use std::cmp::Ordering;

use atsplat_metrics::Direction;
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::bootstrap::{MIN_SCENES, interval_of_mean};
use super::contrast::weighted_sums;
use super::scene_means::{Cluster, clusters, mean_of_clusters};
use super::selection::{SelectedTarget, select};
use super::{MetricQuery, direction, sign_test};
use crate::Results;

/// Two results for the same targets, compared scene by scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Paired {
    /// The protocol's mean of `a − b`.
    pub difference: f64,
    /// Its 95 % interval over scenes ([`interval_of_mean`]); `None` with fewer than [`MIN_SCENES`].
    pub interval: Option<[f64; 2]>,
    /// Scenes in which `a` is better, by the direction of its metric.
    pub wins: u64,
    /// Scenes in which neither is: the differences of their entries add up to exactly 0.
    pub ties: u64,
    /// Scenes in which `b` is better.
    pub losses: u64,
    /// Exact two-sided sign test over scenes, without ties.
    pub sign_test: f64,
    /// Scenes with at least one target that both have a score for.
    pub scenes: u64,
    /// Targets that both have a score for.
    pub targets: u64,
    /// Targets that only one of them has a score for; they are excluded.
    pub unpaired: u64,
}

/// `a` against `b` within one store, over the targets that both have a score for, whatever their preset: targets are matched
/// by scene, entry and frame, and averaged as the protocol averages them. `None` if there are none.
pub fn paired(results: &Results, a: &MetricQuery, b: &MetricQuery, aggregation: Aggregation) -> Option<Paired> {
    paired_between((results, a), (results, b), aggregation)
}

/// Like [`paired`], across two stores.
pub fn paired_between(
    a: (&Results, &MetricQuery),
    b: (&Results, &MetricQuery),
    aggregation: Aggregation,
) -> Option<Paired> {
    let found = paired_of(&select(a.0, a.1), &select(b.0, b.1), direction(a.1.metric), aggregation)?;
    Some(Paired { interval: found.interval.filter(|_| found.scenes >= MIN_SCENES), ..found })
}

/// Each scene's means of `a` and of `b`, over the targets that both have a score for.
pub fn paired_scene_means(
    results: &Results,
    a: &MetricQuery,
    b: &MetricQuery,
    aggregation: Aggregation,
) -> Vec<(String, [f64; 2])> {
    let (a, b) = (select(results, a), select(results, b));
    let (middle, _) = weighted_sums(&[(&a, 0.5), (&b, 0.5)]);
    let differences = scene_differences(&a, &b, aggregation);
    let both = |(middle, (scene, difference)): (Cluster, (&str, f64))| {
        let mean = middle.sum / middle.weight;
        (scene.to_owned(), [mean + difference / 2.0, mean - difference / 2.0])
    };
    clusters(&middle, aggregation).into_iter().zip(differences).map(both).collect()
}

/// Like [`paired`], of targets that are already selected and ordered, with an interval from two scenes on.
pub fn paired_of(
    a: &[SelectedTarget],
    b: &[SelectedTarget],
    direction: Direction,
    aggregation: Aggregation,
) -> Option<Paired> {
    let (differences, unpaired) = differences(a, b);
    let clusters = clusters(&differences, aggregation);
    let (difference, parts) = mean_of_clusters(&clusters);
    let difference = difference?;
    let count = |order: Ordering| parts.iter().filter(|[sum, _]| sum.partial_cmp(&0.0) == Some(order)).count() as u64;
    let (above, below) = (count(Ordering::Greater), count(Ordering::Less));
    let (wins, losses) = match direction {
        Direction::Higher => (above, below),
        Direction::Lower => (below, above),
    };
    Some(Paired {
        difference,
        interval: interval_of_mean(&parts),
        wins,
        ties: count(Ordering::Equal),
        losses,
        sign_test: sign_test(wins, losses),
        scenes: clusters.len() as u64,
        targets: differences.len() as u64,
        unpaired,
    })
}

/// The mean of `a − b` in each scene in which both have a score, in the order of the targets.
pub fn scene_differences<'a>(
    a: &[SelectedTarget<'a>],
    b: &[SelectedTarget<'a>],
    aggregation: Aggregation,
) -> Vec<(&'a str, f64)> {
    let clusters = clusters(&differences(a, b).0, aggregation);
    clusters.into_iter().map(|cluster| (cluster.scene, cluster.sum / cluster.weight)).collect()
}

/// `a − b` of the targets that both have a score for, and the number of targets that only one has.
pub(super) fn differences<'a>(a: &[SelectedTarget<'a>], b: &[SelectedTarget<'a>]) -> (Vec<SelectedTarget<'a>>, u64) {
    weighted_sums(&[(a, 1.0), (b, -1.0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_of_other_frames_are_not_paired() {
        let target = |at, frame, value| SelectedTarget { frame, ..SelectedTarget::of_score(("a", 0, at), value) };
        let first = [target(0, 10, 5.0), target(1, 20, 7.0), target(2, 30, 1.0)];
        let second = [target(0, 10, 3.0), target(1, 21, 100.0)];
        let (found, unpaired) = differences(&first, &second);
        assert_eq!((found.iter().filter_map(SelectedTarget::score).collect::<Vec<_>>(), unpaired), (vec![2.0], 3));
        assert_eq!(differences(&second, &first).1, 3);
    }
}
