//! Rows over several trainings of one network.

use atsplat_eval::MethodRecord;
use atsplat_eval::statistics::of_seeds;

use super::edition::{Edition, Part};
use super::orders::{is_twin, means};
use super::{Cell, Counts, Row, Trainings, Value};
use crate::definition::{ColumnGroup, Quantity, TableDefinition};

/// Measured rows that are trainings of one network, and what they were measured with.
pub(super) struct Training<'a> {
    rows: Vec<&'a Row>,
    /// For each group of columns, the methods under its preset, if it has one and no bins.
    groups: Vec<(&'a ColumnGroup, Vec<(&'a Part<'a>, &'a MethodRecord)>)>,
}

/// The sets of at least two trainings among measured rows.
pub(super) fn trainings<'a>(
    definition: &'a TableDefinition,
    edition: &'a Edition<'a>,
    rows: &'a [Row],
) -> Vec<Training<'a>> {
    let preset = definition.groups.iter().find_map(|group| group.preset.as_deref());
    let Some(preset) = preset else { return Vec::new() };
    let mut sets: Vec<(&MethodRecord, Vec<&Row>)> = Vec::new();
    for row in rows.iter().filter(|row| !row.without_leaked) {
        let Some((_, record)) = edition.method(preset, row) else { continue };
        match sets.iter_mut().find(|(first, _)| is_twin(first, record)) {
            Some((_, rows)) => rows.push(row),
            None => sets.push((record, vec![row])),
        }
    }
    let methods = |group: &'a ColumnGroup, rows: &[&Row]| {
        let preset = group.preset.as_deref().filter(|_| group.bin.is_none() && group.distances.is_none());
        let of_row = |preset: &str| rows.iter().filter_map(|row| edition.method(preset, row)).collect();
        (group, preset.map(of_row).unwrap_or_default())
    };
    let several = sets.into_iter().filter(|(_, rows)| rows.len() > 1);
    several
        .map(|(_, rows)| Training {
            groups: definition.groups.iter().map(|group| methods(group, &rows)).collect(),
            rows,
        })
        .collect()
}

/// The mean over trainings: scores with the spread of trainings beside that of scenes, means of sizes; no times.
pub(super) fn mean_row(training: &Training<'_>) -> Option<Row> {
    let first = *training.rows.first()?;
    let cells = training.groups.iter().enumerate().map(|(group, (columns, methods))| {
        let cell = |(at, column): (usize, &crate::definition::ColumnDefinition)| match column.quantity {
            Quantity::Metric(metric) => {
                let of_training: Vec<_> = methods.iter().map(|own| means(own, metric)).collect();
                let found = of_seeds(&of_training)?;
                let trainings = Trainings {
                    count: found.seeds,
                    training_deviation: found.training_deviation,
                    scene_deviation: found.scene_deviation,
                };
                let counts = Counts { scenes: found.scenes, ..first.cell((group, at)).counts.unwrap_or_default() };
                let (value, interval) = (Value::Number(found.mean), found.interval);
                Some(Cell { value, interval, counts: Some(counts), trainings: Some(trainings), ..Cell::default() })
            }
            Quantity::Seconds | Quantity::Slope(..) => None,
            _ => {
                let sizes: Option<Vec<f64>> =
                    training.rows.iter().map(|row| row.cell((group, at)).value.number()).collect();
                let sizes = sizes.filter(|sizes| !sizes.is_empty())?;
                let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
                Some(Cell { value: Value::Number(mean), ..Cell::default() })
            }
        };
        columns.columns.iter().enumerate().map(|own| cell(own).unwrap_or_default()).collect()
    });
    let mut remarks = vec![format!("mean of {} trainings", training.rows.len())];
    remarks.extend(first.remarks.iter().cloned());
    let mut labels = first.labels.clone();
    // A label ends with the name in parentheses that tells the trainings apart.
    if let Some(label) = labels.iter_mut().rev().find(|label| !label.is_empty()) {
        label.truncate(label.rfind(" (").unwrap_or(label.len()));
    }
    Some(Row { labels, remarks, method: None, cells: cells.collect(), ..first.clone() })
}
