//! A table for every protocol that was run: methods × metrics with intervals, by overlap or distance, with time and
//! Gaussians.

use std::collections::BTreeSet;

use atsplat_metrics::{Definition, definitions};
use atsplat_numeric::distinct;
use atsplat_results::{PresetRecord, TargetRow};

use super::build::table;
use super::selection::{ComparableResults, comparable_groups};
use super::{Mixing, Source, Table};
use crate::ReportError;
use crate::definition::{
    Choice, ColumnDefinition, ColumnGroup, LabelColumn, Marks, MeasuredLabel, Quantity, SlopeOver, TableDefinition,
    TargetSet,
};
use crate::emit::CSV_SUFFIXES;
use crate::file_names::{plain, unused};

/// The tables of all protocols with results, in the order of the stores: one for each protocol and dataset.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in a store.
pub fn protocol_tables(sources: &[Source<'_>], mixing: Mixing) -> Result<Vec<Table>, ReportError> {
    chosen_protocol_tables(sources, mixing, &Choice::default())
}

/// What is chosen of [`protocol_tables`]. Columns by bin of overlap or by distance are there if their metric is chosen.
///
/// # Errors
/// As [`protocol_tables`].
pub fn chosen_protocol_tables(
    sources: &[Source<'_>],
    mixing: Mixing,
    choice: &Choice,
) -> Result<Vec<Table>, ReportError> {
    let records = sources.iter().flat_map(|source| &source.results.provenance.presets);
    let mut tables: Vec<Table> = Vec::new();
    for protocol in distinct(records.map(PresetRecord::published)) {
        let needed = TableDefinition { choice: choice.clone(), ..definition(protocol, Vec::new()) };
        for results in comparable_groups(&needed, sources, mixing == Mixing::Forced)? {
            let Some(first) = results.parts.first() else { continue };
            let mut definition = definition(protocol, groups(protocol, &results)).with_choice(choice);
            definition.title.clone_from(&first.preset.title);
            definition.caption = format!(
                "Every method under the protocol {}; in brackets, 95 % intervals over scenes.",
                first.preset.name
            );
            let mut table = table(&definition, &[], Some(&results));
            let is_taken = |name: &str| tables.iter().any(|other| other.name == name);
            table.name = unused(&format!("protocol-{}", plain(&first.preset.name)), is_taken);
            if table.is_measured() {
                tables.push(table);
            }
        }
    }
    Ok(tables)
}

fn definition(protocol: &str, groups: Vec<ColumnGroup>) -> TableDefinition {
    let groups = if groups.is_empty() { vec![group(protocol, "", Vec::new())] } else { groups };
    TableDefinition {
        name: String::new(),
        title: String::new(),
        caption: String::new(),
        source: String::new(),
        published: String::new(),
        labels: vec![LabelColumn { title: "Method".to_owned(), text: "{method}".to_owned() }],
        measured_label: MeasuredLabel::Method,
        marks: Marks::BestAndSecond,
        plot: None,
        reference: None,
        others: true,
        ablations: true,
        intervals: true,
        notes: Vec::new(),
        groups,
        rows: Vec::new(),
        choice: Choice::default(),
        columns_left_out: Vec::new(),
    }
}

fn group(protocol: &str, title: &str, quantities: Vec<Quantity>) -> ColumnGroup {
    let column = |quantity: Quantity| ColumnDefinition {
        quantity,
        published: quantity.id().to_owned(),
        title: None,
        exact: false,
    };
    ColumnGroup {
        title: title.to_owned(),
        preset: Some(protocol.to_owned()),
        method: None,
        targets: TargetSet::All,
        suffix: String::new(),
        columns: quantities.into_iter().map(column).collect(),
    }
}

/// All metrics with sizes and times; then the first of them, the protocol's PSNR if it was scored, by bin of overlap, or by distance outside
/// the window, with its slope.
fn groups(protocol: &str, results: &ComparableResults<'_>) -> Vec<ColumnGroup> {
    let metrics = metrics(results);
    let sizes = [Quantity::Gaussians, Quantity::Seconds];
    let mut groups = vec![group(protocol, "", metrics.iter().copied().map(Quantity::Metric).chain(sizes).collect())];
    let Some(metric) = metrics.first().copied() else { return groups };
    let breakdown = |title: &str, suffix: String, targets: TargetSet| ColumnGroup {
        targets,
        suffix,
        ..group(protocol, title, vec![Quantity::Metric(metric)])
    };
    let slope = |along| group(protocol, &format!("Trend of {}", metric.name), vec![Quantity::Slope(metric, along)]);
    let bins = results.parts.first().and_then(|part| part.protocol.overlap_bins.as_ref());
    for name in bins.iter().flat_map(|bins| bins.names()) {
        // Another ending, where the name is that of an end of an interval.
        let ending = if CSV_SUFFIXES.contains(&name.as_str()) { "_overlap" } else { "" };
        let targets = TargetSet::Bin(name.clone());
        groups.push(breakdown(&format!("{name} overlap"), format!("_{name}{ending}"), targets));
    }
    if bins.is_some() {
        groups.push(slope(SlopeOver::Overlap));
    }
    let ranges = distances(results);
    for [low, high] in &ranges {
        let title = match (low, high) {
            (0, _) => "inside the window".to_owned(),
            (low, high) if low == high => format!("{low} outside"),
            (low, high) => format!("{low} to {high} outside"),
        };
        groups.push(breakdown(&title, format!("_{low}_to_{high}"), TargetSet::Distances([*low, *high])));
    }
    if !ranges.is_empty() {
        groups.push(slope(SlopeOver::Distance));
    }
    groups
}

/// The metrics that the targets have a score of, or a reason why not: the protocol's PSNR, of which differences and plots are, then the others
/// in the order of definitions.
fn metrics(results: &ComparableResults<'_>) -> Vec<&'static Definition> {
    let is_known = |row: &TargetRow, id: &str| row.scores.contains_key(id) || row.not_computed.contains_key(id);
    let known = definitions().iter().filter(|metric| targets(results).any(|row| is_known(row, metric.id)));
    let psnr = results.parts.first().map(|part| part.protocol.metrics.psnr);
    let (mut metrics, others): (Vec<_>, Vec<_>) = known.partition(|metric| Some(metric.id) == psnr);
    metrics.extend(others);
    metrics
}

/// Inside the window, and up to three ranges of the distances outside it, of equal width; empty without targets outside.
fn distances(results: &ComparableResults<'_>) -> Vec<[u64; 2]> {
    const RANGES: u64 = 3;
    let found: BTreeSet<u64> = targets(results).map(|row| row.signed_distance.unsigned_abs()).collect();
    let Some(farthest) = found.last().copied().filter(|farthest| *farthest > 0) else { return Vec::new() };
    let width = farthest.div_ceil(RANGES);
    let outside = (0..RANGES).map(|at| [at * width + 1, ((at + 1) * width).min(farthest)]);
    let has_targets = |range: &[u64; 2]| found.range(range[0]..=range[1].max(range[0])).next().is_some();
    std::iter::once([0, 0]).chain(outside).filter(has_targets).collect()
}

/// The targets of all methods under the presets.
fn targets<'a>(results: &'a ComparableResults<'a>) -> impl Iterator<Item = &'a TargetRow> {
    results.parts.iter().flat_map(|part| {
        let targets = part.source.results.targets.iter();
        targets.filter(move |row| row.key.preset == part.preset.name)
    })
}
