use atsplat_protocol::{Aggregation, OverlapBins};
use serde::Serialize;

use super::selection::{SelectedTarget, select};
use super::summary::of_selected;
use super::{MetricQuery, Summary};
use crate::Results;

/// A number by overlap of the context views.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Binned {
    /// Each bin's name and number, in the bins' order.
    pub bins: Vec<(String, Summary)>,
    /// The "Average" column: over all scenes that are in a bin, each with one vote; not the mean of the bins
    /// (NoPoSplat `src/evaluation/metric_computer.py:116-158`).
    pub average: Summary,
    /// Targets that no bin takes, or that have no overlap; they count nowhere.
    pub ignored: u64,
}

/// Per-scene means by bin of overlap, as the protocol of `bins` files them.
pub fn by_overlap(results: &Results, query: &MetricQuery, bins: &OverlapBins) -> Binned {
    let selected = select(results, query);
    let bin_of = |target: &SelectedTarget| target.overlap.and_then(|overlap| bins.name_of(overlap));
    let summary = |wanted: &dyn Fn(Option<&str>) -> bool| {
        let chosen: Vec<SelectedTarget> = selected.iter().filter(|target| wanted(bin_of(target))).copied().collect();
        of_selected(&chosen, Aggregation::SceneMeans)
    };
    Binned {
        bins: bins.names().iter().map(|name| (name.clone(), summary(&|bin| bin == Some(name)))).collect(),
        average: summary(&|bin| bin.is_some()),
        ignored: selected.iter().filter(|target| bin_of(target).is_none()).count() as u64,
    }
}
