use std::cmp::Ordering;

use atsplat_metrics::Direction;
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::bootstrap::interval_of_mean;
use super::scene_means::clusters;
use super::selection::{Outcome, SelectedTarget, select};
use super::{MetricQuery, direction, sign_test};
use crate::Results;

/// Two answers to the same targets, compared scene by scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Paired {
    /// The mean over scenes of `a − b`.
    pub difference: f64,
    /// Its 95 % interval over scenes ([`interval_of_mean`]); `None` with one scene.
    pub interval: Option<[f64; 2]>,
    /// Scenes in which `a` is better, by the direction of its metric.
    pub wins: u64,
    /// Scenes in which both are equal to the bit.
    pub ties: u64,
    /// Scenes in which `b` is better.
    pub losses: u64,
    /// Exact two-sided sign test over scenes, ties left out.
    pub sign_test: f64,
    /// Scenes with at least one target that both have a score for.
    pub scenes: u64,
    /// Targets that both have a score for.
    pub targets: u64,
    /// Targets that one of them alone has a score for; they are left out.
    pub unpaired: u64,
}

/// `a` against `b` within one store, over the targets that both have a score for, whatever preset they belong to: targets
/// are matched by scene, entry and position. `None` where there are none.
pub fn paired(results: &Results, a: &MetricQuery, b: &MetricQuery) -> Option<Paired> {
    paired_between((results, a), (results, b))
}

/// As [`paired`], across two stores.
pub fn paired_between(a: (&Results, &MetricQuery), b: (&Results, &MetricQuery)) -> Option<Paired> {
    of_selected(&select(a.0, a.1), &select(b.0, b.1), direction(a.1.metric))
}

/// As [`paired`], of targets that are selected already and in order.
pub(crate) fn of_selected(a: &[SelectedTarget], b: &[SelectedTarget], direction: Direction) -> Option<Paired> {
    let (differences, unpaired) = differences(a, b);
    let clusters = clusters(&differences, Aggregation::SceneMeans);
    let parts: Vec<[f64; 2]> = clusters.iter().map(|cluster| [cluster.sum, cluster.weight]).collect();
    let [sum, weight] = parts.iter().fold([0.0, 0.0], |[sum, weight], [s, w]| [sum + s, weight + w]);
    let difference = Some(sum / weight).filter(|mean| mean.is_finite())?;
    let count = |wanted: Ordering| parts.iter().filter(|[sum, _]| sum.partial_cmp(&0.0) == Some(wanted)).count() as u64;
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

/// `a − b` where both have a score, and how many targets only one of them has; both lists are in order of place.
fn differences<'a>(a: &[SelectedTarget<'a>], b: &[SelectedTarget<'a>]) -> (Vec<SelectedTarget<'a>>, u64) {
    let score = |selected: &SelectedTarget| match selected.outcome {
        Outcome::Score { value, .. } => Some(value),
        _ => None,
    };
    let mut others = b.iter().filter_map(|other| Some((other, score(other)?))).peekable();
    let (mut differences, mut unpaired) = (Vec::new(), 0);
    for (one, value) in a.iter().filter_map(|one| Some((one, score(one)?))) {
        while others.next_if(|(other, _)| other.place() < one.place()).is_some() {
            unpaired += 1;
        }
        match others.next_if(|(other, _)| other.place() == one.place()) {
            Some((_, other)) => {
                let outcome = Outcome::Score { value: value - other, identical: false };
                differences.push(SelectedTarget { outcome, ..*one });
            }
            None => unpaired += 1,
        }
    }
    (differences, unpaired + others.count() as u64)
}
