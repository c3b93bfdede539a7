//! Slopes over the number of Gaussians, and of differences between methods.

use atsplat_metrics::Definition;
use atsplat_numeric::decimals_of_interval;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{
    Leaked, Trend, along_setting, common_scene_means, cost, lead_along_distance, lead_along_overlap,
};

use super::Notes;
use crate::counted;
use crate::definition::{ColumnGroup, PlotKind, Quantity, SlopeOver, TableDefinition, is_ablation, is_full};
use crate::numbers::signed;
use crate::table::selection::{ComparableResults, MethodRun};
use crate::table::{NoteKind, Row, Table};

impl Notes {
    /// The slope over the number of Gaussians, in tables whose rows are budgets of one protocol; rows with random weights have no part in
    /// it.
    pub(super) fn trend_over_gaussians(
        &mut self,
        table: &Table,
        definition: &TableDefinition,
        results: &ComparableResults<'_>,
    ) {
        if let Some(text) = trend_over_gaussians(table, definition, results) {
            self.add(NoteKind::Trend, text);
        }
    }

    /// For every slope in a table of a protocol: how the difference of the network to each other method changes, paired by target.
    /// Two slopes whose intervals overlap can differ nevertheless, because both methods find the same scenes hard.
    pub(super) fn trends_of_differences(
        &mut self,
        table: &Table,
        definition: &TableDefinition,
        results: &ComparableResults<'_>,
    ) {
        for group in &definition.groups {
            for column in &group.columns {
                if let Quantity::Slope(metric, along) = column.quantity {
                    for text in trends_of_differences(table, results, group, metric, along) {
                        self.add(NoteKind::Trend, text);
                    }
                }
            }
        }
    }
}

fn trend_over_gaussians(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
) -> Option<String> {
    let has_budgets = matches!(definition.plot, Some(PlotKind::KScaling | PlotKind::BudgetHistogram));
    let preset = definition.groups.first().filter(|_| has_budgets)?.preset.as_deref()?;
    let metric = table.columns().find_map(|(_, column)| column.quantity.metric())?;
    let (untrained, trained): (Vec<&Row>, Vec<&Row>) = table.measured_rows().partition(|row| row.untrained);
    let settings = trained.into_iter().filter_map(|row| {
        let run = results.run_under(preset, row)?;
        let gaussians = cost(run.results(), run.preset_name(), run.method_name()).gaussians?;
        Some((gaussians.log2(), run.over_all_targets(metric)))
    });
    let (sizes, queries): (Vec<f64>, Vec<_>) = settings.unzip();
    // A target that one setting lost would move that setting's mean, and with it the slope.
    let means = common_scene_means(&queries, Aggregation::SceneMeans);
    let settings: Vec<_> = sizes.into_iter().zip(means).collect();
    let Trend { slope, interval, scenes } = along_setting(&settings).ok()?;
    Some(format!(
        "trend: {} changes by {} {} per doubling of Gaussians, over {} settings and {}{}",
        metric.name,
        signed(slope, decimals_of_interval(interval, 3)),
        interval_in_words(interval),
        settings.len(),
        counted(scenes, "scene"),
        if untrained.is_empty() { "" } else { ", without random weights" }
    ))
}

fn trends_of_differences(
    table: &Table,
    results: &ComparableResults<'_>,
    group: &ColumnGroup,
    metric: &'static Definition,
    along: SlopeOver,
) -> Vec<String> {
    let Some(preset) = group.preset.as_deref() else { return Vec::new() };
    let trained = table.measured_rows().filter(|row| !row.untrained);
    let rows: Vec<(&Row, MethodRun<'_>)> =
        trained.filter_map(|row| Some((row, results.run_under(preset, row)?))).collect();
    let Some((network, network_run)) = rows.iter().find(|(_, run)| is_full(run.record)) else { return Vec::new() };
    let is_other = |run: &MethodRun<'_>| !is_full(run.record) && !is_ablation(run.record);
    let others = rows.iter().filter(|(_, run)| is_other(run));
    let text = |(row, run): &(&Row, MethodRun<'_>)| {
        let change = change_of_difference([*network_run, *run], metric, along)?;
        Some(format!(
            "difference: {} of {} minus that of {} {change}",
            metric.name,
            network.printed_name(),
            row.printed_name()
        ))
    };
    others.filter_map(text).collect()
}

/// `changes by +1.000 [+0.800, +1.200] per frame outside, over 8 scenes, leaked targets excluded`: the first method minus the
/// second.
fn change_of_difference(runs: [MethodRun<'_>; 2], metric: &'static Definition, along: SlopeOver) -> Option<String> {
    // Copies of context frames would be most of the trend of a method that copies.
    let [first, second] = runs.map(|run| (run.results(), run.query(metric, Leaked::Excluded)));
    let pair = ((first.0, &first.1), (second.0, &second.1));
    let (found, unit, per) = match along {
        SlopeOver::Overlap => (lead_along_overlap(pair.0, pair.1), 0.1, "0.1 of overlap"),
        SlopeOver::Distance => (lead_along_distance(pair.0, pair.1), 1.0, "frame outside"),
    };
    let Trend { slope, interval, scenes } = found.ok()?;
    let interval = interval.map(|ends| ends.map(|end| end * unit));
    let (slope, scenes) = (signed(slope * unit, decimals_of_interval(interval, 3)), counted(scenes, "scene"));
    let interval = interval_in_words(interval);
    Some(format!("changes by {slope} {interval} per {per}, over {scenes}, leaked targets excluded"))
}

/// The interval of a slope in a sentence.
fn interval_in_words(interval: Option<[f64; 2]>) -> String {
    match interval {
        Some(ends) => {
            let [low, high] = ends.map(|end| signed(end, decimals_of_interval(interval, 3)));
            format!("[{low}, {high}]")
        }
        None => "without an interval".to_owned(),
    }
}
