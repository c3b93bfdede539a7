//! A table for every protocol that was run: methods × metrics with intervals, by overlap or distance, with time and
//! Gaussians.

use std::collections::BTreeSet;

use atsplat_eval::PresetRecord;
use atsplat_metrics::{Definition, definitions};

use super::build::table;
use super::edition::{Edition, editions};
use super::{BESIDE_NUMBERS, Mixing, Source, Table, distinct};
use crate::ReportError;
use crate::definition::{
    ColumnDefinition, ColumnGroup, LabelColumn, Marks, MeasuredLabel, Quantity, SlopeOver, TableDefinition,
};
use crate::file_names::{plain, unused};

/// The tables of all protocols with results, in the order of the stores: one for each protocol and dataset.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in a store.
pub fn protocol_tables(sources: &[Source<'_>], mixing: Mixing) -> Result<Vec<Table>, ReportError> {
    let records = sources.iter().flat_map(|source| &source.results.provenance.presets);
    let mut tables: Vec<Table> = Vec::new();
    for protocol in distinct(records.map(PresetRecord::published)) {
        let needed = definition(protocol, Vec::new());
        for edition in editions(&needed, sources, mixing == Mixing::Forced)? {
            let Some(first) = edition.parts.first() else { continue };
            let mut own = definition(protocol, groups(protocol, &edition));
            own.title.clone_from(&first.preset.title);
            own.caption = format!(
                "Every method under the protocol {}; in brackets, 95 % intervals over scenes.",
                first.preset.name
            );
            let mut found = table(&own, &[], Some(&edition));
            let is_taken = |name: &str| tables.iter().any(|table| table.name == name);
            found.name = unused(&format!("protocol-{}", plain(&first.preset.name)), is_taken);
            if found.is_measured() {
                tables.push(found);
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
        bin: None,
        distances: None,
        suffix: String::new(),
        columns: quantities.into_iter().map(column).collect(),
    }
}

/// All metrics with sizes and times; then the first metric by bin of overlap, or by distance outside the window, with its
/// slope.
fn groups(protocol: &str, edition: &Edition<'_>) -> Vec<ColumnGroup> {
    let metrics = metrics(edition);
    let sizes = [Quantity::Gaussians, Quantity::Seconds];
    let mut groups = vec![group(protocol, "", metrics.iter().copied().map(Quantity::Metric).chain(sizes).collect())];
    let Some(metric) = metrics.first().copied() else { return groups };
    let breakdown = |title: String, suffix: String, change: &dyn Fn(&mut ColumnGroup)| {
        let mut own = ColumnGroup { suffix, ..group(protocol, &title, vec![Quantity::Metric(metric)]) };
        change(&mut own);
        own
    };
    let slope = |along| group(protocol, &format!("Trend of {}", metric.name), vec![Quantity::Slope(metric, along)]);
    let bins = edition.parts.first().and_then(|part| part.protocol.overlap_bins.as_ref());
    for name in bins.iter().flat_map(|bins| bins.names()) {
        let set = |own: &mut ColumnGroup| own.bin = Some(name.clone());
        // An ending of its own, where the name is that of an end of an interval.
        let ending = if BESIDE_NUMBERS.contains(&name.as_str()) { "_overlap" } else { "" };
        groups.push(breakdown(format!("{name} overlap"), format!("_{name}{ending}"), &set));
    }
    if bins.is_some() {
        groups.push(slope(SlopeOver::Overlap));
    }
    let ranges = distances(edition);
    for [low, high] in &ranges {
        let title = match (low, high) {
            (0, _) => "inside the window".to_owned(),
            (low, high) if low == high => format!("{low} outside"),
            (low, high) => format!("{low} to {high} outside"),
        };
        let set = |own: &mut ColumnGroup| own.distances = Some([*low, *high]);
        groups.push(breakdown(title, format!("_{low}_to_{high}"), &set));
    }
    if !ranges.is_empty() {
        groups.push(slope(SlopeOver::Distance));
    }
    groups
}

/// The metrics that the targets have a score of, or a reason why not, in the order of definitions.
fn metrics(edition: &Edition<'_>) -> Vec<&'static Definition> {
    let requested = |metric: &&Definition| {
        edition.parts.iter().any(|part| {
            let targets = part.source.results.targets.iter().filter(|row| row.key.preset == part.preset.name);
            targets
                .into_iter()
                .any(|row| row.scores.contains_key(metric.id) || row.not_computed.contains_key(metric.id))
        })
    };
    definitions().iter().filter(requested).collect()
}

/// Inside the window, and up to three ranges of the distances outside it, of equal width; empty without targets outside.
fn distances(edition: &Edition<'_>) -> Vec<[u64; 2]> {
    const RANGES: u64 = 3;
    let rows = edition
        .parts
        .iter()
        .flat_map(|part| part.source.results.targets.iter().filter(|row| row.key.preset == part.preset.name));
    let found: BTreeSet<u64> = rows.map(|row| row.signed_distance.unsigned_abs()).collect();
    let Some(farthest) = found.last().copied().filter(|farthest| *farthest > 0) else { return Vec::new() };
    let width = farthest.div_ceil(RANGES);
    let outside = (0..RANGES).map(|at| [at * width + 1, ((at + 1) * width).min(farthest)]);
    let has_targets = |range: &[u64; 2]| found.range(range[0]..=range[1].max(range[0])).next().is_some();
    std::iter::once([0, 0]).chain(outside).filter(has_targets).collect()
}
