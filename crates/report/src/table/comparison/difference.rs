//! The paired difference of two methods, and which numbers of a table it is comparable with.

use atsplat_metrics::Definition;
use atsplat_numeric::distinct;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{
    Leaked, Paired, Seeds, common_scene_means, difference_of_seeds, paired_between, unpaired_targets,
};

use crate::definition::TableDefinition;
use crate::table::rows::weights_of;
use crate::table::selection::MethodRun;
use crate::table::{Cell, Column, Value};

/// The mean difference of a metric over the targets that two methods have in common, first minus second, as their protocol averages.
#[derive(Clone, Copy, Debug)]
pub(in crate::table) struct Difference {
    pub(in crate::table) value: f64,
    /// Its paired 95 % interval over scenes, and over trainings where there are several; `None` with too few scenes.
    pub(in crate::table) interval: Option<[f64; 2]>,
    pub(in crate::table) scenes: u64,
    pub(super) targets: u64,
    /// Targets that only one of the two has, or not all of their trainings.
    pub(super) unpaired: u64,
}

/// The difference between two methods, each given by its trainings. `None` without a target in common.
pub(in crate::table) fn difference(
    trainings: [&[MethodRun<'_>]; 2],
    metric: &'static Definition,
    leaked: Leaked,
) -> Option<Difference> {
    let [one, other] = trainings;
    let aggregations = trainings.into_iter().flatten().map(|run| run.part.protocol.aggregation);
    // Protocols disagree only in a table that was forced.
    let aggregation = Aggregation::common(aggregations).unwrap_or(Aggregation::SceneMeans);
    if let ([first], [second]) = (one, other) {
        let [a, b] = [first, second].map(|run| (run.results(), run.query(metric, leaked)));
        let Paired { difference, interval, scenes, targets, unpaired, .. } =
            paired_between((a.0, &a.1), (b.0, &b.1), aggregation)?;
        return Some(Difference { value: difference, interval, scenes, targets, unpaired });
    }
    let all = one.iter().chain(other);
    let queries: Vec<_> = all.map(|run| (run.results(), run.query(metric, leaked))).collect();
    let mut means = common_scene_means(&queries, aggregation);
    let targets = means.first().map_or(0, |scenes| scenes.iter().map(|scene| scene.targets).sum());
    let means_of_other = means.split_off(one.len());
    let Seeds { mean, interval, scenes, .. } = difference_of_seeds(&means, &means_of_other)?;
    Some(Difference { value: mean, interval, scenes, targets, unpaired: unpaired_targets(&queries) })
}

/// Whether a metric of these runs is known to have different learned weights.
pub(in crate::table) fn differ_in_weights<'a>(
    runs: impl IntoIterator<Item = MethodRun<'a>>,
    metric: &Definition,
) -> bool {
    distinct(runs.into_iter().filter_map(|run| weights_of(run.results(), metric.id))).len() > 1
}

/// The metric of a column, if it is over all targets of a protocol; the average over bins is taken for it.
pub(super) fn metric_over_all(
    definition: &TableDefinition,
    group: usize,
    column: &Column,
) -> Option<&'static Definition> {
    let is_overall = definition.groups.get(group)?.targets.is_overall();
    if is_overall { column.quantity.metric() } else { None }
}

/// Why a difference over all targets is none of the numbers in a column: they were not computed, or lack targets outside all bins.
pub(in crate::table) fn why_without_difference(cell: &Cell) -> Option<String> {
    if let (Value::Absent, Some(why)) = (&cell.value, &cell.not_computed) {
        return Some(why.clone());
    }
    let is_outside = cell.counts.is_some_and(|counts| counts.outside_bins > 0);
    is_outside.then(|| "some targets are outside all bins of overlap".to_owned())
}
