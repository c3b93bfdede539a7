use atsplat_eval::statistics::{
    Cost, Identical, Leaked, MetricQuery, Summary, Trend, along_distance, along_overlap, by_overlap, cost, summary,
    within_distances,
};
use atsplat_eval::timing::{NOTHING_ENCODED, Times, times};
use atsplat_eval::{Results, TargetRow, TargetStatus};

use super::edition::Part;
use super::{Cell, CellTiming, Counts, TimeScope, Value};
use crate::definition::{ColumnDefinition, ColumnGroup, Quantity, SlopeOver};

/// The cells of a method under a preset for a group of columns.
pub(super) fn cells(part: &Part<'_>, method: &str, group: &ColumnGroup, leaked: Leaked, forced: bool) -> Vec<Cell> {
    let bins = part.protocol.overlap_bins.as_ref().filter(|_| group.bin.is_some());
    if let Some(why) = bins.and_then(|bins| part.mismatched_overlaps(bins)).filter(|_| !forced) {
        let cell = Cell { not_computed: Some(format!("{why}; --force bins them nevertheless")), ..Cell::default() };
        return vec![cell; group.columns.len()];
    }
    let (results, preset) = (part.source.results, part.preset.name.as_str());
    let cost = cost(results, preset, method);
    let identical = Identical::Excluded;
    let cell = |column: &ColumnDefinition| match column.quantity {
        Quantity::Metric(metric) => {
            metric_cell(part, &MetricQuery { preset, method, metric: metric.id, leaked, identical }, group)
        }
        Quantity::Slope(metric, along) => {
            let query = MetricQuery { preset, method, metric: metric.id, leaked, identical };
            match along {
                SlopeOver::Overlap => {
                    let targets = summary(results, &query, part.protocol.aggregation);
                    slope_cell(along_overlap(results, &query), &targets, 0.1)
                }
                SlopeOver::Distance => {
                    let outside = within_distances(results, &query, 1..=u64::MAX);
                    slope_cell(along_distance(results, &query), &outside, 1.0)
                }
            }
        }
        Quantity::Seconds => time_cell(times(results, preset, method), is_process(part, method)),
        quantity => cost_cell(quantity, &cost),
    };
    group.columns.iter().map(cell).collect()
}

fn metric_cell(part: &Part<'_>, query: &MetricQuery<'_>, group: &ColumnGroup) -> Cell {
    let results = part.source.results;
    let mut outside_bins = 0;
    let mut of_query = |query: &MetricQuery<'_>| match (&group.bin, &part.protocol.overlap_bins) {
        (None, _) => match group.distances {
            Some([low, high]) => within_distances(results, query, low..=high),
            None => summary(results, query, part.protocol.aggregation),
        },
        (Some(bin), Some(bins)) => {
            let binned = by_overlap(results, query, bins);
            outside_bins = binned.ignored;
            let own = binned.bins.into_iter().find(|(name, _)| *name == *bin).map(|(_, summary)| summary);
            own.or_else(|| (*bin == "average").then_some(binned.average)).unwrap_or_default()
        }
        (Some(_), None) => Summary::default(),
    };
    let found = of_query(query);
    let capped = MetricQuery { identical: Identical::Capped, ..*query };
    let with_identical =
        if found.identical > 0 && has_identical(results, query) { of_query(&capped).mean } else { None };
    Cell {
        value: found.mean.map_or(Value::Absent, Value::Number),
        interval: found.interval,
        counts: Some(Counts { outside_bins, ..counts_of(&found) }),
        set_hash: found.target_set_hash,
        with_identical,
        metric_weights: weights_of(results, query.metric),
        not_computed: found.not_computed,
        ..Cell::default()
    }
}

/// Whether a render is identical to the truth although the method was not given that frame.
fn has_identical(results: &Results, query: &MetricQuery<'_>) -> bool {
    let is_own = |row: &&TargetRow| row.key.preset == query.preset && row.key.method == query.method;
    results.targets.iter().filter(is_own).any(|row| row.status == TargetStatus::Identical && !row.leaked)
}

fn weights_of(results: &Results, metric: &str) -> Option<String> {
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

/// `targets` are those that the slope is measured along.
fn slope_cell(trend: Option<Trend>, targets: &Summary, unit: f64) -> Cell {
    let Some(Trend { slope, interval, scenes }) = trend else { return Cell::default() };
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
        Quantity::Metric(_) | Quantity::Slope(..) | Quantity::Seconds => None,
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
/// process of its own are the encoder's, as the process states them, or else those of the whole answer.
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
            let timing =
                CellTiming { spread, scope, trials, trials_there, repetitions, warm_up, machine, device, others, busy };
            Cell { value: Value::Number(spread.median), timing: Some(timing), ..Cell::default() }
        }
    }
}

/// Whether a method runs as a process of its own, which reads and writes files.
fn is_process(part: &Part<'_>, method: &str) -> bool {
    part.source.results.provenance.methods.iter().any(|record| record.name == method && record.is_process())
}

/// Whether any target of a method is also a context frame.
pub(super) fn has_leaked(part: &Part<'_>, method: &str) -> bool {
    let targets = part.source.results.targets.iter();
    targets.filter(|row| row.leaked).any(|row| row.key.preset == part.preset.name && row.key.method == method)
}
