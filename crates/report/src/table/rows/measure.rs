//! The numbers of a measured row: means, slopes, sizes and times of a method under a preset.

use atsplat_results::Results;
use atsplat_results::statistics::{
    Binned, Cost, Identical, Leaked, MetricQuery, NoTrend, Summary, Trend, along_distance, along_overlap, by_overlap,
    cost, summary, within_distances,
};
use atsplat_results::times::{NOTHING_ENCODED, Times, times};

use crate::definition::{ColumnDefinition, ColumnGroup, Quantity, SlopeOver, TargetSet};
use crate::table::selection::MethodRun;
use crate::table::{Cell, CellTiming, Counts, TimeScope, Value};

/// The cells of a method under a preset for a group of columns.
pub(super) fn cells(run: MethodRun<'_>, group: &ColumnGroup, leaked: Leaked, forced: bool) -> Vec<Cell> {
    let part = run.part;
    let bins = part.protocol.overlap_bins.as_ref().filter(|_| group.targets.is_by_overlap());
    if let Some(why) = bins.and_then(|bins| part.mismatched_overlaps(bins)).filter(|_| !forced) {
        let cell = Cell { not_computed: Some(format!("{why}; --force bins them nevertheless")), ..Cell::default() };
        return vec![cell; group.columns.len()];
    }
    let cost = cost(run.results(), run.preset_name(), run.method_name());
    let stated = run.record.stated.get(run.preset_name()).and_then(|stated| stated.gaussians);
    let states_gaussians = stated.is_some() && cost.gaussians.is_some();
    let cell = |column: &ColumnDefinition| match column.quantity {
        Quantity::Metric(metric) => metric_cell(run, &run.query(metric, leaked), group),
        Quantity::Slope(metric, along) => slope(run, &run.query(metric, leaked), along),
        Quantity::Seconds => {
            time_cell(times(run.results(), run.preset_name(), run.method_name()), run.record.is_process())
        }
        Quantity::Gaussians => Cell { stated: states_gaussians, ..cost_cell(Quantity::Gaussians, &cost) },
        quantity => cost_cell(quantity, &cost),
    };
    group.columns.iter().map(cell).collect()
}

fn metric_cell(run: MethodRun<'_>, query: &MetricQuery<'_>, group: &ColumnGroup) -> Cell {
    let GroupSummary { summary, outside_bins } = summary_of_group(run, query, group);
    let capped = MetricQuery { identical: Identical::Capped, ..*query };
    // A copy of a context view is no merit of a method.
    let without_leaked = MetricQuery { leaked: Leaked::Excluded, ..*query };
    let has_identical = summary.identical > 0 && summary_of_group(run, &without_leaked, group).summary.identical > 0;
    let with_identical = has_identical.then(|| summary_of_group(run, &capped, group).summary.mean).flatten();
    Cell {
        value: summary.mean.map_or(Value::Absent, Value::Number),
        interval: summary.interval,
        counts: Some(Counts { outside_bins, ..counts_of(&summary) }),
        set_hash: summary.target_set_hash,
        with_identical,
        metric_weights: weights_of(run.results(), query.metric),
        not_computed: summary.not_computed,
        ..Cell::default()
    }
}

/// A metric over the targets of a group of columns.
struct GroupSummary {
    summary: Summary,
    /// Scored targets outside all bins of overlap, if the group is by overlap.
    outside_bins: u64,
}

fn summary_of_group(run: MethodRun<'_>, query: &MetricQuery<'_>, group: &ColumnGroup) -> GroupSummary {
    let (results, protocol) = (run.results(), &run.part.protocol);
    let over = |summary| GroupSummary { summary, outside_bins: 0 };
    match (&group.targets, &protocol.overlap_bins) {
        (TargetSet::All, _) => over(summary(results, query, protocol.aggregation)),
        (TargetSet::Distances([low, high]), _) => {
            over(within_distances(results, query, *low..=*high, protocol.aggregation))
        }
        (TargetSet::Bin(bin), Some(bins)) => {
            let Binned { bins, ignored, .. } = by_overlap(results, query, bins, protocol.aggregation);
            let in_bin = bins.into_iter().find(|(name, _)| name == bin).map(|(_, summary)| summary);
            GroupSummary { summary: in_bin.unwrap_or_default(), outside_bins: ignored }
        }
        (TargetSet::AllBins, Some(bins)) => {
            let Binned { average, ignored, .. } = by_overlap(results, query, bins, protocol.aggregation);
            GroupSummary { summary: average, outside_bins: ignored }
        }
        (TargetSet::Bin(_) | TargetSet::AllBins, None) => over(Summary::default()),
    }
}

/// SHA-256 of the learned weights with which a store computed a metric.
pub(in crate::table) fn weights_of(results: &Results, metric: &str) -> Option<String> {
    results.provenance.metrics.iter().find(|record| record.id == metric)?.weights_sha256.clone()
}

const fn counts_of(found: &Summary) -> Counts {
    Counts {
        scenes: found.scenes,
        targets: found.targets,
        identical: found.identical,
        failed: found.failed,
        not_applicable: found.not_applicable,
        non_finite: found.non_finite,
        uncomputed: found.uncomputed,
        outside_bins: 0,
    }
}

fn slope(run: MethodRun<'_>, query: &MetricQuery<'_>, along: SlopeOver) -> Cell {
    let (results, aggregation) = (run.results(), run.part.protocol.aggregation);
    match along {
        SlopeOver::Overlap => {
            let targets = summary(results, query, aggregation);
            slope_cell(along_overlap(results, query), &targets, 0.1)
        }
        SlopeOver::Distance => {
            let outside = within_distances(results, query, 1..=u64::MAX, aggregation);
            slope_cell(along_distance(results, query), &outside, 1.0)
        }
    }
}

/// `targets` are those that the slope is measured along.
fn slope_cell(trend: Result<Trend, NoTrend>, targets: &Summary, unit: f64) -> Cell {
    let Trend { slope, interval, scenes } = match trend {
        Ok(trend) => trend,
        Err(why) => return Cell { not_computed: Some(why.to_string()), ..Cell::default() },
    };
    let interval = interval.map(|ends| ends.map(|end| end * unit));
    let counts = Some(Counts { scenes, ..counts_of(targets) });
    Cell { value: Value::Number(slope * unit), interval, counts, ..Cell::default() }
}

fn cost_cell(quantity: Quantity, cost: &Cost) -> Cell {
    let value = match quantity {
        Quantity::Gaussians => cost.gaussians,
        Quantity::GaussiansMin => cost.gaussians_min.map(|count| count as f64),
        Quantity::GaussiansMax => cost.gaussians_max.map(|count| count as f64),
        Quantity::InitialTokens => cost.initial_tokens,
        Quantity::FinalTokens => cost.final_tokens,
        Quantity::Metric(_) | Quantity::Slope(..) | Quantity::Difference(_) | Quantity::Seconds => None,
    };
    let value = value.map_or(Value::Absent, Value::Number);
    Cell {
        value,
        lacks_trials: cost.failed + cost.not_applicable > 0,
        set_hash: cost.trial_set_hash,
        ..Cell::default()
    }
}

/// Seconds from context images to Gaussians, measured by the timing pass, or why there are none. Those of a method with a
/// separate process are the encoder's, as the process states them, or else those of the whole answer.
fn time_cell(times: Result<Times, String>, is_process: bool) -> Cell {
    let found = times.and_then(|times| {
        let whole = times.encode.ok_or(NOTHING_ENCODED)?;
        let (spread, scope) = match times.stated_encode() {
            _ if !is_process => (whole, None),
            Some(stated) => (stated, Some(TimeScope::Stated)),
            None => (whole, Some(TimeScope::WholeAnswer)),
        };
        Ok((spread, scope, times))
    });
    match found {
        Err(reason) => Cell { not_computed: Some(reason), ..Cell::default() },
        Ok((spread, scope, times)) => {
            let Times { machine, device, trials, trials_there, repetitions, warm_up, others, busy, .. } = times;
            let stated = machine.is_stated();
            let timing =
                CellTiming { spread, scope, trials, trials_there, repetitions, warm_up, machine, device, others, busy };
            Cell { value: Value::Number(spread.median), stated, timing: Some(timing), ..Cell::default() }
        }
    }
}

impl MethodRun<'_> {
    /// Whether any target is also a context frame.
    pub(super) fn has_leaked(self) -> bool {
        self.targets().any(|row| row.leaked)
    }
}
