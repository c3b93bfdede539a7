//! Rows over several trainings of one network.

use std::collections::BTreeMap;

use atsplat_metrics::Definition;
use atsplat_numeric::distinct;
use atsplat_results::statistics::{SceneMean, mean_over_seeds, weighted_scene_means};

use crate::definition::{ColumnDefinition, ColumnGroup, Quantity, TableDefinition, TargetSet};
use crate::table::comparison::differ_in_weights;
use crate::table::selection::{ComparableResults, MethodRun, is_further_training};
use crate::table::{Cell, CellIndex, Counts, MeasuredOn, Row, Trainings, Value};

/// Measured rows that are trainings of one network from different seeds, and what they were measured with.
struct TrainingGroup<'a> {
    trainings: Vec<MethodRun<'a>>,
    rows: Vec<&'a Row>,
    /// For each group of columns, the trainings under its preset, if it has one and is over all targets.
    groups: Vec<(&'a ColumnGroup, Vec<MethodRun<'a>>)>,
}

/// A row over the trainings of each network among measured rows that was trained several times, and their names.
pub(super) fn mean_rows(
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
    rows: &[Row],
) -> Vec<(Row, String)> {
    let stores = distinct(results.parts.iter().map(|part| part.source.label)).len();
    let name = |run: &MethodRun<'_>| {
        let store = if stores > 1 { format!("{}: ", run.part.source.label) } else { String::new() };
        let protocol = if results.mixed { format!(" under {}", run.preset_name()) } else { String::new() };
        format!("{store}{}{protocol}", run.method_name())
    };
    let with_names = |group: &TrainingGroup<'_>| {
        let names = group.trainings.iter().map(name).collect::<Vec<_>>().join(", ");
        Some((group.mean_row()?, names))
    };
    training_groups(definition, results, rows).iter().filter_map(with_names).collect()
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
    results: &'a ComparableResults<'a>,
    rows: &'a [Row],
) -> Vec<TrainingGroup<'a>> {
    let preset = definition.groups.iter().find_map(|group| group.preset.as_deref());
    let Some(preset) = preset else { return Vec::new() };
    let mut sets: Vec<(Vec<MethodRun<'a>>, Vec<&Row>)> = Vec::new();
    for row in rows.iter().filter(|row| !row.without_leaked) {
        let Some(run) = results.run_under(preset, row) else { continue };
        match sets.iter_mut().find(|(trainings, _)| is_further_training(trainings, run)) {
            Some((trainings, rows)) => {
                trainings.push(run);
                rows.push(row);
            }
            None => sets.push((vec![run], vec![row])),
        }
    }
    let methods = |group: &'a ColumnGroup, rows: &[&Row]| {
        let preset = group.preset.as_deref().filter(|_| group.targets == TargetSet::All);
        // A mean over some of the trainings would not be the row's.
        let of_rows = |preset: &str| rows.iter().map(|row| results.run_under(preset, row)).collect::<Option<Vec<_>>>();
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

impl TrainingGroup<'_> {
    /// The mean over trainings: scores with their spread over trainings and over scenes, means of sizes; no times.
    fn mean_row(&self) -> Option<Row> {
        let first = *self.rows.first()?;
        let mut remarks = vec![format!("mean of {} trainings", self.rows.len())];
        remarks.extend(first.remarks.iter().cloned());
        let mut labels = first.labels.clone();
        if let Some(label) = labels.iter_mut().rev().find(|label| !label.is_empty()) {
            *label = self.common_label(label);
        }
        let stores = distinct(self.trainings.iter().map(|run| run.part.source.label)).join(", ");
        let protocols = |group| self.rows.iter().filter_map(|row| row.protocol(group).cloned()).collect();
        Some(Row {
            labels,
            measured_on: self.measured_on(first),
            remarks,
            method: None,
            store: Some(stores),
            trainings: (0..self.groups.len()).map(protocols).collect(),
            cells: self.cells(),
            ..first.clone()
        })
    }

    fn cells(&self) -> Vec<Vec<Cell>> {
        let groups = self.groups.iter().enumerate();
        groups.map(|(group, (columns, methods))| self.cells_of_group(group, &columns.columns, methods)).collect()
    }

    fn cells_of_group(&self, group: usize, columns: &[ColumnDefinition], methods: &[MethodRun<'_>]) -> Vec<Cell> {
        let quantities = columns.iter().map(|column| column.quantity).enumerate();
        let cell = |(column, quantity)| self.cell(CellIndex { group, column }, quantity, methods);
        quantities.map(|column| cell(column).unwrap_or_default()).collect()
    }

    /// The mean of one column; `None` for a quantity without a mean over trainings.
    fn cell(&self, index: CellIndex, quantity: Quantity, methods: &[MethodRun<'_>]) -> Option<Cell> {
        match quantity {
            Quantity::Metric(metric) => self.metric_cell(index, metric, methods),
            Quantity::Seconds | Quantity::Slope(..) | Quantity::Difference(_) => None,
            _ => self.size_cell(index),
        }
    }

    fn metric_cell(&self, index: CellIndex, metric: &'static Definition, methods: &[MethodRun<'_>]) -> Option<Cell> {
        let scene_means: Vec<Vec<SceneMean>> = methods.iter().map(|run| run.weighted_scene_means(metric)).collect();
        let found = mean_over_seeds(&scene_means)?;
        let trainings = Trainings {
            count: found.seeds,
            training_deviation: found.training_deviation,
            scene_deviation: found.scene_deviation,
        };
        let cells: Vec<&Cell> = self.rows.iter().map(|row| row.cell(index)).collect();
        let first = cells.first()?;
        if differ_in_weights(methods.iter().copied(), metric) {
            let why = format!("the weights of {} differ between the trainings", metric.name);
            return Some(Cell { not_computed: Some(why), ..Cell::default() });
        }
        Some(Cell {
            value: Value::Number(found.mean),
            interval: found.interval,
            counts: Some(counts(&cells, &scene_means)),
            set_hash: first.set_hash,
            metric_weights: first.metric_weights.clone(),
            not_computed: cells.iter().find_map(|cell| cell.not_computed.clone()),
            trainings: Some(trainings),
            ..Cell::default()
        })
    }

    fn size_cell(&self, index: CellIndex) -> Option<Cell> {
        let cells: Vec<&Cell> = self.rows.iter().map(|row| row.cell(index)).collect();
        let first = cells.first()?;
        let sizes: Vec<f64> = cells.iter().map(|cell| cell.value.number()).collect::<Option<_>>()?;
        Some(Cell {
            value: Value::Number(sizes.iter().sum::<f64>() / sizes.len() as f64),
            lacks_trials: cells.iter().any(|cell| cell.lacks_trials),
            set_hash: first.set_hash,
            ..Cell::default()
        })
    }

    /// What the first row was measured on, with the texts of all.
    fn measured_on(&self, first: &Row) -> Option<MeasuredOn> {
        let mut all = self.rows.iter().filter_map(|row| row.measured_on.as_ref());
        let text = distinct(all.clone().map(|on| on.text.as_str())).join("; ");
        let published_setting = all.all(|on| on.published_setting);
        first.measured_on.clone().map(|on| MeasuredOn { text, published_setting, ..on })
    }

    /// The label of the first training without what tells it apart from the others: its name in parentheses, or its title.
    fn common_label(&self, label: &str) -> String {
        let Some(MethodRun { part, record }) = self.trainings.first() else { return label.to_owned() };
        let names = [format!(" ({})", record.name), format!(" ({}: {})", part.source.label, record.name)];
        if let Some(common) = names.iter().find_map(|name| label.strip_suffix(name.as_str())) {
            return common.to_owned();
        }
        if label == record.title {
            return distinct(self.trainings.iter().map(|run| run.record.title.as_str())).join(" and ");
        }
        label.to_owned()
    }
}

impl MethodRun<'_> {
    /// The means over scenes, with their weights in the mean of the protocol.
    fn weighted_scene_means(self, metric: &'static Definition) -> Vec<SceneMean> {
        let (results, query) = self.over_all_targets(metric);
        weighted_scene_means(results, &query, self.part.protocol.aggregation)
    }
}

/// The counts behind a mean over trainings: scenes that all of them have, and the targets of all of them.
fn counts(cells: &[&Cell], scene_means: &[Vec<SceneMean>]) -> Counts {
    let mut counts = Counts::default();
    for of_training in cells.iter().filter_map(|cell| cell.counts) {
        counts.identical += of_training.identical;
        counts.failed += of_training.failed;
        counts.not_applicable += of_training.not_applicable;
        counts.non_finite += of_training.non_finite;
        counts.uncomputed += of_training.uncomputed;
    }
    let mut by_scene: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
    for scene in scene_means.iter().flatten() {
        let (trainings, targets) = by_scene.entry(&scene.scene).or_default();
        *trainings += 1;
        *targets += scene.targets;
    }
    for (_, targets) in by_scene.into_values().filter(|(trainings, _)| *trainings == scene_means.len()) {
        counts.scenes += 1;
        counts.targets += targets;
    }
    counts
}
