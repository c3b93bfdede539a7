//! Numbers by overlap of the context views and by distance from them.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use atsplat_numeric::counted;
use atsplat_protocol::{Aggregation, OverlapBins};
use serde::Serialize;

use super::selection::{SelectedTarget, select};
use super::summary::to_publish;
use super::{MetricQuery, Summary};
use crate::Results;

/// A metric by overlap of the context views.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Binned {
    /// Each bin's name and number, in the bins' order.
    pub bins: Vec<(String, Summary)>,
    /// The "Average" column: the protocol's mean over all targets in a bin; not the mean of the bins
    /// (NoPoSplat `src/evaluation/metric_computer.py:116-158`).
    pub average: Summary,
    /// Targets with a score but without an overlap, or outside all bins; they count only in the mean over all targets.
    pub ignored: u64,
}

/// The protocol's means by bin of overlap, as the protocol of `bins` defines them.
pub fn by_overlap(results: &Results, query: &MetricQuery, bins: &OverlapBins, aggregation: Aggregation) -> Binned {
    binned(&select(results, query), bins, |chosen| to_publish(chosen, aggregation))
}

/// Any number by bin of overlap, of targets that are already selected and ordered.
pub(super) fn binned(
    selected: &[SelectedTarget<'_>],
    bins: &OverlapBins,
    summary_of: impl Fn(&[SelectedTarget<'_>]) -> Summary,
) -> Binned {
    let bin_of = |target: &SelectedTarget| target.overlap.and_then(|overlap| bins.name_of(overlap));
    let summary = |is_included: &dyn Fn(Option<&str>) -> bool| {
        let chosen: Vec<SelectedTarget> =
            selected.iter().filter(|target| is_included(bin_of(target))).copied().collect();
        summary_of(&chosen)
    };
    Binned {
        bins: bins.names().iter().map(|name| (name.clone(), summary(&|bin| bin == Some(name)))).collect(),
        average: summary(&|bin| bin.is_some()),
        ignored: selected.iter().filter(|target| target.score().is_some() && bin_of(target).is_none()).count() as u64,
    }
}

/// What readers of a mean over all targets and of one over bins must know about targets outside all bins.
pub fn outside_bins_in_words(targets: u64) -> String {
    format!("{} outside all bins of overlap: in the mean over all targets, not in Average", counted(targets, "target"))
}

/// The metric by signed distance from the window of context frames (negative before it, 0 inside, positive after), in
/// increasing order: the protocol's mean over the targets there. `step` distances go together: 1 to `step`,
/// `step` + 1 to 2 `step`, and so on on either side, each with the middle of its distances; 0 stays alone.
pub fn by_distance_steps(
    results: &Results,
    query: &MetricQuery,
    step: u32,
    aggregation: Aggregation,
) -> Vec<(f64, Summary)> {
    let step = i64::from(step.max(1));
    let group = |distance: i64| distance.signum() * ((distance.abs() + step - 1) / step);
    let middle = |group: i64| (group * step) as f64 - group.signum() as f64 * (step - 1) as f64 / 2.0;
    let mut groups: BTreeMap<i64, Vec<SelectedTarget>> = BTreeMap::new();
    for target in select(results, query) {
        if let Some(distance) = target.distance {
            groups.entry(group(distance)).or_default().push(target);
        }
    }
    let summary = |selected: Vec<SelectedTarget>| to_publish(&selected, aggregation);
    groups.into_iter().map(|(group, selected)| (middle(group), summary(selected))).collect()
}

/// The protocol's mean over the targets whose distance from the window of context frames, on either side, is in a range.
pub fn within_distances(
    results: &Results,
    query: &MetricQuery,
    distances: RangeInclusive<u64>,
    aggregation: Aggregation,
) -> Summary {
    let inside = |target: &SelectedTarget| target.distance.is_some_and(|d| distances.contains(&d.unsigned_abs()));
    let selected: Vec<SelectedTarget> = select(results, query).into_iter().filter(inside).collect();
    to_publish(&selected, aggregation)
}
