use atsplat_metrics::Definition;
use atsplat_protocol::Aggregation;
use atsplat_results::Results;
use atsplat_results::statistics::{Identical, Leaked, MetricQuery, paired_between};

use super::{explained, leaked_in, measured_from, metric_of, other_setting, shown, subtitle};
use crate::definition::TableDefinition;
use crate::plot::{Ablation, AblationRow, Drawing, Estimate, Origin};
use crate::table::{CellIndex, Row, Source, Table, Value};

/// What a reader must know of rows that were measured several times.
const FIRST: &str = "Of several measured rows with one label, as of several trainings, the first is shown.";

/// The differences to the reference row, published and measured.
pub(super) fn ablation(
    definition: &TableDefinition,
    table: &Table,
    sources: &[Source<'_>],
) -> Option<(String, Drawing)> {
    let group = table.groups.first()?;
    let (column, metric) = metric_of(group)?;
    let index = CellIndex { group: 0, column };
    let reference_labels = definition.reference.as_ref()?;
    let published: Vec<&Row> = table.rows.iter().filter(|row| row.origin == Origin::Published).collect();
    let reference = *published.iter().find(|row| row.labels == *reference_labels)?;
    let reproducing = |row: &Row| {
        let position = row.published_row;
        shown(table).filter(move |other| other.origin == Origin::Measured && other.published_row == position)
    };
    let measured_reference = reproducing(reference).next();
    let row = |row: &Row| {
        let measured = reproducing(row).next();
        let pair = measured.zip(measured_reference);
        AblationRow {
            label: label(row, measured),
            published: match &row.cell(index).value {
                Value::Number(number) => Some(Ok(*number)),
                Value::Text(text) => Some(Err(text.clone())),
                Value::Absent => None,
            },
            measured: measured.and_then(|row| row.cell(index).value.number()),
            gap: pair.and_then(|(row, reference)| gap(sources, metric, row, reference)),
        }
    };
    let rows: Vec<AblationRow> =
        published.iter().filter(|other| other.labels != reference.labels).map(|other| row(other)).collect();
    // The plot shows differences: without any there is nothing to draw.
    rows.iter().any(|row| row.gap.is_some()).then_some(())?;
    let ablation = Ablation {
        title: format!("{}{}", table.title, other_setting(table, 0..1)),
        subtitle: format!(
            "{}{}{}",
            subtitle(table, group, 0..1),
            leaked_in(table, 0..1, sources),
            explained(shown(table))
        ),
        quality: metric.into(),
        reference: row(reference),
        rows,
        note: if published.iter().any(|row| reproducing(row).count() > 1) { FIRST.to_owned() } else { String::new() },
    };
    Some((table.name.clone(), ablation.draw()))
}

/// The label of a published row, with marks of the row that reproduces it.
fn label(row: &Row, measured: Option<&Row>) -> String {
    let untrained = if measured.is_some_and(|row| row.untrained) { ", untrained" } else { "" };
    let inference_only = if measured.is_some_and(|row| row.inference_only) { " ¶" } else { "" };
    format!("{}{untrained}{inference_only}", row.labels.join(", "))
}

/// Variant minus reference over the same targets, averaged as both protocols do, or over scene means if they disagree.
fn gap(sources: &[Source<'_>], metric: &Definition, variant: &Row, reference: &Row) -> Option<Estimate> {
    let ((a, first), (b, second)) = (measured_from(sources, variant)?, measured_from(sources, reference)?);
    let (leaked, identical) = (Leaked::Included, Identical::Excluded);
    let query = |preset, method| MetricQuery { preset, method, metric: metric.id, leaked, identical };
    let aggregations = [aggregation_of(a, first)?, aggregation_of(b, second)?];
    let aggregation = Aggregation::common(aggregations).unwrap_or(Aggregation::SceneMeans);
    let first = query(first, variant.method.as_deref()?);
    let second = query(second, reference.method.as_deref()?);
    let pair = paired_between((a, &first), (b, &second), aggregation)?;
    Some(Estimate { value: pair.difference, interval: pair.interval })
}

/// How a protocol in a store averages targets.
fn aggregation_of(results: &Results, preset: &str) -> Option<Aggregation> {
    Some(results.provenance.preset(preset)?.protocol().ok()?.aggregation)
}
