use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, lead_along_distance, lead_along_overlap};

use super::Table;
use super::edition::Edition;
use super::footer::{interval_of_slope, name};
use crate::counted;
use crate::definition::{ColumnGroup, Quantity, SlopeOver, TableDefinition, is_ablation, is_full};
use crate::plot::Origin;

/// For every slope in a table of a protocol: how the lead of the network over each other method changes, paired by target.
/// Two slopes whose intervals overlap can differ nevertheless, because both methods find the same scenes hard.
pub(super) fn changes_of_leads(table: &Table, definition: &TableDefinition, edition: &Edition<'_>) -> Vec<String> {
    let slopes =
        definition.groups.iter().flat_map(|group| group.columns.iter().map(move |column| (group, column.quantity)));
    slopes
        .filter_map(|(group, quantity)| match quantity {
            Quantity::Slope(metric, along) => Some((group, metric, along)),
            _ => None,
        })
        .flat_map(|(group, metric, along)| in_group(table, edition, group, (metric.id, metric.name), along))
        .collect()
}

fn in_group(
    table: &Table,
    edition: &Edition<'_>,
    group: &ColumnGroup,
    (metric, title): (&str, &str),
    along: SlopeOver,
) -> Vec<String> {
    let Some(preset) = group.preset.as_deref() else { return Vec::new() };
    let rows = table.rows.iter().filter(|row| row.origin == Origin::Measured && !row.without_leaked && !row.untrained);
    let rows: Vec<_> = rows.filter_map(|row| Some((row, edition.method(preset, row)?))).collect();
    let Some((network, (own, record))) = rows.iter().find(|(_, (_, record))| is_full(record)) else {
        return Vec::new();
    };
    // Copies of context frames would be most of the trend of a method that copies.
    let (leaked, identical) = (Leaked::Excluded, Identical::Excluded);
    let mut changes = Vec::new();
    for (row, (part, other)) in rows.iter().filter(|(_, (_, other))| !is_full(other) && !is_ablation(other)) {
        let [first, second] = [(own, record), (part, other)].map(|(part, record)| MetricQuery {
            preset: &part.preset.name,
            method: &record.name,
            metric,
            leaked,
            identical,
        });
        let pair = ((own.source.results, &first), (part.source.results, &second));
        let (found, unit, per) = match along {
            SlopeOver::Overlap => (lead_along_overlap(pair.0, pair.1), 0.1, "0.1 of overlap"),
            SlopeOver::Distance => (lead_along_distance(pair.0, pair.1), 1.0, "frame outside"),
        };
        let Some(trend) = found else { continue };
        let interval = interval_of_slope(trend.interval.map(|ends| ends.map(|end| end * unit)));
        changes.push(format!(
            "lead: {title} of {} minus that of {} changes by {:+.3} {interval} per {per}, over {}, without context frames",
            name(network),
            name(row),
            trend.slope * unit,
            counted(trend.scenes, "scene")
        ));
    }
    changes
}
