//! Rows over several trainings of one network.

use std::collections::BTreeMap;

use atsplat_eval::MethodRecord;
use atsplat_eval::statistics::{SceneMean, of_seeds, weighted_scene_means};
use atsplat_metrics::Definition;

use super::edition::{Edition, Part};
use super::orders::{TrainedMethods, is_further_training, query};
use super::{Cell, Counts, MeasuredOn, Place, Row, Trainings, Value, distinct};
use crate::definition::{ColumnGroup, Quantity, TableDefinition};

/// Measured rows that are trainings of one network from different seeds, and what they were measured with.
struct TrainingGroup<'a> {
    trainings: TrainedMethods<'a>,
    rows: Vec<&'a Row>,
    /// For each group of columns, the methods under its preset, if it has one and no bins.
    groups: Vec<(&'a ColumnGroup, TrainedMethods<'a>)>,
}

/// A row over the trainings of each network among measured rows that was trained several times, and their names.
pub(super) fn mean_rows(definition: &TableDefinition, edition: &Edition<'_>, rows: &[Row]) -> Vec<(Row, String)> {
    let stores = distinct(edition.parts.iter().map(|part| part.source.label)).len();
    let name = |(part, record): &(&Part<'_>, &MethodRecord)| {
        let store = if stores > 1 { format!("{}: ", part.source.label) } else { String::new() };
        let protocol = if edition.mixed { format!(" under {}", part.preset.name) } else { String::new() };
        format!("{store}{}{protocol}", record.name)
    };
    let named = |training: &TrainingGroup<'_>| {
        let names = training.trainings.iter().map(name).collect::<Vec<_>>().join(", ");
        Some((mean_row(training)?, names))
    };
    training_groups(definition, edition, rows).iter().filter_map(named).collect()
}

/// Adds the names of the trainings to mean rows that print the same labels. `means` are their positions with these names.
pub(super) fn distinguish(rows: &mut [Row], means: &[(usize, String)]) {
    let printed: Vec<Vec<String>> = means.iter().map(|(at, _)| rows[*at].printed_labels()).collect();
    for ((at, trainings), labels) in means.iter().zip(&printed) {
        let has_twin = printed.iter().filter(|other| *other == labels).count() > 1;
        if let Some(remark) = rows[*at].remarks.first_mut().filter(|_| has_twin) {
            remark.push_str(&format!(" ({trainings})"));
        }
    }
}

/// The sets of at least two trainings among measured rows.
fn training_groups<'a>(
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
        .map(|(trainings, rows)| TrainingGroup {
            trainings,
            groups: definition.groups.iter().map(|group| methods(group, &rows)).collect(),
            rows,
        })
        .collect()
}

/// The mean over trainings: scores with their spread over trainings and over scenes, means of sizes; no times.
fn mean_row(training: &TrainingGroup<'_>) -> Option<Row> {
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
                let mut cells = training.rows.iter().map(|row| row.cell((group, at)));
                Some(Cell {
                    value: Value::Number(found.mean),
                    interval: found.interval,
                    counts: Some(counts),
                    set_hash: first.cell((group, at)).set_hash,
                    metric_weights: first.cell((group, at)).metric_weights.clone(),
                    not_computed: cells.find_map(|cell| cell.not_computed.clone()),
                    trainings: Some(trainings),
                    ..Cell::default()
                })
            }
            Quantity::Seconds | Quantity::Slope(..) => None,
            _ => {
                let sizes: Option<Vec<f64>> =
                    training.rows.iter().map(|row| row.cell((group, at)).value.number()).collect();
                let sizes = sizes.filter(|sizes| !sizes.is_empty())?;
                let value = Value::Number(sizes.iter().sum::<f64>() / sizes.len() as f64);
                let lacks_trials = training.rows.iter().any(|row| row.cell((group, at)).lacks_trials);
                Some(Cell { value, lacks_trials, set_hash: first.cell((group, at)).set_hash, ..Cell::default() })
            }
        };
        columns.columns.iter().enumerate().map(|own| cell(own).unwrap_or_default()).collect()
    });
    let mut remarks = vec![format!("mean of {} trainings", training.rows.len())];
    remarks.extend(first.remarks.iter().cloned());
    let mut labels = first.labels.clone();
    if let Some(label) = labels.iter_mut().rev().find(|label| !label.is_empty()) {
        *label = common_label(label, &training.trainings);
    }
    let texts = training.rows.iter().filter_map(|row| Some(row.measured_on.as_ref()?.text.as_str()));
    let text = distinct(texts).join("; ");
    let mut all_on = training.rows.iter().filter_map(|row| row.measured_on.as_ref());
    let published_setting = all_on.all(|on| on.published_setting);
    let measured_on =
        first.measured_on.clone().map(|measured_on| MeasuredOn { text, published_setting, ..measured_on });
    let stores = distinct(training.trainings.iter().map(|(part, _)| part.source.label)).join(", ");
    let of_group = |group| training.rows.iter().filter_map(|row| row.protocol(group).cloned()).collect();
    let trainings = (0..training.groups.len()).map(of_group).collect();
    let (method, store) = (None, Some(stores));
    Some(Row { labels, measured_on, remarks, method, store, trainings, cells: cells.collect(), ..first.clone() })
}

/// The label of the first training without what tells it apart from the others: its name in parentheses, or its own title.
fn common_label(label: &str, trainings: &[(&Part<'_>, &MethodRecord)]) -> String {
    let Some((part, record)) = trainings.first() else { return label.to_owned() };
    let names = [format!(" ({})", record.name), format!(" ({}: {})", part.source.label, record.name)];
    if let Some(common) = names.iter().find_map(|name| label.strip_suffix(name.as_str())) {
        return common.to_owned();
    }
    if label == record.title {
        return distinct(trainings.iter().map(|(_, record)| record.title.as_str())).join(" and ");
    }
    label.to_owned()
}

/// The scene means of a method under a protocol, with their weights in its mean.
fn means<'a>(own: &(&'a Part<'a>, &'a MethodRecord), metric: &'static Definition) -> Vec<SceneMean> {
    let (part, _) = own;
    weighted_scene_means(part.source.results, &query(own, metric), part.protocol.aggregation)
}

/// The counts behind a mean over trainings: scenes that all of them have, and the targets of all of them.
fn counts(training: &TrainingGroup<'_>, place: Place, of_training: &[Vec<SceneMean>]) -> Counts {
    let mut counts = Counts::default();
    for own in training.rows.iter().filter_map(|row| row.cell(place).counts) {
        counts.identical += own.identical;
        counts.failed += own.failed;
        counts.not_applicable += own.not_applicable;
        counts.non_finite += own.non_finite;
        counts.uncomputed += own.uncomputed;
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
