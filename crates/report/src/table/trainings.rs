//! Rows over several trainings of one network.

use std::collections::BTreeMap;

use atsplat_eval::statistics::{SceneMean, of_seeds};

use super::edition::Edition;
use super::orders::{TrainedMethods, is_further_training, means};
use super::{Cell, Counts, MeasuredOn, Place, Row, Trainings, Value, distinct};
use crate::definition::{ColumnGroup, Quantity, TableDefinition};

/// Measured rows that are trainings of one network from different seeds, and what they were measured with.
pub(super) struct TrainingGroup<'a> {
    rows: Vec<&'a Row>,
    /// For each group of columns, the methods under its preset, if it has one and no bins.
    groups: Vec<(&'a ColumnGroup, TrainedMethods<'a>)>,
}

/// The sets of at least two trainings among measured rows.
pub(super) fn training_groups<'a>(
    definition: &'a TableDefinition,
    edition: &'a Edition<'a>,
    rows: &'a [Row],
) -> Vec<TrainingGroup<'a>> {
    let preset = definition.groups.iter().find_map(|group| group.preset.as_deref());
    let Some(preset) = preset else { return Vec::new() };
    let mut sets: Vec<(TrainedMethods<'a>, Vec<&Row>)> = Vec::new();
    for row in rows.iter().filter(|row| !row.without_leaked) {
        let Some(method) = edition.method(preset, row) else { continue };
        match sets.iter_mut().find(|(trainings, _)| is_further_training(trainings, method)) {
            Some((trainings, rows)) => {
                trainings.push(method);
                rows.push(row);
            }
            None => sets.push((vec![method], vec![row])),
        }
    }
    let methods = |group: &'a ColumnGroup, rows: &[&Row]| {
        let preset = group.preset.as_deref().filter(|_| group.bin.is_none() && group.distances.is_none());
        // A mean over some of the trainings would not be the row's.
        let of_rows = |preset: &str| rows.iter().map(|row| edition.method(preset, row)).collect::<Option<Vec<_>>>();
        (group, preset.and_then(of_rows).unwrap_or_default())
    };
    let several = sets.into_iter().filter(|(_, rows)| rows.len() > 1);
    several
        .map(|(_, rows)| TrainingGroup {
            groups: definition.groups.iter().map(|group| methods(group, &rows)).collect(),
            rows,
        })
        .collect()
}

/// The mean over trainings: scores with their spread over trainings and over scenes, means of sizes; no times.
pub(super) fn mean_row(training: &TrainingGroup<'_>) -> Option<Row> {
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
                let counts = counts(training, (group, at), &of_training);
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
    let texts = training.rows.iter().filter_map(|row| Some(row.measured_on.as_ref()?.text.as_str()));
    let text = distinct(texts).join("; ");
    let measured_on = first.measured_on.clone().map(|measured_on| MeasuredOn { text, ..measured_on });
    Some(Row { labels, measured_on, remarks, method: None, cells: cells.collect(), ..first.clone() })
}

/// The counts behind a mean over trainings: scenes that all of them have, and the targets of all of them.
fn counts(training: &TrainingGroup<'_>, place: Place, of_training: &[Vec<SceneMean>]) -> Counts {
    let mut counts = Counts::default();
    for own in training.rows.iter().filter_map(|row| row.cell(place).counts) {
        counts.identical += own.identical;
        counts.failed += own.failed;
        counts.non_finite += own.non_finite;
    }
    let mut by_scene: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
    for scene in of_training.iter().flatten() {
        let (trainings, targets) = by_scene.entry(&scene.scene).or_default();
        *trainings += 1;
        *targets += scene.targets;
    }
    for (_, targets) in by_scene.into_values().filter(|(trainings, _)| *trainings == of_training.len()) {
        counts.scenes += 1;
        counts.targets += targets;
    }
    counts
}
